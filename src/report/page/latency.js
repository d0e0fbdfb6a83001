// How long each phase of a tick takes, over the logarithm of time, against the machine's floor.

const PERCENTILES = ["p50", "p90", "p99", "p99.9", "max"];

const LatencyView = (() => {
  let ecu = 0;

  /** Distance along the axis, 0 to 1, of a duration [µs]. */
  function axis(latencies, floor) {
    const longest = Math.max(...latencies.map((l) => l.percentiles_us[4]), floor?.max ?? 0, 1000);
    const [low, high] = [-1, Math.ceil(Math.log10(longest))];
    const at = (us) => (Math.log10(Math.max(us, 0.1)) - low) / (high - low);
    const decades = Array.from({ length: high - low + 1 }, (_, i) => 10 ** (low + i));
    return { at, decades };
  }

  /** The outline of a histogram, its height the logarithm of the count. */
  function outline(latency, bins, at, most) {
    const tall = (count) => (count > 0 ? 4 + (34 * Math.log10(count)) / Math.log10(most) : 0);
    const edge = (bin) => 1000 * at(bins.first_us * 10 ** (bin / bins.per_decade));
    const points = [`M${edge(latency.first)},40`];
    latency.counts.forEach((count, i) => {
      const y = 40 - tall(count);
      points.push(`L${edge(latency.first + i)},${y}`, `L${edge(latency.first + i + 1)},${y}`);
    });
    points.push(`L${edge(latency.first + latency.counts.length)},40`);
    return points.join("");
  }

  function marks(values, at) {
    return values.map((value, i) => value === null || value === undefined ? null :
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
      values.map((value) => html("td", { class: "number" }, duration(value ?? NaN))));
  }

  function rows(stories) {
    const floor = stories[0].summary.machine_floor_us;
    const all = stories.flatMap((story) => story.latencies);
    const { at, decades } = axis(all, floor);
    const period = 1e6 / stories[0].rate;
    const most = Math.max(...all.flatMap((latency) => latency.counts), 10);
    const result = [];
    for (const phase of ["total", ...stories[0].phases]) {
      stories.forEach((story) => {
        const latency = story.latencies.find((l) => l.ecu === ecu && l.phase === phase);
        if (!latency) return;
        const name = phase === "total" ? "whole tick" : words(phase);
        result.push(row(stories.length > 1 ? `${name} ${"AB"[story.run]}` : name,
          picture(at, decades, period, [
            svg("path", { d: outline(latency, story.bins, at, most), class: "histogram" }),
            marks(latency.percentiles_us, at),
          ]), latency.percentiles_us,
          `${phase === "total" ? "whole" : ""} run${story.run}`));
      });
    }
    if (floor) {
      const values = [floor.p50, null, floor.p99, floor.p999, floor.max];
      result.push(row("machine alone", picture(at, decades, period, marks(values, at)), values,
        "floor"));
    }
    const ticks = decades.map((us) => html("span", { style: `left: ${100 * at(us)}%` },
      duration(us)));
    return html("table", { class: "latencies" },
      html("thead", {}, html("tr", {}, html("th", {}, "phase"),
        html("th", { class: "drawing" }, html("div", { class: "decades" }, ticks)),
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
      "p90, p99, p99.9 and the longest. Red: the period. Machine alone: how late this machine " +
      "woke a thread that did nothing else, beside the run. Ticks passed over never began and are " +
      "not among these."));
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
