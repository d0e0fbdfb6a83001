// Curves over time, zoomed together, each with the cursor of the clock. A plot is drawn when it
// comes into sight or when there is time, so that opening the page does not wait for all of them.

/** The plots: name of the curve, title, unit, what a recorded value is multiplied by. */
const PLOTS = [
  { name: "predecessor_error_m", title: "Position error to the truck ahead", unit: "m",
    followers: true, zero: true },
  { name: "leader_error_m", title: "Position error to the leader", unit: "m", followers: true,
    zero: true },
  { name: "speed_mps", title: "Velocity", unit: "m/s", digits: 2 },
  { name: "y_m", title: "Lateral position", unit: "m", digits: 2 },
  { name: "force_command_n", title: "Longitudinal force, commanded", unit: "kN", factor: 1e-3,
    zero: true },
  { name: "steering_command_rad", title: "Steering angle, commanded", unit: "mrad", factor: 1e3,
    digits: 1, zero: true },
  { name: "adaptive_weight", title: "Weight of the reference speed, Q_ref", unit: "",
    digits: 1 },
  { name: "potential", title: "Value of the potential field", unit: "", digits: 0 },
  { name: "predecessor_delay_s", title: "V2V delay from the truck ahead", unit: "ms",
    factor: 1e3, digits: 0, followers: true },
  { name: "leader_delay_s", title: "V2V delay from the leader", unit: "ms", factor: 1e3,
    digits: 0, followers: true },
  { name: "obstacle_clearance_m", title: "Clearance to the nearest obstacle", unit: "m",
    most: 60, least: 0 },
  { name: "accel_mps2", title: "Acceleration", unit: "m/s²", digits: 2, zero: true },
  { name: "total_us", title: "Time from due to sent", unit: "µs", digits: 0, log: true,
    real: true },
  { name: "bus_load_percent", title: "Bus load, in windows of 100 ms", unit: "%", digits: 1,
    least: 0 },
  { name: "qp_iterations", title: "Iterations of the QP", unit: "", digits: 0, least: 0 },
];

/** Width of a plot on paper. */
const PRINTED_PX = 340;

