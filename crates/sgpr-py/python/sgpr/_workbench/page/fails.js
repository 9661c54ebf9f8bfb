// Where the model fails: the residual against anything, and what is different in a picked region.

import { getJson } from "./api.js";
import { button, choice, fill, h, table } from "./dom.js";

const view = { step: "", joint: "", log: "test", x: "", x2: "t", colour: "", other: "", region: null };
let parts = null;
let app = null;
let asked = "";
let titles = {};

export function mount(root, application) {
  app = application;
  asked = "";
  const figure = (id) => h("div", { id });
  parts = {
    top: h("div"), said: h("div", { "aria-live": "polite" }),
    first: figure("against"), second: figure("against-too"), map: figure("map"), spectrum: figure("spectrum"), correlation: figure("correlation"),
  };
  root.append(h("h2", {}, "Where it fails"), parts.top, h("div", { class: "two" }, parts.first, parts.second), parts.said,
    h("h3", {}, "Over two variables, and whether what is left is noise"), h("div", { class: "two" }, parts.map, parts.spectrum, parts.correlation));
}

export function update(root, state, application) {
  app = application;
  const ready = state.steps.filter((step) => step.ready && step.id !== "robot");
  if (!ready.length) {
    fill(parts.top, h("div", { class: "verdict" }, h("p", { class: "lead" }, "There is no fit yet."), button("To the fit", () => app.go("fit"), { class: "main" })));
    return;
  }
  if (!ready.some((step) => step.id === view.step)) view.step = state.current;
  if (!state.robot.joints.includes(view.joint)) { view.joint = worst(state); view.x = ""; view.region = null; }
  controls(state, ready);
  load();
}

// The joint that makes most of the error of all joints.
function worst(state) {
  const errors = state.steps.find((step) => step.id === view.step)?.errors;
  const joints = (errors?.test ?? errors?.train)?.joints ?? [];
  return joints.reduce((best, one) => (!best || one.rmse > best.rmse ? one : best), null)?.joint ?? state.robot.joints[0];
}

function controls(state, ready) {
  const set = (key) => (value) => { view[key] = value; if (key === "joint") { view.x = ""; view.colour = ""; } if (key !== "colour" && key !== "other") view.region = null; controls(app.state, ready); load(); };
  const k = state.robot.joints.indexOf(view.joint);
  const variables = Object.keys(titles).length ? Object.entries(titles) : [[`dq:${k}`, "speed"], ["t", "time"]];
  const logs = [["test", "all test logs"], ["train", "all training logs"], ...state.logs.filter((log) => log.role !== "off" && !log.problem).map((log) => [log.name, log.name])];
  const steps = ready.map((step) => [step.id, step.name]);
  fill(parts.top, h("div", { class: "bar" },
    choice("Residual of", "joint", state.robot.joints.map((name) => [name, name]), view.joint, set("joint")),
    choice("with", "step", steps, view.step, set("step")),
    choice("on", "log", logs, view.log, set("log")),
    choice("against", "x", variables, view.x || `dq:${k}`, set("x")),
    choice("and", "x2", variables, view.x2, set("x2")),
    choice("colour by", "colour", [["", "nothing"], ["log", "log"], ...variables], view.colour, set("colour")),
    choice("draw through it", "other", [["", "nothing"], ...steps.filter(([id]) => id !== view.step)], view.other, set("other"))),
  byNumbers(), h("p", { class: "soft" }, "Drag a rectangle in one of the first two plots: the same samples are marked in both, and what is different about them is said below."));
}

function byNumbers() {
  const inputs = ["from", "to", "residual from", "to residual"].map((label) => h("input", { type: "number", step: "any", "aria-label": label, style: { width: "6.5rem" } }));
  const pick = () => {
    const [a, b, c, d] = inputs.map((each, k) => (each.value === "" ? [-1e300, 1e300][k % 2] : Number(each.value)));
    view.region = [view.x || `dq:${app.state.robot.joints.indexOf(view.joint)}`, a, b, c, d];
    load();
  };
  return h("details", {}, h("summary", { "data-key": "numbers" }, "Pick by numbers"), h("div", { class: "bar" },
    h("span", {}, "first variable from"), inputs[0], "to", inputs[1], h("span", {}, "residual from"), inputs[2], "to", inputs[3], button("Pick", pick), button("Pick nothing", () => { view.region = null; load(); })));
}

async function load() {
  const values = { step: view.step, joint: view.joint, log: view.log, x: view.x, x2: view.x2, colour: view.colour, other: view.other, region: view.region ? JSON.stringify(view.region) : "" };
  const key = JSON.stringify([values, app.state.steps.filter((step) => step.ready).length]);
  if (key === asked) return;
  asked = key;
  let found;
  try {
    found = await getJson("residual", values);
    if (asked !== key) return;
    const first = !Object.keys(titles).length || Object.keys(titles).join() !== Object.keys(found.variables).join();
    titles = found.variables;
    if (first) controls(app.state, app.state.steps.filter((step) => step.ready && step.id !== "robot"));
    paint(parts.first, found.figures[0], values.x || `dq:${app.state.robot.joints.indexOf(view.joint)}`);
    paint(parts.second, found.figures[1], values.x2);
    if (found.figures[2]) paint(parts.map, found.figures[2]);
    say(found.difference);
    const white = await getJson("whiteness", { step: view.step, joint: view.joint, log: view.log });
    if (asked !== key) return;
    paint(parts.spectrum, white.figures[0]);
    paint(parts.correlation, white.figures[1]);
  } catch (error) {
    app.notice(error.message);
  }
  document.body.dataset.fails = String(Number(document.body.dataset.fails ?? 0) + 1);
}

function paint(place, figure, variable = null) {
  Plotly.react(place, figure.data, figure.layout, { displayModeBar: false, responsive: true });
  place.variable = variable;
  if (variable && !place.listens) {
    place.listens = true;
    place.on("plotly_selected", (event) => {
      if (!event?.range) return;
      view.region = [place.variable, ...event.range.x, ...event.range.y];
      load();
    });
  }
}

function say(difference) {
  if (!difference) { fill(parts.said); return; }
  fill(parts.said, h("div", { class: "verdict" }, h("p", {}, difference.sentence), button("Pick nothing", () => { view.region = null; load(); })),
    difference.rows.length ? h("div", { class: "two" },
      table("What is different", ["variable", "here (80 %)", "elsewhere (80 %)", "difference (Kolmogorov–Smirnov)"], difference.rows),
      table("Where they come from", ["log", "share of them %", "share of the log %", "from [s]", "to [s]"], difference.logs)) : null);
}
