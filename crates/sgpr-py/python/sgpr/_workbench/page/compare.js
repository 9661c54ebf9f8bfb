// Measured torque and that of all models, joint by joint, on one axis of time.

import { series } from "./api.js";
import { proposals } from "./data.js";
import { button, choice, fill, h, MEASURED, number, percent, plain, styleOf, table } from "./dom.js";

const MARGIN = { l: 64, r: 12, t: 6, b: 8 };
const view = { log: null, kind: "torque", range: null, span: null, judged: "test" };
let parts = null;
let app = null;
let request = null;
let drawn = "";
let shown = null;
let resized = null;

export function mount(root, application) {
  app = application;
  drawn = "";
  shown = null;
  parts = { top: h("div"), readout: h("p", { class: "readout soft" }), plots: h("div", { class: "plots", id: "plots" }), table: h("div"), cursor: h("div", { class: "cursor" }) };
  root.append(h("h2", {}, "Compare"), parts.top, parts.readout, parts.plots, parts.table);
  resized?.disconnect();
  let width = 0;
  resized = new ResizeObserver(() => { if (parts.plots.clientWidth !== width) { width = parts.plots.clientWidth; load(); } });
  resized.observe(parts.plots);
  parts.plots.addEventListener("mousemove", follow);
  parts.plots.addEventListener("mouseleave", () => { parts.cursor.style.display = "none"; });
}

export function update(root, state, application) {
  app = application;
  const logs = state.logs.filter((log) => log.role !== "off" && !log.problem);
  if (!logs.some((log) => log.name === view.log)) {
    view.log = (logs.find((log) => log.role === "test") ?? logs[0])?.name ?? null;
    view.range = null;
  }
  const ready = state.steps.length > 1 && state.steps[1].ready && view.log;
  fill(parts.top, headline(state), ready ? tools(logs) : null, ready ? models(state) : null);
  fill(parts.table, ready ? errors(state) : null);
  if (!ready) return;
  const wanted = [view.log, view.kind, ...visible(state)].join("\n") + state.steps.filter((step) => step.ready).length;
  if (wanted !== drawn) { drawn = wanted; load(); }
}

const visible = (state) => state.steps.filter((step) => step.shown && step.ready).map((step) => step.id);

function headline(state) {
  const step = state.steps.find((each) => each.id === state.current);
  const robot = state.steps[0];
  if (state.steps.length < 2 || !step?.errors.train) {
    return h("div", { class: "verdict" }, h("p", { class: "lead" }, state.job ? "The fit runs." : "There is no fit yet."),
      state.job ? null : button("To the fit", () => app.go("fit"), { class: "main" }), state.job ? null : proposals(state, app));
  }
  const on = step.errors.test ? "test" : "train";
  const where = on === "test" ? "On logs that the fit has not seen" : "On the training logs (no log tests)";
  return h("div", { class: "verdict" },
    h("p", { class: "lead" }, `${where} the error of “${step.name}” is ${percent(step.errors[on].relative)} of the torque; with the robot file it is ${percent(robot.errors[on]?.relative)}.`),
    h("div", { class: "bar" }, button("What is missing?", async () => {
      if (state.diagnosis || await app.act("diagnose")) app.go("missing");
    }, { class: "main", disabled: Boolean(state.job) }), button("Where it fails", () => app.go("fails"))));
}

function tools(logs) {
  return h("div", { class: "bar" },
    choice("Log", "log", logs.map((log) => [log.name, `${log.name} (${log.role})`]), view.log, (name) => { view.log = name; view.range = null; update(null, app.state, app); }),
    choice("Show", "kind", [["torque", "torque"], ["residual", "measured minus model"]], view.kind, (kind) => { view.kind = kind; update(null, app.state, app); }),
    button("All of it", () => zoom(null)), button("Zoom in", () => scaled(0.5)), button("Zoom out", () => scaled(2)),
    button("←", () => moved(-0.5), { "aria-label": "Earlier" }), button("→", () => moved(0.5), { "aria-label": "Later" }),
    h("span", { class: "soft" }, "drag in a plot to zoom"));
}

