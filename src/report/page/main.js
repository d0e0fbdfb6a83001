// Puts the page together.

function keys(event) {
  const isTyping = event.target.closest("select, dialog, input:not([type=range])");
  if (isTyping || event.ctrlKey || event.metaKey || event.altKey) return;
  const onButton = event.target.closest("button, a");
  const actions = {
    ArrowLeft: () => Clock.step(event.shiftKey ? -1 : -0.1),
    ArrowRight: () => Clock.step(event.shiftKey ? 1 : 0.1),
    ",": () => Clock.step(-1 / Clock.rate()),
    ".": () => Clock.step(1 / Clock.rate()),
    Home: () => Clock.seek(0),
    End: () => Clock.seek(Clock.end()),
    "+": () => Plots.zoom(0.5),
    "=": () => Plots.zoom(0.5),
    "-": () => Plots.zoom(2),
    z: () => Plots.show(null),
    l: copyLink,
    d: Theme.toggle,
    "?": () => $("keys").showModal(),
  };
  if (event.key === " " && !onButton) actions[" "] = Clock.toggle;
  if (/^[0-9]$/.test(event.key)) actions[event.key] = () => chip(Number(event.key));
  const action = actions[event.key];
  if (!action) return;
  event.preventDefault();
  action();
}

async function copyLink() {
  const button = $("link");
  try {
    await navigator.clipboard.writeText(Clock.link());
    button.textContent = "copied";
  } catch {
    location.hash = `t=${Clock.time().toFixed(3)}`;
    button.textContent = "in address";
  }
  setTimeout(() => { button.textContent = "link"; }, 1200);
}

function chip(truck) {
  const button = document.querySelector(`#trucks button[data-truck="${truck}"]`);
  if (button) button.setAttribute("aria-pressed", String(Plots.toggle(truck)));
}

function chips(stories) {
  const count = Math.max(...stories.map((story) => story.trucks.length));
  $("trucks").append(...Array.from({ length: count }, (_, truck) => html("button", {
    type: "button", class: "own", "data-truck": truck, "aria-pressed": "true",
    style: `--own: var(--truck${truck % 8})`, click: () => chip(truck),
  }, stories[0].called(truck))));
  if (stories.length > 1) {
    $("trucks").append(html("span", { class: "hint" }, "solid: A, dashed: B"));
  }
}

/** Late ticks and the still's instants as marks on the time line. */
function marks(stories) {
  const place = $("marks");
  for (const event of stories[0].events) {
    const left = `left: ${(100 * event.time_s) / Clock.end()}%`;
    place.append(html("i", { class: event.missed ? "late" : "passed", style: left }));
  }
}

function footer(stories) {
  const steps = stories.flatMap((story) => [story.world, story.ecus]).filter(Boolean)
    .map((axis) => 2000 * axis.step_s);
  const kept = steps.length ? `Curves keep the least and the largest value of every ` +
    `${number(Math.max(...steps))} ms. ` : "";
  document.querySelector("footer").append(
    html("p", {}, `platoon ${stories[0].version}. ${kept}Everything is in this file; it needs no ` +
      "network."),
    html("details", {}, html("summary", {}, "Curves are drawn by uPlot, MIT licence"),
      html("pre", {}, $("licence").textContent)));
}

/** Has a section filled, or taken away when there is nothing to show. */
function section(id, fill) {
  const place = $(id).querySelector(".body");
  Later.fill(place, () => {
    if (!fill(place)) $(id).remove();
  });
}

function controls() {
  $("play").addEventListener("click", Clock.toggle);
  $("speed").addEventListener("change", (event) => Clock.speed(Number(event.target.value)));
  $("link").addEventListener("click", copyLink);
  $("theme").addEventListener("click", Theme.toggle);
  $("help").addEventListener("click", () => $("keys").showModal());
  $("zoom-in").addEventListener("click", () => Plots.zoom(0.5));
  $("zoom-out").addEventListener("click", () => Plots.zoom(2));
  $("zoom-all").addEventListener("click", () => Plots.show(null));
  addEventListener("keydown", keys);
  for (const [name, on] of [["beforeprint", true], ["afterprint", false]]) {
    addEventListener(name, () => {
      Later.all();
      Theme.print(on);
      Plots.print(on);
    });
  }
}

async function main() {
  const stories = await unpack();
  const isPair = stories.length > 1;
  document.title = stories.map((story) => words(story.title)).join(" / ") + " · platoon";
  Theme.apply();
  $("verdict").append(...stories.map((story) => headline(story, isPair)));
  $("verdict").classList.toggle("pair", isPair);
  const moving = stories.filter((story) => story.trucks.length > 0);
  const roads = moving.map((story) => new Road(story, $("roads"), isPair));
  moving.forEach((story) => $("still").append(still(story)));
  if (moving.length === 0) $("movement").remove();
  chips(stories);
  const draw = (time) => roads.forEach((road) => road.draw(time));
  Clock.changed(draw);
  Theme.changed(() => draw(Clock.time()));
  Clock.start(stories, moving[0]?.criticalTime() ?? 0);
  Plots.draw(stories);
  if (Plots.all().length === 0) $("signals").remove();
  marks(stories);
  section("criteria", (place) => criteria(stories, place));
  section("latency", (place) => LatencyView.draw(stories, place));
  section("misses", (place) => misses(stories, place));
  section("trucks-table", (place) => truckTables(stories, place));
  section("bus", (place) => busTables(stories, place));
  section("machine", (place) => machineTables(stories, place));
  footer(stories);
  controls();
  // For tests and the curious: when what is in sight was on the screen, and when all was made.
  const say = (what) => () => { document.body.dataset[what] = performance.now().toFixed(0); };
  Later.begin(say("drawnMs"), say("completeMs"));
}

main().catch((error) => {
  document.body.prepend(html("p", { class: "warning" },
    `This page cannot show its run: ${error.message}. It needs a browser of 2023 or later.`));
  console.error(error);
});
