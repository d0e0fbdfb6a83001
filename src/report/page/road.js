// The road from above: moving with the clock, and as a still at a few instants.

/** Metres of road shown ahead of the leader and behind the last truck. */
const AHEAD_M = 45;
const BEHIND_M = 32;
/** Metres of road around one truck, when it is followed. */
const CLOSE_M = 110;
/** How many seconds of path stay visible behind a truck. */
const TRAIL_S = 5;
/** Force below which brake lights shine [N]. */
const BRAKING_N = -1500;
/** Instants of the still. */
const STILLS = 7;

/** One run's road as a canvas. */
class Road {
  constructor(story, place, isPair) {
    this.story = story;
    this.focus = null;
    this.canvas = html("canvas", {
      role: "img",
      "aria-label": `The platoon from above, ${story.title}; values are in the plots below`,
    });
    const buttons = [html("button", { type: "button", "aria-pressed": "true",
      click: () => this.follow(null) }, "whole platoon")];
    story.trucks.forEach((_, truck) => buttons.push(html("button", {
      type: "button", "aria-pressed": "false", style: `--own: var(--truck${truck % 8})`,
      class: "own", click: () => this.follow(truck),
    }, truck === 0 ? "leader" : String(truck))));
    this.buttons = buttons;
    place.append(html("div", { class: "road" },
      html("div", { class: "tools" },
        isPair ? html("h3", {}, "AB"[story.run], " ", html("small", {}, story.name)) : "",
        html("div", { role: "group", "aria-label": "Follow" }, buttons)),
      this.canvas));
    new ResizeObserver(() => this.draw(Clock.time())).observe(this.canvas);
  }

  follow(truck) {
    this.focus = truck;
    this.buttons.forEach((button, i) =>
      button.setAttribute("aria-pressed", String(i === (truck === null ? 0 : truck + 1))));
    this.draw(Clock.time());
  }

  /** What part of the road is in sight [m]. */
  view(boxes) {
    const trucks = boxes.filter((box) => box.truck !== undefined);
    const chosen = trucks.find((box) => box.truck === this.focus);
    if (chosen) return [chosen.x - CLOSE_M / 2, chosen.x + CLOSE_M / 2];
    const places = trucks.map((box) => box.x);
    if (places.length === 0) return [-50, 50];
    return [Math.min(...places) - BEHIND_M, Math.max(...places) + AHEAD_M];
  }

