// The instant that everything on the page shows; it plays, and stands in the page's address.

const Clock = (() => {
  const listeners = [];
  let [time, end, rate] = [0, 1, 100];
  let [playing, speed, last] = [false, 1, 0];
  let saying = 0;

  const clamp = (value) => Math.min(Math.max(value, 0), end);

  function seek(to) {
    time = clamp(to);
    listeners.forEach((listener) => listener(time));
    // Browsers refuse an address that changes too often.
    clearTimeout(saying);
    if (!playing) saying = setTimeout(say, 200);
  }

  function say() {
    try {
      history.replaceState(null, "", `#t=${time.toFixed(3).replace(/\.?0+$/, "")}`);
    } catch {
      // The address of the page stays as it is.
    }
  }

  /** The time an address names: #t=49.2 in seconds, or #tick=49200. */
  function told() {
    const asked = new URLSearchParams(location.hash.slice(1));
    const [seconds, tick] = [asked.get("t"), asked.get("tick")].map((text) => parseFloat(text));
    return Number.isFinite(seconds) ? seconds : tick / rate;
  }

  function frame(now) {
    if (!playing) return;
    seek(time + (speed * Math.min(now - last, 100)) / 1000);
    last = now;
    if (time >= end) play(false);
    else requestAnimationFrame(frame);
  }

  function play(on) {
    playing = on;
    $("play").classList.toggle("playing", on);
    $("play").setAttribute("aria-label", on ? "Pause" : "Play");
    if (!on) return seek(time);
    if (time >= end) time = 0;
    last = performance.now();
    requestAnimationFrame(frame);
  }

  /** Shows what a link of this page names. */
  function follow() {
    const wanted = told();
    if (Number.isFinite(wanted)) seek(wanted);
  }

  return {
    seek,
    play,
    toggle: () => play(!playing),
    step: (by) => seek(time + by),
    speed: (factor) => { speed = factor; },
    changed: (listener) => listeners.push(listener),
    time: () => time,
    end: () => end,
    rate: () => rate,
    link: () => `${location.href.split("#")[0]}#t=${time.toFixed(3)}`,
    start(stories, first) {
      end = Math.max(...stories.map((story) => story.end));
      rate = stories[0].rate;
      const scrub = $("scrub");
      scrub.max = end;
      scrub.addEventListener("input", () => seek(Number(scrub.value)));
      listeners.push((now) => {
        scrub.value = now;
        scrub.setAttribute("aria-valuetext", `${now.toFixed(2)} seconds`);
        scrub.style.setProperty("--share", now / end);
        $("now").textContent = `${fixed(now, 2)} s`;
      });
      addEventListener("hashchange", follow);
      const wanted = told();
      seek(Number.isFinite(wanted) ? wanted : first);
    },
  };
})();
