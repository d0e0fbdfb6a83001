// The gallery of misses: the latest ticks, each with the ticks around it on a line from its due
// instant.

function missCard(event, story) {
  const period = 1e6 / story.rate;
  const longest = Math.max(period * 1.2, ...event.around.map((tick) => tick.total_us));
  const [row, width] = [7, 400];
  const x = (us) => (width * us) / longest;
  const bars = event.around.map((tick, i) => {
    let from = 0;
    const isIt = tick.tick === event.tick;
    const parts = tick.phases_us.map((us, phase) => {
      const bar = svg("rect", { x: x(from), y: i * row + (isIt ? 0 : 1.5), width: x(us),
        height: isIt ? row : row - 3, class: `phase${phase}` },
      svg("title", {}, `tick ${tick.tick}: ${words(story.phases[phase])} ${duration(us)}`));
      from += us;
      return bar;
    });
    return svg("g", { class: isIt ? "it" : "near" }, parts);
  });
  const height = event.around.length * row;
  const late = event.missed ? `${duration(event.total_us - period)} late` : "in time";
  const passed = event.skipped > 0 ? `, ${event.skipped} passed over before it` : "";
  const cause = event.cause === "none" ? "" : words(event.cause);
  return html("article", { class: "miss" },
    html("h3", {},
      html("button", { type: "button", class: "link", click: () => Clock.seek(event.time_s) },
        `${fixed(event.time_s, 3)} s`),
      html("span", { class: "own", style: `--own: var(--truck${event.ecu % 8})` },
        `ECU ${event.ecu}`),
      cause ? html("span", { class: "cause" }, cause) : ""),
    html("p", { class: "hint" }, `tick ${grouped(event.tick)}: ${duration(event.total_us)}, ` +
      `${late}${passed}`),
    svg("svg", { viewBox: `0 0 ${width} ${height}`, preserveAspectRatio: "none", role: "img",
      "aria-label": `Phases of the ticks around tick ${event.tick}` }, bars,
    svg("line", { x1: x(period), x2: x(period), y1: 0, y2: height, class: "deadline" })));
}

/** Fills the gallery; false when there is nothing to show. */
function misses(stories, place) {
  const shown = stories.filter((story) => story.events.length > 0);
  if (shown.length === 0) return false;
  for (const story of shown) {
    if (stories.length > 1) place.append(html("h3", {}, `Run ${"AB"[story.run]}`));
    place.append(counted(story));
    place.append(html("p", { class: "legend" }, story.phases.map((phase, i) =>
      html("span", {}, html("i", { class: `phase${i}` }), words(phase)))));
    place.append(html("div", { class: "gallery" },
      story.events.map((event) => missCard(event, story))));
  }
  return true;
}

/** How many misses had which cause. */
function counted(story) {
  const sum = new Map();
  for (const ecu of story.summary.ecus ?? []) {
    for (const causes of [ecu.miss_causes, ecu.skip_causes]) {
      for (const [cause, count] of Object.entries(causes ?? {})) {
        sum.set(cause, (sum.get(cause) ?? 0) + count);
      }
    }
  }
  const causes = [...sum].sort((a, b) => b[1] - a[1]);
  const told = causes.map(([cause, count]) => `${words(cause)} ${grouped(count)}`).join(", ");
  return html("p", { class: "hint" }, told ? `Causes over all ECUs: ${told}. ` : "",
    "The latest ticks, each among its neighbours: time runs to the right from the due instant, " +
    "red is the end of the period.");
}