function models(state) {
  const rows = state.steps.filter((step) => step.ready).map((step) => {
    const style = styleOf(state, step.id);
    const swatch = h("span", { class: "swatch", "aria-hidden": "true", style: { borderTopColor: style.color, borderTopStyle: { solid: "solid", dash: "dashed", dot: "dotted", dashdot: "dashed" }[style.dash] } });
    return h("label", {}, h("input", { type: "checkbox", checked: step.shown, "data-key": `show ${step.id}`, onchange: (event) => app.act("show", { name: step.id, shown: event.target.checked }) }), h("span", {}, swatch, step.name));
  });
  const measured = h("span", {}, h("span", { class: "swatch", style: { borderTopColor: MEASURED } }), "measured");
  return h("div", { class: "bar", role: "group", "aria-label": "Models" }, view.kind === "torque" ? measured : null, rows);
}

function zoom(range) { view.range = range; load(); }

function scaled(factor) {
  const [a, b] = view.range ?? view.span;
  const half = ((b - a) * factor) / 2;
  const middle = (a + b) / 2;
  zoom(factor > 1 && 2 * half >= view.span[1] - view.span[0] ? null : [middle - half, middle + half]);
}

function moved(share) {
  const [a, b] = view.range ?? view.span;
  const by = share * (b - a);
  zoom([a + by, b + by]);
}

async function load() {
  if (!view.log || !app.state || !drawn) return;
  const begun = performance.now();
  request?.abort();
  request = new AbortController();
  const [from, to] = view.range ?? [-1e300, 1e300];
  const values = { log: view.log, kind: view.kind, steps: visible(app.state).join(","), from, to, points: Math.max(300, Math.round(parts.plots.clientWidth * 0.6)) };
  try {
    shown = await series(values, request.signal);
  } catch (error) {
    if (error.name !== "AbortError") app.notice(error.message);
    return;
  }
  view.span = shown.span;
  draw(begun);
}

function draw(begun) {
  const joints = app.state.robot.joints;
  const units = unitsOf(app.state);
  if (parts.plots.querySelectorAll(".joint").length !== joints.length) {
    fill(parts.plots, joints.map((name, k) => h("div", { class: `joint${k === joints.length - 1 ? " last" : ""}`, id: `joint-${k}`, tabindex: 0, role: "img", "aria-label": `Torque of ${name} over time`, onkeydown: keys })), parts.cursor);
  }
  const range = view.range ?? view.span;
  const places = [...parts.plots.querySelectorAll(".joint")];
  const near = (place) => { const box = place.getBoundingClientRect(); return box.bottom > 0 && box.top < innerHeight; };
  const one = (place) => {
    const k = places.indexOf(place);
    const traces = Object.entries(shown.joints[k]).map(([id, { t, y }]) => ({
      type: "scatter", mode: shown.every && t.length < 150 ? "lines+markers" : "lines", x: t, y, hoverinfo: "skip", connectgaps: false,
      marker: { size: 4 }, line: / (low|high)$/.test(id) ? { ...styleOf(app.state, id.split(" ")[0]), width: 0.8, dash: "dot" } : id === "measured" ? { color: MEASURED, width: 1.6 } : { ...styleOf(app.state, id), width: 1.3, simplify: false },
    }));
    const last = k === places.length - 1;
    const layout = {
      margin: { ...MARGIN, b: last ? 42 : MARGIN.b }, showlegend: false, hovermode: false, dragmode: "zoom", font: { size: 12, color: "#222" },
      xaxis: { range, gridcolor: "#e4e4e4", zeroline: false, showticklabels: last, title: last ? { text: "time [s]", standoff: 4 } : undefined },
      yaxis: { fixedrange: true, gridcolor: "#e4e4e4", zerolinecolor: "#bbb", title: { text: plain(`${joints[k]} [${units[k]}]`), font: { size: 11.5 }, standoff: 4 }, nticks: 6 },
    };
    const fresh = !place.data;
    Plotly.react(place, traces, layout, { displayModeBar: false, doubleClick: false });
    if (fresh) {
      place.on("plotly_relayout", (change) => {
        const given = [change["xaxis.range[0]"], change["xaxis.range[1]"]];
        if (given[0] !== undefined) zoom(given.map(Number));
      });
      place.on("plotly_doubleclick", () => zoom(null));
    }
  };
  places.filter(near).forEach(one);
  document.body.dataset.zoom = String(Math.round(performance.now() - begun));
  const rest = places.filter((place) => !near(place));
  const work = () => { const next = rest.shift(); if (next && shown) { one(next); setTimeout(work, 0); } else document.body.dataset.drawn = String(Number(document.body.dataset.drawn ?? 0) + 1); };
  setTimeout(work, 0);
  parts.readout.textContent = shown.every ? "Every sample is drawn." : "Thinned to what the screen shows: smallest and largest values are kept. Zoom in for every sample.";
}

