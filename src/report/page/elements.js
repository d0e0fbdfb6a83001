// Making elements and writing numbers.

/** An HTML element with attributes (functions become listeners) and children. */
function html(tag, attributes = {}, ...children) {
  return filled(document.createElement(tag), attributes, children);
}

/** The same in SVG. */
function svg(tag, attributes = {}, ...children) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  return filled(element, attributes, children);
}

function filled(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (typeof value === "function") element.addEventListener(name, value);
    else element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children.flat(Infinity).filter((child) => child !== null));
  return element;
}

const $ = (id) => document.getElementById(id);

/** A number with as many digits as `figures` asks for, and no more than say something. */
function number(value, figures = 3) {
  if (value === null || value === undefined) return "–";
  if (typeof value !== "number") return String(value);
  if (!Number.isFinite(value)) return value > 0 ? "∞" : "–";
  const size = Math.abs(value);
  if (size >= 1e5) return grouped(Math.round(value));
  const digits = size === 0 ? 0 : figures - 1 - Math.floor(Math.log10(size));
  const text = value.toFixed(Math.min(Math.max(digits, 0), 6));
  return (text.includes(".") ? text.replace(/\.?0+$/, "") : text).replace("-", "−");
}

/** A number with thin spaces between its thousands. */
function grouped(value) {
  return String(value).replace("-", "−").replace(/\B(?=(\d{3})+(?!\d))/g, "\u2009");
}

/** A number with a fixed count of decimals, so that it does not dance while time runs. */
function fixed(value, decimals) {
  if (!Number.isFinite(value)) return "–";
  const text = value.toFixed(decimals);
  if (Number(text) === 0) return text.replace("-", "");
  return (value >= 1e4 ? grouped(text) : text).replace("-", "−");
}

/** Microseconds in the unit people would say them in. */
function duration(us) {
  if (!Number.isFinite(us)) return "–";
  return us >= 1000 ? `${number(us / 1000)} ms` : `${number(us)} µs`;
}

/** snake_case or kebab-case as words. */
const words = (name) => name.replace(/[_-]/g, " ");

/** A name with its unit: `min_gap_m` is "min gap" in "m". */
function named(name) {
  const units = [
    ["_mps2", "m/s²"], ["_radps", "rad/s"], ["_nps", "N/s"], ["_mps", "m/s"], ["_rad", "rad"],
    ["_percent", "%"], ["_m", "m"], ["_s", "s"], ["_n", "N"], ["_us", "µs"], ["_hz", "Hz"],
  ];
  const found = units.find(([ending]) => name.endsWith(ending));
  if (!found) return [words(name), ""];
  return [words(name.slice(0, -found[0].length)), found[1]];
}

/** A table of a head and rows; cells that are numbers are set as such. */
function table(head, rows, kind = "") {
  const cell = (tag) => (content) => {
    const isNumber = typeof content === "number";
    const shown = isNumber ? number(content) : content;
    return html(tag, { class: isNumber ? "number" : null }, shown ?? "–");
  };
  return html("div", { class: `scroll ${kind}` },
    html("table", {},
      html("thead", {}, html("tr", {}, head.map((name) => html("th", { scope: "col" }, name)))),
      html("tbody", {}, rows.map((row) => html("tr", {}, row.map(cell("td")))))));
}
