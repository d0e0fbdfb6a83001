// How long each phase of a tick takes, over the logarithm of time, against the machine's floor.

const PERCENTILES = ["p50", "p90", "p99", "p99.9", "max"];

const LatencyView = (() => {
  let ecu = 0;

  /** Distance along the axis, 0 to 1, of a duration [µs]. */
  function axis(spreads) {
    const longest = Math.max(...spreads.map((spread) => spread.percentiles_us[4]), 1000);
    const [low, high] = [-1, Math.ceil(Math.log10(longest))];
    const at = (us) => (Math.log10(Math.max(us, 0.1)) - low) / (high - low);
    const decades = Array.from({ length: high - low + 1 }, (_, i) => 10 ** (low + i));
    return { at, decades };
  }

  const counted = (spread) => spread.counts.reduce((sum, count) => sum + count, 0);

  /** The outline of a histogram as of so many, its height the logarithm of the count. */
  function outline(spread, bins, at, most, total = counted(spread)) {
    const scale = total / counted(spread);
    const tall = (count) => (count === 0 ? 0 :
      4 + (34 * Math.max(Math.log10(count * scale), 0)) / Math.log10(most));
    const edge = (bin) => 1000 * at(bins.first_us * 10 ** (bin / bins.per_decade));
    const points = [`M${edge(spread.first)},40`];
    spread.counts.forEach((count, i) => {
      const y = 40 - tall(count);
      points.push(`L${edge(spread.first + i)},${y}`, `L${edge(spread.first + i + 1)},${y}`);
    });
    points.push(`L${edge(spread.first + spread.counts.length)},40`);
    return points.join("");
  }

  /** How late the machine was by itself: the histogram, else the percentiles that are known. */
  function floorOf({ floor, summary, metadata }) {
    if (floor) return floor;
    const told = summary.machine_floor_us ?? metadata?.["platoon.floor_us"];
    if (told?.max === undefined) return null;
    const percentiles = [told.p50, undefined, told.p99, told.p999, told.max].map(Number);
    return { percentiles_us: percentiles, first: 0, counts: [] };
  }

  function marks(values, at) {
    return values.map((value, i) => Number.isNaN(value) ? null :
      svg("line", { x1: 1000 * at(value), x2: 1000 * at(value), y1: i === 4 ? 8 : 16, y2: 40,
        class: `mark m${i}` }, svg("title", {}, `${PERCENTILES[i]} ${duration(value)}`)));
  }

  function picture(at, decades, period, inside) {
    const grid = decades.map((us) => svg("line", { x1: 1000 * at(us), x2: 1000 * at(us), y1: 0,
      y2: 40, class: "grid" }));
    const deadline = svg("line", { x1: 1000 * at(period), x2: 1000 * at(period), y1: 0, y2: 40,
      class: "deadline" });
    return svg("svg", { viewBox: "0 0 1000 40", preserveAspectRatio: "none",
      "aria-hidden": "true" }, grid, deadline, inside);
  }

  function row(name, drawing, values, kind) {
    return html("tr", { class: kind }, html("th", { scope: "row" }, name),
      html("td", { class: "drawing" }, drawing),
      values.map((value) => html("td", { class: "number" }, duration(value))));
  }

  function rows(stories) {
    const floors = stories.map(floorOf);
    const all = stories.flatMap((story) => story.latencies);
    const { at, decades } = axis([...all, ...floors.filter(Boolean)]);
    const period = 1e6 / stories[0].rate;
    const most = Math.max(...all.flatMap((latency) => latency.counts), 10);
    const called = (name, story) => (stories.length > 1 ? `${name} ${"AB"[story.run]}` : name);
    const isOwn = (latency) => latency.ecu === ecu && latency.phase === "total";
    const ticks = (story) => counted(story.latencies.find(isOwn) ?? { counts: [] });
    const curve = (spread, story, kind, total) =>
      svg("path", { d: outline(spread, story.bins, at, most, total), class: kind });
    const machine = (story, kind) => {
      const floor = floors[story.run];
      return floor?.counts.length ? curve(floor, story, kind, ticks(story)) : null;
    };
    const result = [];
    for (const phase of ["total", ...stories[0].phases]) {
      stories.forEach((story) => {
        const latency = story.latencies.find((l) => l.ecu === ecu && l.phase === phase);
        if (!latency) return;
        result.push(row(called(phase === "total" ? "whole tick" : words(phase), story),
          picture(at, decades, period, [
            curve(latency, story, "histogram"),
            machine(story, "machine"),
            marks(latency.percentiles_us, at),
          ]), latency.percentiles_us,
          `${phase === "total" ? "whole" : ""} run${story.run}`));
      });
    }
    stories.filter((story) => floors[story.run]).forEach((story) => {
      const values = floors[story.run].percentiles_us;
      result.push(row(called("machine alone", story),
        picture(at, decades, period, [machine(story, "histogram"), marks(values, at)]), values,
        `floor run${story.run}`));
    });
    const labels = decades.map((us) => html("span", { style: `left: ${100 * at(us)}%` },
      duration(us)));
    return html("table", { class: "latencies" },
      html("thead", {}, html("tr", {}, html("th", {}, "phase"),
        html("th", { class: "drawing" }, html("div", { class: "decades" }, labels)),
        PERCENTILES.map((name) => html("th", { class: "number" }, name)))),
      html("tbody", {}, result));
  }

  function draw(stories, place) {
    const ecus = [...new Set(stories[0].latencies.map((latency) => latency.ecu))];
    const buttons = ecus.map((truck) => html("button", {
      type: "button", class: "own", style: `--own: var(--truck${truck % 8})`,
      "aria-pressed": String(truck === ecu),
      click: () => {
        ecu = truck;
        draw(stories, place);
      },
    }, `ECU ${truck}`));
    const told = stories.map((story) => {
      const own = story.summary.ecus?.find((e) => e.truck === ecu);
      if (!own) return null;
      const qp = own.qp ?? {};
      return html("p", { class: "hint" }, stories.length > 1 ? `${"AB"[story.run]}: ` : "",
        `${grouped(own.ticks)} ticks, ${grouped(own.misses)} late, ${grouped(own.skipped)} passed ` +
        `over; ${grouped(qp.solves ?? 0)} QPs, ${grouped(qp.failures ?? 0)} failed, at most ` +
        `${qp.iterations_max ?? "–"} iterations`);
    });
    place.replaceChildren(html("div", { class: "tools" },
      html("div", { role: "group", "aria-label": "ECU" }, buttons)), ...told.filter(Boolean),
    html("div", { class: "scroll" }, rows(stories)),
    html("p", { class: "hint" }, "Height: logarithm of how many ticks took that long. Marks: p50, " +
"p90, p99, p99.9 and the longest. Red: the period. Amber, and machine alone: how late this " +
      "machine woke a thread that did nothing else, beside the run, in as many wake-ups as there " +
      "are ticks. Ticks passed over never began and are not among these."));
  }

  return {
    draw(stories, place) {
      const latencies = stories[0].latencies;
      const own = latencies.filter((latency) => latency.phase === "total");
      if (own.length === 0) return false;
      ecu = own.reduce((a, b) => (b.percentiles_us[0] > a.percentiles_us[0] ? b : a)).ecu;
      draw(stories, place);
      return true;
    },
  };
})();
