// The packed stories of one or two runs: a JSON head, then curves of 16-bit numbers.

const GAP = -32768;

/** Unpacks the page's data. */
async function unpack() {
  const text = $("data").textContent.trim();
  const letters = atob(text);
  const packed = new Uint8Array(letters.length);
  for (let i = 0; i < letters.length; i++) packed[i] = letters.charCodeAt(i);
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const bytes = await new Response(stream).arrayBuffer();
  const length = new DataView(bytes).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 4, length)));
  const numbers = new Int16Array(bytes, 4 + length);
  return head.stories.map((story, run) => new Story(story, numbers, run));
}

/** One curve: values over an even axis of time, gaps as not-a-number; decoded where looked at. */
class Curve {
  constructor(told, axis, numbers) {
    this.step = axis.step_s;
    this.length = axis.points;
    this.low = told.low;
    this.scale = (told.high - told.low) / 65534;
    this.numbers = numbers.subarray(told.at, told.at + axis.points);
    this.isZero = told.low === 0 && told.high === 0;
  }

  /** The value of a point. */
  value(point) {
    const packed = this.numbers[point];
    return packed === GAP ? NaN : this.low + (packed + 32767) * this.scale;
  }

  /** Calls a function with every value and its time, gaps left out. */
  each(look) {
    for (let point = 0; point < this.length; point++) {
      const value = this.value(point);
      if (!Number.isNaN(value)) look(value, point * this.step);
    }
  }

  /** The value at a time, between its neighbours; not a number in a gap. */
  at(time) {
    const place = time / this.step;
    const before = Math.min(Math.max(Math.floor(place), 0), this.length - 1);
    const after = Math.min(before + 1, this.length - 1);
    const share = Math.min(Math.max(place - before, 0), 1);
    const [low, high] = [this.value(before), this.value(after)];
    return Number.isNaN(high) || share === 0 ? low : low + share * (high - low);
  }

  /** The point nearest to a time, as it was recorded. */
  sample(time) {
    const place = Math.round(time / this.step);
    return this.value(Math.min(Math.max(place, 0), this.length - 1));
  }
}

/** What is told of one run. */
class Story {
  constructor(told, numbers, run) {
    Object.assign(this, told);
    this.run = run;
    this.summary = told.summary ?? {};
    this.curves = new Map();
    for (const axis of [told.world, told.ecus, told.buses]) {
      for (const curve of axis?.curves ?? []) {
        const key = `${curve.of} ${curve.index} ${curve.name}`;
        this.curves.set(key, new Curve(curve, axis, numbers));
      }
    }
    this.end = told.end_s || this.summary.duration_s || 1;
    const run_of = told.metadata?.["platoon.run"] ?? {};
    this.rate = this.summary.rate_hz ?? Number(run_of.rate_hz ?? 100);
    this.title = this.summary.scenario ?? run_of.scenario ?? "run";
    this.isVirtual = (run_of.time ?? this.summary.timing_verdict) === "virtual";
  }

  /** A curve of a truck; undefined when the run has none. */
  truck(index, name) {
    return this.curves.get(`truck ${index} ${name}`);
  }

  obstacle(index, name) {
    return this.curves.get(`obstacle ${index} ${name}`);
  }

  /** What the trucks are called. */
  called(index) {
    return index === 0 ? "leader" : `truck ${index}`;
  }

  /** Everything on the road at a time: boxes with their centre, heading and looks. */
  boxes(time) {
    const trucks = this.trucks.map((box, index) => {
      const at = (name) => this.truck(index, name)?.at(time) ?? NaN;
      const heading = at("heading_rad");
      return {
        truck: index, x: at("x_m"), y: at("y_m"), heading,
        front: box.front_m, rear: box.rear_m, width: box.width_m,
        speed: at("speed_mps"), force: at("force_command_n"),
      };
    });
    const obstacles = this.obstacles.map((box, index) => {
      const at = (name) => this.obstacle(index, name)?.at(time) ?? NaN;
      return {
        obstacle: box.number, kind: box.kind, x: at("x_m"), y: at("y_m"),
        heading: at("heading_rad"), front: box.length_m / 2, rear: box.length_m / 2,
        width: box.width_m,
      };
    });
    return [...trucks, ...obstacles].filter((box) => Number.isFinite(box.x + box.y));
  }

  /** Edges and lane lines of the road across it [m]. */
  road() {
    const road = this.scenario?.road ?? {};
    const right = road.right_edge_y_m ?? -1.875;
    const left = road.left_edge_y_m ?? 5.625;
    const lane = road.lane_width_m ?? 3.75;
    const lines = [];
    for (let y = right + lane; y < left - 0.1; y += lane) lines.push(y);
    return { right, left, lines };
  }

  /** The time at which a truck came closest to an obstacle, or was furthest from its place. */
  criticalTime() {
    let best = { time: 0, value: Infinity };
    this.trucks.forEach((_, index) => {
      this.truck(index, "obstacle_clearance_m")?.each((value, time) => {
        if (value < best.value) best = { time, value };
      });
    });
    if (best.value < 50) return best.time;
    let worst = { time: 0, value: 0 };
    this.trucks.forEach((_, index) => {
      this.truck(index, "predecessor_error_m")?.each((value, time) => {
        if (Math.abs(value) > worst.value) worst = { time, value: Math.abs(value) };
      });
    });
    return worst.time;
  }

  /** From when until when trucks are out of their lanes; the whole run when they never are. */
  eventful() {
    let [from, to] = [Infinity, -Infinity];
    this.trucks.forEach((_, index) => {
      const curve = this.truck(index, "y_m");
      if (!curve) return;
      const home = curve.value(0);
      curve.each((value, time) => {
        if (Math.abs(value - home) > 0.6) {
          from = Math.min(from, time);
          to = Math.max(to, time);
        }
      });
    });
    return from < to ? [Math.max(from - 2, 0), Math.min(to + 2, this.end)] : [0, this.end];
  }
}
