// Take away: the model, its report, and what makes them again.

import { get, save } from "./api.js";
import { button, fill, h } from "./dom.js";

const FILES = [
  ["model.sgpr", "Model", "for sgpr.load, sgpr predict and the control loop"],
  ["report.html", "Report", "one page, works offline"],
  ["repeat.py", "Python script", "makes the same model again, byte by byte; run it in the folder of the logs"],
  ["commands.sh", "Commands", "the same on the command line"],
  ["model.h", "C header", "the physics for a controller: C99, needs no library"],
  ["model.rs", "Rust module", "the same in Rust"],
  ["robot.urdf", "Robot file", "the URDF with the inertias of this model, if they are those of bodies (sgpr identify --consistent makes them so)"],
];
let shown = "";

export function update(root, state, app) {
  const step = state.steps.find((each) => each.id === state.current);
  if (!step || step.id === "robot" || !step.ready) {
    fill(root, h("h2", {}, "Take away"), h("div", { class: "verdict" }, h("p", { class: "lead" }, "There is no fit yet."), button("To the fit", () => app.go("fit"), { class: "main" })));
    return;
  }
  const key = `${state.version}`;
  if (shown === key && root.querySelector("pre")) return;
  shown = key;
  const get_it = (what) => () => save(what).catch((error) => app.notice(error.message));
  fill(root, h("h2", {}, "Take away"), h("p", { class: "lead" }, `“${step.name}”`),
    step.history.map((line) => h("p", { class: "soft" }, line)),
    FILES.map(([what, title, about]) => h("div", { class: "bar" }, button(`${title} (${what})`, get_it(what), { class: what === "model.sgpr" ? "main" : null }), h("span", { class: "soft" }, about))),
    ["commands.sh", "repeat.py"].map((what) => [h("h3", {}, what), h("pre", { id: what, tabindex: 0, role: "region", "aria-label": what })]));
  for (const what of ["commands.sh", "repeat.py"]) {
    get(`take/${what}`).then((answer) => answer.text()).then((text) => { const place = document.getElementById(what); if (place) place.textContent = text; }).catch((error) => app.notice(error.message));
  }
}