const Plots = (() => {
  const all = [];
  const hidden = new Set();
  let range = null;
  let shown = null;
  let pointed = null;
  let printing = false;

  const height = () => (printing ? 150 : innerWidth < 640 ? 170 : 200);

  /** The curves of a plot: one per run and truck that it has something of. */
  function linesOf(plot, stories) {
    return stories.flatMap((story) => {
      const count = Math.max(story.trucks.length, story.summary.trucks?.length ?? 0);
      return Array.from({ length: count }, (_, truck) => truck)
        .filter((truck) => !(plot.followers && truck === 0))
        .map((truck) => ({ story, truck, curve: story.truck(truck, plot.name) }))
        .filter((line) => line.curve && !line.curve.isZero);
    });
  }

  /** Times and values of curves over one axis that is as fine as the finest of the runs. */
  function data(plot, lines) {
    const step = Math.min(...lines.map((line) => line.curve.step));
    const span = Math.max(...lines.map((line) => line.curve.step * line.curve.length));
    const times = Float64Array.from({ length: Math.round(span / step) }, (_, i) => i * step);
    return [times, ...lines.map(({ curve }) => heights(plot, curve, step, times.length))];
  }

  /** A curve's values over an axis, null in its gaps. */
  function heights(plot, curve, step, count) {
    const [factor, stride] = [plot.factor ?? 1, step / curve.step];
    const values = new Array(count).fill(null);
    for (let i = 0; i < count; i++) {
      const value = curve.value(stride === 1 ? i : Math.floor(i * stride + 1e-6));
      if (!Number.isNaN(value) && !(plot.log && value <= 0)) values[i] = value * factor;
    }
    return values;
  }

  function scaleOf(plot) {
    if (plot.log) return { distr: 3, log: 10 };
    return {
      range: (_, low, high) => {
        if (low === null) return [0, 1];
        const margin = 0.06 * (high - low) || 0.5;
        return [
          Math.max(low - margin, plot.least ?? -Infinity),
          Math.min(high + margin, plot.most ?? Infinity),
        ];
      },
    };
  }

  function options(drawn) {
    const { plot, lines, body } = drawn;
    const axis = {
      stroke: () => Theme.colour("--faint"),
      grid: { stroke: () => Theme.colour("--grid"), width: 1 },
      ticks: { show: false },
      font: "11px system-ui, sans-serif",
    };
    const series = lines.map(({ story, truck }) => ({
      label: `${story.name} ${truck}`,
      stroke: () => Theme.truck(truck),
      width: story.run === 0 ? 1.6 : 1.3,
      dash: story.run === 0 ? undefined : [5, 4],
      points: { show: false },
      show: !hidden.has(truck),
      spanGaps: false,
    }));
    return {
      width: printing ? PRINTED_PX : Math.max(body.clientWidth, 200),
      height: height(),
      legend: { show: false },
      scales: { x: { time: false, min: range[0], max: range[1] }, y: scaleOf(plot) },
      axes: [
        { ...axis, size: 26, space: 60, values: (_, ticks) => ticks.map((t) => number(t, 6)) },
        { ...axis, size: 50, gap: 4, space: 30,
          values: (_, ticks) => ticks.map((t) => (t === null ? "" : number(t))) },
      ],
      series: [{}, ...series],
      cursor: {
        sync: { key: "run", setSeries: false },
        drag: { x: true, y: false, dist: 6 },
        points: { size: 6, width: 1.5 },
        y: false,
      },
      hooks: {
        setScale: [(u, key) => key === "x" && zoomed(u)],
        setCursor: [(u) => point(u)],
        drawClear: [(u) => zero(u, plot)],
        draw: [() => putCursor(drawn, Clock.time())],
      },
    };
  }

  /** A line at zero, where its sign is what matters. */
  function zero(u, plot) {
    if (!plot.zero) return;
    const y = u.valToPos(0, "y", true);
    const { left, top, width, height: tall } = u.bbox;
    if (y < top || y > top + tall) return;
    u.ctx.save();
    u.ctx.strokeStyle = Theme.colour("--rule");
    u.ctx.lineWidth = devicePixelRatio;
    u.ctx.beginPath();
    u.ctx.moveTo(left, y);
    u.ctx.lineTo(left + width, y);
    u.ctx.stroke();
    u.ctx.restore();
  }

  /** Every other plot shows the span of time that one was zoomed to. */
  function zoomed(u) {
    const { min, max } = u.scales.x;
    if (min !== range[0] || max !== range[1]) show([min, max]);
  }

  function show(span) {
    const whole = [0, Clock.end()];
    range = span ? [Math.max(span[0], 0), Math.min(span[1], whole[1])] : whole;
    made().forEach(({ u }) => u.setScale("x", { min: range[0], max: range[1] }));
  }

  /** Zooms by a factor about the clock's instant, or the middle when that is not in sight. */
  function zoom(factor, about = null) {
    const [from, to] = range;
    const now = about ?? Clock.time();
    const centre = now >= from && now <= to ? now : (from + to) / 2;
    const least = 4 / Clock.rate();
    const width = Math.min(Math.max((to - from) * factor, least), Clock.end());
    const start = centre - ((centre - from) / (to - from)) * width;
    const begin = Math.min(Math.max(start, 0), Clock.end() - width);
    show([begin, begin + width]);
  }

  function point(u) {
    const inside = u.cursor.left >= 0;
    const time = inside ? u.posToVal(u.cursor.left, "x") : null;
    if (time === pointed) return;
    pointed = time;
    requestAnimationFrame(read);
  }

  /** Writes the values at the pointer, or at the clock's instant when it points nowhere. */
  function read() {
    const time = pointed ?? Clock.time();
    if (time === shown) return;
    shown = time;
    for (const { plot, readouts } of all) {
      for (const { line, value } of readouts) {
        const recorded = line.curve.sample(time) * (plot.factor ?? 1);
        value.textContent = fixed(recorded, plot.digits ?? 2);
      }
    }
  }

  /** Puts every plot's cursor at a time. */
  function mark(time) {
    made().forEach((drawn) => putCursor(drawn, time));
    read();
  }

  function putCursor({ u, cursor }, time) {
    const x = u.valToPos(time, "x");
    // Asking the element how wide it is would have the page laid out anew for every plot.
    const inside = x >= 0 && x <= u.bbox.width / devicePixelRatio;
    cursor.style.visibility = inside ? "visible" : "hidden";
    cursor.style.transform = `translateX(${x}px)`;
  }

  /** Click: go there. Two fingers: zoom there. */
  function listen(u) {
    const fingers = new Map();
    let [down, apart] = [null, null];
    const timeAt = (event) => u.posToVal(event.clientX - u.over.getBoundingClientRect().left, "x");
    u.over.addEventListener("pointerdown", (event) => {
      fingers.set(event.pointerId, event.clientX);
      down = event.clientX;
    });
    u.over.addEventListener("pointermove", (event) => {
      if (!fingers.has(event.pointerId)) return;
      fingers.set(event.pointerId, event.clientX);
      if (fingers.size !== 2) return;
      const [a, b] = fingers.values();
      const now = Math.max(Math.abs(a - b), 10);
      if (apart) zoom(apart / now, timeAt({ clientX: (a + b) / 2 }));
      apart = now;
    });
    for (const name of ["pointerup", "pointercancel", "pointerleave"]) {
      u.over.addEventListener(name, (event) => {
        fingers.delete(event.pointerId);
        if (fingers.size < 2) apart = null;
      });
    }
    u.over.addEventListener("click", (event) => {
      if (down !== null && Math.abs(event.clientX - down) < 4) Clock.seek(timeAt(event));
    });
    u.over.addEventListener("dblclick", () => show(null));
  }

  function readout(line, isPair) {
    const value = html("b", {}, "–");
    const label = (line.truck === 0 ? "L" : String(line.truck)) +
      (isPair ? (line.story.run === 0 ? "ᵃ" : "ᵇ") : "");
    const colour = `--own: var(--truck${line.truck % 8})`;
    return { line, value, element: html("span", { style: colour }, label, " ", value) };
  }

  /** The place of a plot, as high as it will be. */
  function frame(plot, stories, place) {
    if (plot.real && stories.every((story) => story.isVirtual)) return;
    const lines = linesOf(plot, stories);
    if (lines.length === 0) return;
    const readouts = lines.map((line) => readout(line, stories.length > 1));
    const body = html("div", { class: "curves", style: `min-height: ${height()}px` });
    const figure = html("figure", { id: `plot-${plot.name}`, "data-curves": lines.length },
      html("figcaption", {},
        html("h3", {}, plot.title, plot.unit ? html("span", { class: "unit" }, plot.unit) : ""),
        html("div", { class: "readouts" }, readouts.map(({ element }) => element))),
      body);
    place.append(figure);
    const drawn = { plot, lines, readouts, body, u: null, cursor: html("div", { class: "cursor" }) };
    all.push(drawn);
    Later.fill(body, () => make(drawn));
  }

  function make(drawn) {
    const { plot, lines, body, cursor } = drawn;
    drawn.u = new uPlot(options(drawn), data(plot, lines), body);
    drawn.u.over.append(cursor);
    body.style.minHeight = "";
    listen(drawn.u);
  }

  const made = () => all.filter(({ u }) => u !== null);

  function resize() {
    for (const { u, body } of made()) {
      const width = printing ? PRINTED_PX : body.clientWidth;
      if (width > 0 && (u.width !== width || u.height !== height())) {
        u.setSize({ width, height: height() });
      }
    }
  }

  return {
    draw(stories) {
      show(null);
      PLOTS.forEach((plot) => frame(plot, stories, $("plots")));
      read();
      Clock.changed(mark);
      Theme.changed(() => made().forEach(({ u }) => u.redraw(false)));
      new ResizeObserver(resize).observe($("plots"));
      $("plots").addEventListener("mouseleave", () => {
        pointed = null;
        read();
      });
    },
    show,
    zoom,
    print(on) {
      printing = on;
      resize();
    },
    /** Shows or hides a truck in every plot. */
    toggle(truck) {
      const hide = !hidden.has(truck);
      if (hide) hidden.add(truck);
      else hidden.delete(truck);
      for (const { u, lines } of made()) {
        lines.forEach((line, i) => line.truck === truck && u.setSeries(i + 1, { show: !hide }));
      }
      return !hide;
    },
    all: () => all,
  };
})();