  draw(time) {
    const { canvas, story } = this;
    const width = canvas.clientWidth;
    if (width === 0) return;
    const boxes = story.boxes(time);
    const [from, to] = this.view(boxes);
    const road = story.road();
    const along = width / (to - from);
    // Lanes stay wide enough to tell vehicles apart; a followed truck is seen to scale.
    const across = Math.max(along, 8);
    const [above, below] = [40, 34];
    const height = Math.round((road.left - road.right) * across + above + below);
    const ratio = devicePixelRatio || 1;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
      canvas.style.height = `${height}px`;
    }
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    const scene = {
      pen, width, height, along, across, from, to,
      x: (x) => (x - from) * along,
      y: (y) => above + (road.left - y) * across,
    };
    this.paintRoad(scene, road);
    this.paintTrails(scene, time);
    this.paintGaps(scene, boxes);
    boxes.forEach((box) => this.paintBox(scene, box));
    boxes.forEach((box) => this.paintLabel(scene, box, boxes, road));
  }

  paintRoad({ pen, width, x, y, from, to, along }, road) {
    pen.fillStyle = Theme.colour("--asphalt");
    pen.fillRect(0, y(road.left), width, y(road.right) - y(road.left));
    pen.strokeStyle = Theme.colour("--marking");
    pen.lineWidth = 2;
    for (const edge of [road.left - 0.25, road.right + 0.25]) {
      pen.beginPath();
      pen.moveTo(0, y(edge));
      pen.lineTo(width, y(edge));
      pen.stroke();
    }
    for (const line of road.lines) {
      for (let at = Math.floor(from / 12) * 12; at < to; at += 12) {
        pen.fillStyle = Theme.colour("--marking");
        pen.fillRect(x(at), y(line) - 1, 4.5 * along, 2);
      }
    }
    const every = along > 2.5 ? 20 : along > 1 ? 50 : 100;
    pen.fillStyle = Theme.colour("--faint");
    pen.font = "11px system-ui, sans-serif";
    pen.textAlign = "center";
    for (let at = Math.ceil(from / every) * every; at < to; at += every) {
      pen.fillRect(x(at), y(road.right) + 4, 1, 5);
      if (x(at) > 20 && x(at) < width - 24) pen.fillText(`${at} m`, x(at), y(road.right) + 22);
    }
  }

  paintTrails({ pen, x, y }, time) {
    this.story.trucks.forEach((_, truck) => {
      const [xs, ys] = ["x_m", "y_m"].map((name) => this.story.truck(truck, name));
      if (!xs || !ys) return;
      pen.strokeStyle = Theme.truck(truck);
      pen.lineWidth = 2;
      pen.globalAlpha = 0.35;
      pen.beginPath();
      for (let ago = 0; ago <= TRAIL_S; ago += 0.1) {
        const at = Math.max(time - ago, 0);
        pen.lineTo(x(xs.at(at)), y(ys.at(at)));
      }
      pen.stroke();
      pen.globalAlpha = 1;
    });
  }

  /** The free space between neighbours, where there is room to say it. */
  paintGaps({ pen, x, y, along }, boxes) {
    const inOrder = boxes.filter((box) => box.truck !== undefined).sort((a, b) => b.x - a.x);
    pen.font = "11px system-ui, sans-serif";
    pen.textAlign = "center";
    pen.fillStyle = Theme.colour("--onroad");
    for (let i = 1; i < inOrder.length; i++) {
      const [ahead, behind] = [inOrder[i - 1], inOrder[i]];
      const gap = ahead.x - ahead.rear - behind.x - behind.front;
      if (Math.abs(ahead.y - behind.y) > 1.5 || gap * along < 54) continue;
      const middle = (ahead.x - ahead.rear + behind.x + behind.front) / 2;
      pen.fillText(`${fixed(gap, 1)} m`, x(middle), y((ahead.y + behind.y) / 2) + 4);
    }
  }

  paintBox({ pen, x, y, along, across }, box) {
    const isTruck = box.truck !== undefined;
    const [front, rear] = [box.front * along, box.rear * along];
    const half = (box.width * across) / 2;
    pen.save();
    pen.translate(x(box.x), y(box.y));
    // With unequal scales a heading is drawn as steep as the path is.
    pen.rotate(-Math.atan2(Math.sin(box.heading) * across, Math.cos(box.heading) * along));
    if (isTruck) {
      pen.fillStyle = Theme.truck(box.truck);
      const cab = Math.min(2.2 * along, (front + rear) / 3);
      rounded(pen, -rear, -half, front + rear - cab - 1, 2 * half, 2);
      pen.globalAlpha = 0.72;
      rounded(pen, front - cab, -half * 0.94, cab, 1.88 * half, Math.min(4, half));
      pen.globalAlpha = 1;
      if (box.force < BRAKING_N) {
        pen.fillStyle = Theme.colour("--brake");
        pen.fillRect(-rear - 3, -half, 3, half * 0.7);
        pen.fillRect(-rear - 3, half * 0.3, 3, half * 0.7);
      }
    } else {
      pen.fillStyle = Theme.colour(box.kind === "bump" ? "--bump" : "--obstacle");
      rounded(pen, -rear, -half, Math.max(front + rear, 3), 2 * half, box.kind === "bump" ? 1 : 4);
    }
    pen.restore();
  }

  paintLabel({ pen, x, y, width, along }, box, boxes, road) {
    pen.font = "600 12px system-ui, sans-serif";
    pen.textAlign = "center";
    const isTruck = box.truck !== undefined;
    pen.fillStyle = isTruck ? Theme.truck(box.truck) : Theme.colour("--obstacle-ink");
    const name = isTruck ? (box.truck === 0 ? "L" : String(box.truck)) : `obstacle ${box.obstacle}`;
    const at = x(box.x + (box.front - box.rear) / 2);
    if (at < -40 || at > width + 40) return;
    if (!isTruck) {
      pen.font = "11px system-ui, sans-serif";
      const isFree = isFreeAhead(box, boxes, 80 / along);
      pen.textAlign = isFree ? "left" : "right";
      const side = isFree ? box.x + box.front : box.x - box.rear;
      return pen.fillText(name, x(side) + (isFree ? 5 : -5), y(box.y) + 4);
    }
    // Names stand above the road, so that they never hide a vehicle.
    pen.fillText(name, at, y(road.left) - 20);
    pen.font = "11px system-ui, sans-serif";
    if (width > 560 || this.focus !== null) {
      pen.fillText(`${fixed(box.speed, 1)} m/s`, at, y(road.left) - 6);
    }
  }
}

/** Whether nothing is in a box's lane for some metres ahead of it. */
function isFreeAhead(box, boxes, metres) {
  return !boxes.some((other) => other !== box && Math.abs(other.y - box.y) < 2.2 &&
    other.x - other.rear < box.x + box.front + metres && other.x > box.x);
}

