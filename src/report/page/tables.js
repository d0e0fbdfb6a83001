// What is told in words and numbers: verdict, criteria, trucks, bus, machine.

const TIMING = {
  pass: ["pass", "deadlines met"],
  fail: ["fail", "more late ticks than this machine explains"],
  inconclusive: ["unsure", "deadlines inconclusive: this machine is late by itself"],
  virtual: ["none", "virtual time, no deadlines"],
};

function badge(story) {
  const verdict = story.summary.verdict;
  const [kind, word] = verdict === "pass" ? ["pass", "PASS"] :
    verdict === "fail" ? ["fail", "FAIL"] : ["none", "no verdict"];
  return html("span", { class: `badge ${kind}` }, word);
}

function facts(story) {
  const { summary, metadata } = story;
  const run = metadata?.["platoon.run"] ?? {};
  const began = story.start_wall_ms ? new Date(story.start_wall_ms) : null;
  const seed = summary.seed ?? run.seed;
  return [
    `${story.trucks.length || summary.trucks?.length || 0} trucks`,
    `${number(story.rate)} Hz`,
    `${number(summary.duration_s ?? story.end)} s`,
    seed === undefined ? null : `seed ${seed}`,
    summary.bus ? `bus ${summary.bus.backend}` : metadata?.["platoon.bus"]?.backend ?? null,
    summary.solver ?? run.solver ?? null,
    began ? began.toLocaleString(undefined, { dateStyle: "medium", timeStyle: "short" }) : null,
  ].filter(Boolean).join(" · ");
}

function headline(story, isPair) {
  const { summary } = story;
  const [kind, told] = TIMING[summary.timing_verdict] ?? ["none", ""];
  const failed = (summary.criteria ?? []).filter((criterion) => !criterion.passed);
  const count = summary.criteria?.length ?? 0;
  const why = count === 0 ? "" : failed.length === 0 ? `All ${count} criteria hold.` :
    `${failed.length} of ${count} criteria fail: ${failed.map((c) => words(c.name)).join(", ")}.`;
  return html("div", { class: "headline" },
    html("div", { class: "title" }, badge(story),
      html("div", {},
        html("h1", {}, isPair ? `${"AB"[story.run]}: ` : "", words(story.title)),
        html("p", { class: "facts" }, facts(story)))),
    html("p", { class: "why" }, story.scenario?.description ? `${story.scenario.description}. ` : "",
      why, told ? html("span", { class: `timing ${kind}` }, told) : ""),
    story.loss ? html("p", { class: "warning" }, story.loss) : "",
    tiles(story));
}

/** Microseconds as a value and its unit. */
const split = (us) => (us >= 1000 ? [us / 1000, "ms"] : [us, "µs"]);

/** The numbers people ask for first. */
function tiles(story) {
  const { summary } = story;
  const trucks = summary.trucks ?? [];
  const most = (name) => Math.max(...trucks.map((truck) => truck[name] ?? -Infinity));
  const least = (name) => Math.min(...trucks.map((truck) => truck[name] ?? Infinity));
  const settled = trucks.map((truck) => truck.settled_position_s);
  const ecus = summary.ecus ?? [];
  const sum = (name) => ecus.reduce((total, ecu) => total + (ecu[name] ?? 0), 0);
  const totals = story.latencies.filter((latency) => latency.phase === "total");
  const worst = (i) => Math.max(...totals.map((latency) => latency.percentiles_us[i]));
  const all = [
    [most("max_abs_predecessor_error_m"), "m", "largest error to the truck ahead"],
    [least("min_obstacle_clearance_m"), "m", "least clearance to an obstacle"],
    [least("min_truck_gap_m"), "m", "least gap between trucks"],
    [settled.some((time) => time === null) ? NaN : Math.max(...settled), "s", "all in place from"],
    totals.length ? [...split(worst(2)), "a tick takes, p99"] : null,
    totals.length ? [...split(worst(4)), "longest tick"] : null,
    story.isVirtual || ecus.length === 0 ? null :
      [sum("misses") + sum("skipped"), "", `ticks late or passed over of ${grouped(sum("ticks"))}`],
    summary.bus ? [Math.max(...summary.bus.load_percent), "%", "of the fullest bus"] : null,
  ].filter((tile) => tile && Number.isFinite(tile[0]));
  if (trucks.length === 0) return "";
  return html("dl", { class: "tiles" }, all.map(([value, unit, label]) => html("div", {},
    html("dt", {}, label), html("dd", {}, number(value), unit ? html("small", {}, unit) : ""))));
}

function criteria(stories, place) {
  const names = [...new Set(stories.flatMap((story) =>
    (story.summary.criteria ?? []).map((criterion) => criterion.name)))];
  if (names.length === 0) return false;
  const of = (story, name) => story.summary.criteria?.find((c) => c.name === name);
  const bar = (name) => {
    const [label, unit] = named(name);
    const first = stories.map((story) => of(story, name)).find(Boolean);
    const values = stories.map((story) => {
      const criterion = of(story, name);
      if (!criterion) return html("b", {}, "–");
      return html("b", { class: criterion.passed ? "held" : "broken" }, number(criterion.value));
    });
    const passed = stories.every((story) => of(story, name)?.passed ?? true);
    return html("li", { class: passed ? "held" : "broken" },
      html("span", { class: "sign", "aria-label": passed ? "holds" : "fails" }, passed ? "✓" : "✗"),
      html("span", { class: "name" }, label),
      html("span", { class: "values" }, values, html("small", {}, unit)),
      html("span", { class: "limit" }, `limit ${number(first.limit)}`));
  };
  const ranked = [...names].sort((a, b) =>
    Number(of(stories[0], a)?.passed ?? true) - Number(of(stories[0], b)?.passed ?? true));
  place.append(html("ul", { class: "criteria" }, ranked.map(bar)));
  return true;
}

