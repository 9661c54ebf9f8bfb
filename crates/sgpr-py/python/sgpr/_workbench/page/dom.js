// Elements from text: nothing that comes from a file is ever taken for markup.

export function h(tag, settings = {}, ...children) {
  const element = document.createElement(tag);
  for (const [key, value] of Object.entries(settings)) {
    if (value === null || value === undefined || value === false) continue;
    if (key.startsWith("on")) element.addEventListener(key.slice(2), value);
    else if (key === "style") Object.assign(element.style, value);
    else if (key === "value" || key === "checked" || key === "disabled") element[key] = value;
    else element.setAttribute(key, value === true ? "" : value);
  }
  element.append(...children.flat(Infinity).filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

export function fill(place, ...children) {
  // The one who uses the keyboard stays where he was.
  const key = place.contains(document.activeElement) ? document.activeElement.dataset.key : null;
  place.replaceChildren(...children.flat(Infinity).filter((child) => child));
  if (key) [...place.querySelectorAll("[data-key]")].find((each) => each.dataset.key === key)?.focus();
}

// rows: arrays of texts or elements; text: numbers of the columns with text
export function table(caption, head, rows, text = [0], classes = []) {
  const kind = (k) => (text.includes(k) ? "text" : null);
  return h("div", { class: "wide", tabindex: 0, role: "region", "aria-label": caption },
    h("table", { "aria-label": caption },
      h("thead", {}, h("tr", {}, head.map((cell, k) => h("th", { class: kind(k), scope: "col" }, cell)))),
      h("tbody", {}, rows.map((row, r) => h("tr", { class: classes[r] }, row.map((cell, k) =>
        k === 0 ? h("th", { class: "text", scope: "row" }, cell) : h("td", { class: kind(k) }, cell)))))));
}

export function choice(label, key, options, value, change) {
  // options: [value, text]
  const select = h("select", { "data-key": key, onchange: (event) => change(event.target.value) },
    options.map(([each, text]) => h("option", { value: each }, text)));
  select.value = value;
  if (select.selectedIndex < 0) select.selectedIndex = 0;
  return h("label", {}, label, select);
}

export const button = (text, onclick, settings = {}) => h("button", { type: "button", onclick, "data-key": text, ...settings }, text);

export function number(value, digits = 3) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e6 || size < 1e-4) return value.toExponential(digits - 1);
  return size >= 10 ** (digits - 1) ? String(Math.round(value)) : value.toPrecision(digits);
}

export const percent = (value) => (value === null || value === undefined ? "–" : `${number(value, 3)} %`);

/** A sentence in which `names` are set as code. */
export const prose = (text) => text.split("`").map((part, k) => (k % 2 ? h("code", {}, part) : part));

export const words = (name) => name.replaceAll("_", " ");

// Plotly takes some of a text for markup.
export const plain = (text) => text.replaceAll("&", "&amp;").replaceAll("<", "&lt;").replaceAll(">", "&gt;");

export const COLOURS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#b58900", "#56b4e9", "#000000"];
export const DASHES = ["solid", "dash", "dot", "dashdot"];
export const MEASURED = "#8a8a8a";

export function styleOf(state, id) {
  const k = state.steps.findIndex((step) => step.id === id);
  if (k <= 0) return { color: "#555555", dash: "dot" };
  return { color: COLOURS[(k - 1) % COLOURS.length], dash: DASHES[Math.floor((k - 1) / COLOURS.length) % DASHES.length] };
}