function unitsOf(state) {
  const step = state.steps.find((each) => each.errors.train ?? each.errors.test);
  return (step?.errors.train ?? step?.errors.test)?.joints.map((one) => one.unit) ?? state.robot.joints.map(() => "N·m");
}

function keys(event) {
  const does = { "+": () => scaled(0.5), "-": () => scaled(2), ArrowLeft: () => moved(-0.25), ArrowRight: () => moved(0.25), Home: () => zoom(null) }[event.key];
  if (does) { event.preventDefault(); does(); }
}

function follow(event) {
  if (!shown) return;
  const box = parts.plots.getBoundingClientRect();
  const x = event.clientX - box.left;
  const [a, b] = view.range ?? view.span;
  const time = a + ((x - MARGIN.l) / (box.width - MARGIN.l - MARGIN.r)) * (b - a);
  if (time < a || time > b) { parts.cursor.style.display = "none"; return; }
  parts.cursor.style.display = "block";
  parts.cursor.style.left = `${x}px`;
  const place = event.target.closest(".joint");
  if (!place) return;
  const k = Number(place.id.slice(6));
  const unit = unitsOf(app.state)[k];
  const titles = Object.fromEntries(app.state.steps.map((step) => [step.id, step.name]));
  const said = Object.entries(shown.joints[k]).map(([id, { t, y }]) => `${titles[id] ?? (id === "measured" ? id : `95 % ${id.split(" ")[1]}`)} ${number(y[nearest(t, time)], 4)} ${unit}`);
  parts.readout.textContent = `${app.state.robot.joints[k]} at ${time.toFixed(3)} s: ${said.join(", ")}`;
}

function nearest(t, time) {
  let low = 0, high = t.length - 1;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (t[middle] < time) low = middle + 1; else high = middle;
  }
  return low > 0 && time - t[low - 1] < t[low] - time ? low - 1 : low;
}

function errors(state) {
  const steps = state.steps.filter((step) => step.shown && step.errors.train);
  const names = state.logs.filter((log) => log.role !== "off" && !log.problem).map((log) => log.name);
  const options = [["test", "all test logs"], ["train", "all training logs"], ...names.map((name) => [`log ${name}`, name])];
  const of = (step) => (view.judged.startsWith("log ") ? step.errors.logs[view.judged.slice(4)] : step.errors[view.judged]);
  if (!steps.some(of)) view.judged = steps.some((step) => step.errors.test) ? "test" : "train";
  const pinned = state.steps.find((step) => step.id === state.pinned && step.errors.train);
  const first = of(steps.find(of) ?? {errors: {logs: {}}});
  if (!first) return h("p", { class: "soft" }, "No model is shown.");
  const rows = first.joints.map((joint, k) => [
    joint.joint, joint.unit, ...steps.map((step) => against(of(step)?.joints[k].rmse, pinned && pinned !== step ? of(pinned)?.joints[k].rmse : null)), number(joint.zero), number(joint.gravity),
  ]);
  rows.push(["all, of the torque", "%", ...steps.map((step) => number(of(step)?.relative)), "", ""]);
  return h("section", { "aria-label": "Errors" }, h("h3", {}, "Root mean square error"),
    h("div", { class: "bar" }, choice("On", "judged", options, view.judged, (value) => { view.judged = value; fill(parts.table, errors(app.state)); }),
      choice("Compare with", "pin", [["", "nothing"], ...state.steps.filter((step) => step.ready).map((step) => [step.id, step.name])], state.pinned ?? "", (name) => app.act("pin", { name: name || null }))),
    h("p", { class: "soft" }, "Counted while a joint moves: while it stands, dry friction holds it with any torque, and no model can say which."),
    table("Errors", ["joint", "unit", ...steps.map((step) => step.name), "no model", "gravity only"], rows, [0, 1]));
}

export function against(value, before) {
  if (before === null || before === undefined || !value) return number(value);
  const change = 100 * (value / before - 1);
  const text = ` ${change > 0 ? "▲ +" : "▼ "}${number(change, 2)} %`;
  return h("span", {}, number(value), h("span", { class: change > 0.5 ? "bad" : change < -0.5 ? "good" : "soft" }, Math.abs(change) < 0.5 ? " =" : text));
}