function rounded(pen, x, y, width, height, radius) {
  pen.beginPath();
  if (pen.roundRect) pen.roundRect(x, y, width, height, radius);
  else pen.rect(x, y, width, height);
  pen.fill();
}

/** The instants of the still: even over the manoeuvre, one of them the critical one. */
function stillTimes(story) {
  const [from, to] = story.eventful();
  const times = Array.from({ length: STILLS }, (_, i) => from + ((to - from) * i) / (STILLS - 1));
  const critical = story.criticalTime();
  const nearest = times.reduce((best, time, i) =>
    Math.abs(time - critical) < Math.abs(times[best] - critical) ? i : best, 0);
  times[nearest] = critical;
  return times;
}

/** The still: a strip of road per instant, all drawn from the leader. */
function still(story) {
  const times = stillTimes(story);
  const moments = times.map((time) => ({ time, boxes: story.boxes(time) }));
  const road = story.road();
  const relative = (moment) => {
    const leader = moment.boxes.find((box) => box.truck === 0);
    return moment.boxes.map((box) => ({ ...box, x: box.x - (leader?.x ?? 0) }));
  };
  const places = moments.flatMap((moment) =>
    relative(moment).filter((box) => box.truck !== undefined).map((box) => box.x));
  const [from, to] = [Math.min(...places) - 14, Math.max(...places, 0) + 24];
  // On a phone the picture has fewer units, so that its words and lanes stay large enough.
  const wide = innerWidth < 640 ? 460 : 1000;
  const [strip, gap, top, unit] = [34, 9, 4, wide / (to - from)];
  const across = strip / (road.left - road.right);
  const rows = moments.map((moment, row) => {
    const y = top + row * (strip + gap);
    const height = (at) => y + (road.left - at) * across;
    const boxes = relative(moment);
    const vehicles = boxes
      .filter((box) => box.x + box.front > from && box.x - box.rear < to)
      .map((box) => {
        const isTruck = box.truck !== undefined;
        const isFree = isFreeAhead(box, boxes, 80 / unit) &&
          (box.x + box.front - from) * unit < wide - 66;
        const colour = isTruck ? `var(--truck${box.truck % 8})` : "var(--obstacle)";
        const left = (box.x - box.rear - from) * unit;
        const long = (box.front + box.rear) * unit;
        const centre = `${left + long / 2} ${height(box.y)}`;
        const slope = Math.atan2(Math.sin(box.heading) * across, Math.cos(box.heading) * unit);
        return [
          svg("rect", { x: left, y: height(box.y + box.width / 2), width: Math.max(long, 3),
            height: box.width * across, rx: 2, style: `fill: ${colour}`,
            transform: `rotate(${(-slope * 180) / Math.PI} ${centre})` }),
          isTruck ? svg("text", { x: left - 5, y: height(box.y) + 4.5, class: "who",
            style: `fill: ${colour}` }, box.truck === 0 ? "L" : String(box.truck)) :
            svg("text", { x: isFree ? left + long + 4 : left - 4, y: height(box.y) + 4,
              class: isFree ? "what" : "what before" }, `obstacle ${box.obstacle}`),
        ];
      });
    return svg("g", { class: "strip", click: () => Clock.seek(moment.time) },
      svg("title", {}, `Go to ${fixed(moment.time, 1)} s`),
      svg("rect", { x: 0, y, width: wide, height: strip, rx: 3, class: "asphalt" }),
      road.lines.map((line) => svg("line", { x1: 0, x2: wide, y1: height(line), y2: height(line),
        class: "marking" })),
      vehicles,
      svg("text", { x: -8, y: y + strip / 2 + 5, class: "when" }, `${fixed(moment.time, 0)} s`));
  });
  const bottom = top + times.length * (strip + gap);
  const every = to - from > 300 || wide < 1000 ? 100 : to - from > 120 ? 50 : 20;
  const ticks = [];
  for (let at = Math.ceil(from / every) * every; at <= to; at += every) {
    ticks.push(svg("text", { x: (at - from) * unit, y: bottom + 12, class: "place" },
      at === 0 ? "leader" : `${String(at).replace("-", "−")} m`));
  }
  return html("figure", { class: "still" },
    svg("svg", { viewBox: `-62 0 ${wide + 66} ${bottom + 20}`, role: "img",
      "aria-label": "The platoon at some instants, seen from above" }, rows, ticks),
    html("figcaption", {}, "The road from above at some instants, seen from the leader, driving " +
      "to the right; lanes are drawn wider than they are. Click one to go there."));
}