function truckTables(stories, place) {
  const shown = stories.filter((story) => story.summary.trucks?.length);
  for (const story of shown) {
    if (stories.length > 1) place.append(html("h3", {}, `Run ${"AB"[story.run]}`));
    const trucks = story.summary.trucks;
    const names = Object.keys(trucks[0]).filter((name) => name !== "index");
    place.append(table(["", ...trucks.map((truck) => story.called(truck.index))],
      names.map((name) => {
        const [label, unit] = named(name);
        const value = (truck) => Array.isArray(truck[name]) ?
          truck[name].join(", ") || "none" : truck[name] ?? "never";
        return [unit ? `${label} [${unit}]` : label, ...trucks.map(value)];
      }), "turned"));
  }
  return shown.length > 0;
}

function busTables(stories, place) {
  const shown = stories.filter((story) => story.summary.bus);
  for (const story of shown) {
    const { bus, v2v } = story.summary;
    if (stories.length > 1) place.append(html("h3", {}, `Run ${"AB"[story.run]}`));
    const rate = (hz) => (hz >= 1e6 ? `${hz / 1e6}M` : `${hz / 1e3}k`);
    const rates = [bus.bit_rate_hz, bus.data_bit_rate_hz].filter(Boolean).map(rate).join("/");
    place.append(html("p", {}, `${bus.backend}: ${bus.reason}. At ${rates} bit/s `,
      html("b", { class: bus.fits ? "held" : "broken" }, bus.fits ? "it fits" : "it does not fit"),
      bus.fitting_rate ? `; the slowest rate that would do is ${bus.fitting_rate}.` : ".",
      bus.overflowed ? ` ${grouped(bus.overflowed)} frames were lost in full queues.` : ""));
    place.append(html("div", { class: "loads" }, bus.load_percent.map((load, i) =>
      html("div", { class: "load" }, html("span", {}, `bus ${i}`),
        html("span", { class: "gauge", style: `--load: ${Math.min(load, 100)}%` }),
        html("b", {}, `${number(load)} %`)))));
    place.append(html("p", { class: "hint" },
      "Share of a real bus's time in the worst case; the mark is 80 %."));
    const observed = new Map((bus.observed ?? []).map((seen) => [seen.message, seen]));
    const rows = Object.entries(bus.response_us ?? {}).map(([message, bound]) => [message,
      bound === null ? "none" : duration(bound), duration(observed.get(message)?.p99_us ?? NaN),
      duration(observed.get(message)?.max_us ?? NaN)]);
    if (rows.length) {
      place.append(table(["message", "longest it can take", "seen, p99", "seen, max"], rows));
    }
    if (v2v?.delay_min_s !== undefined && v2v.delay_min_s !== null) {
      place.append(html("p", {}, `V2V: delay ${fixed(1e3 * v2v.delay_min_s, 0)} to ` +
        `${fixed(1e3 * v2v.delay_max_s, 0)} ms, ${grouped(v2v.delivered ?? 0)} messages ` +
        `delivered, ${grouped(v2v.lost ?? 0)} lost.`));
    }
  }
  return shown.length > 0;
}

function machineTables(stories, place) {
  for (const story of stories) {
    const { summary, metadata } = story;
    if (stories.length > 1) place.append(html("h3", {}, `Run ${"AB"[story.run]}`));
    if (summary.notes?.length) {
      place.append(html("ul", { class: "notes" }, summary.notes.map((note) => html("li", {}, note))));
    }
    const realtime = (summary.ecus ?? []).filter((ecu) => ecu.realtime).map((ecu) => [
      `ECU ${ecu.truck}`, ecu.realtime.policy, String(ecu.realtime.priority),
      ecu.realtime.cpus.join(", "), ecu.realtime.mlock ? "locked" : "not locked"]);
    if (realtime.length) {
      place.append(html("h3", {}, "Real-time privileges obtained"),
        table(["", "policy", "priority", "CPUs", "memory"], realtime));
    }
    const environment = summary.environment ?? metadata?.["platoon.environment"] ?? {};
    const floor = summary.machine_floor_us;
    const rows = Object.entries(environment).map(([name, value]) => [words(name), value || "–"]);
    if (floor) {
      rows.push(["wake-up alone", `p50 ${duration(floor.p50)}, p99 ${duration(floor.p99)}, ` +
        `p99.9 ${duration(floor.p999)}, max ${duration(floor.max)}`]);
    }
    const run = metadata?.["platoon.run"] ?? {};
    if (run.arguments) rows.push(["arguments", html("code", {}, run.arguments)]);
    for (const [name, file] of Object.entries(summary.files ?? {})) {
      if (file) rows.push([`file, ${name}`, html("code", {}, file)]);
    }
    place.append(table(["", ""], rows, "plain"));
  }
  return true;
}
