// Light and dark, and the colours that curves and canvases take from the style sheet.

const Theme = (() => {
  const root = document.documentElement;
  const system = matchMedia("(prefers-color-scheme: dark)");
  const listeners = [];
  let asked = null;
  let printing = false;
  let cache = new Map();

  try {
    asked = localStorage.getItem("platoon-theme");
  } catch {
    // A page opened from a file may have no storage.
  }

  const isDark = () => !printing && (asked ? asked === "dark" : system.matches);

  function apply() {
    root.dataset.theme = isDark() ? "dark" : "light";
    cache = new Map();
    listeners.forEach((listener) => listener());
  }

  function toggle() {
    asked = isDark() ? "light" : "dark";
    try {
      localStorage.setItem("platoon-theme", asked);
    } catch {
      // It is for this visit only then.
    }
    apply();
  }

  system.addEventListener("change", apply);

  return {
    apply,
    toggle,
    changed: (listener) => listeners.push(listener),
    print(on) {
      printing = on;
      apply();
    },
    /** The value of a custom property, such as "--ink". */
    colour(name) {
      if (!cache.has(name)) cache.set(name, getComputedStyle(root).getPropertyValue(name).trim());
      return cache.get(name);
    },
    truck: (index) => Theme.colour(`--truck${index % 8}`),
  };
})();
