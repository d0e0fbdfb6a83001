// What is out of sight is made when it comes near, or when the browser has nothing else to do.

const Later = (() => {
  /** What is still to be made, by the element that it fills, in the order of asking. */
  const waiting = new Map();
  /** Longest time an idle browser is waited for [ms]. */
  const PATIENCE_MS = 200;
  let begun = false;

  const near = new IntersectionObserver((entries) => {
    if (begun) entries.filter((entry) => entry.isIntersecting).forEach(({ target }) => make(target));
  }, { rootMargin: "50% 0px" });

  function make(element) {
    const fill = waiting.get(element);
    if (!fill) return;
    waiting.delete(element);
    near.unobserve(element);
    fill();
  }

  function all() {
    [...waiting.keys()].forEach(make);
  }

  /** Makes one after the other, each in a turn of its own, so that the page stays quick. */
  function goOn(done) {
    const [next] = waiting.keys();
    if (!next) return done();
    make(next);
    idle(() => goOn(done));
  }

  function idle(work) {
    if (window.requestIdleCallback) requestIdleCallback(work, { timeout: PATIENCE_MS });
    else setTimeout(work, 20);
  }

  return {
    /** Has an element filled by a function, once. */
    fill(element, by) {
      waiting.set(element, by);
      near.observe(element);
    },
    /** Makes what is in sight now and, once that is on the screen, the rest. */
    begin(shown, done) {
      begun = true;
      const isInSight = (element) => element.getBoundingClientRect().top < innerHeight;
      [...waiting.keys()].filter(isInSight).forEach(make);
      requestAnimationFrame(() => setTimeout(() => {
        shown();
        idle(() => goOn(done));
      }));
    },
    all,
  };
})();
