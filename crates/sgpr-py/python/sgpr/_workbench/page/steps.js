// The ladder of steps: add, watch the error, take back, branch.

import { against } from "./compare.js";
import { button, fill, h, number, percent, table } from "./dom.js";

export function update(root, state, app) {
  const step = state.steps.find((each) => each.id === state.current);
  const busy = Boolean(state.job);
  const fitted = state.steps.length > 1;
  fill(root, h("h2", {}, "Add, watch, take back"), fitted ? headline(state, step, app, busy) : h("div", { class: "verdict" }, h("p", { class: "lead" }, "There is no fit yet."), button("To the fit", () => app.go("fit"), { class: "main" })),
    fitted ? ladder(state, app, busy) : null, fitted ? branches(state) : null);
}

const judged = (step) => (step.errors.test ? "test" : "train");

function headline(state, step, app, busy) {
  const before = state.steps.find((each) => each.id === step.after);
  const on = judged(step);
  const buttons = h("div", { class: "bar" },
    step.rest ? null : button("What is missing now?", async () => { if (state.diagnosis || await app.act("diagnose")) app.go("missing"); }, { class: "main", disabled: busy }),
    step.after ? button("Take it back", () => app.act("take_back"), { disabled: busy }) : null,
    step.rest ? null : button("Learn the rest", () => app.act("learn"), { disabled: busy, title: "a Gaussian process for what the physics leaves over, as a last step" }),
    button("Take the model away", () => app.go("take")));
  if (!before || !step.errors[on] || !before.errors[on]) {
    return h("div", { class: "verdict" }, h("p", { class: "lead" }, busy && !step.errors[on] ? "The effect is fitted." : `The current model is “${step.name}”.`), buttons);
  }
  const changes = step.errors[on].joints.map((joint, k) => ({ joint: joint.joint, unit: joint.unit, now: joint.rmse, old: before.errors[on].joints[k].rmse }))
    .filter((one) => one.old > 0).map((one) => ({ ...one, change: 100 * (one.now / one.old - 1) })).sort((a, b) => a.change - b.change);
  const best = changes[0];
  const worse = changes.filter((one) => one.change > 0.5);
  const where = on === "test" ? "on logs that no step has seen" : "on the training logs (no log tests)";
  return h("div", { class: best.change < 0 ? "verdict" : "verdict bad" },
    h("p", { class: "lead" }, `With ${step.name} the error of ${best.joint} ${best.change < 0 ? "falls by" : "rises by"} ${number(Math.abs(best.change), 2)} % ${where}: ${number(best.old)} to ${number(best.now)} ${best.unit}.`),
    worse.length ? h("p", { class: "bad" }, `It rises at ${worse.map((one) => `${one.joint} by ${number(one.change, 2)} %`).join(", ")}.`) : null,
    step.errors.coverage?.length ? h("p", {}, `Its interval of 95 % holds ${step.errors.coverage.map((one) => `${number(one.percent_95)} % at ${one.joint}`).join(", ")} of the torques on the test logs; Compare draws it dotted.`) : null,
    h("p", {}, `All joints: ${percent(before.errors[on].relative)} to ${percent(step.errors[on].relative)} of the torque.`), buttons);
}

function depth(state, step) {
  let found = 0;
  for (let one = step; one?.after; one = state.steps.find((each) => each.id === one.after)) found += 1;
  return found;
}

function ordered(state) {
  const below = (id) => state.steps.filter((step) => (step.after ?? null) === id).flatMap((step) => [step, ...(step.id === id ? [] : below(step.id))]);
  return below(null);
}

function ladder(state, app, busy) {
  const steps = ordered(state);
  const rows = steps.map((step) => {
    const name = h("input", { type: "text", value: step.name, "aria-label": `Name of ${step.name}`, "data-key": `name ${step.id}`, disabled: step.id === "robot", style: { width: "min(26rem, 38vw)" }, title: step.name,
      onchange: (event) => app.act("rename", { name: step.id, to: event.target.value }), onkeydown: (event) => { if (event.key === "Enter") event.target.blur(); } });
    const before = state.steps.find((each) => each.id === step.after);
    const on = judged(step);
    return [
      h("span", {}, h("span", { class: "indent", style: { width: `${1.4 * depth(state, step)}rem` } }), depth(state, step) ? "└ " : "", name),
      step.problem ? h("span", { class: "bad" }, step.problem) : !step.ready ? "runs" : step.errors[on] ? against(step.errors[on].relative, before?.errors[on]?.relative) : "–",
      step.id === state.current ? "current" : step.id === "robot" ? "" : button("Go on from here", () => app.act("use", { name: step.id }), { "data-key": `use ${step.id}`, disabled: busy }),
      step.id === "robot" ? "" : button("Remove", () => app.act("remove", { name: step.id }), { "data-key": `remove ${step.id}`, "aria-label": `Remove ${step.name}`, disabled: busy }),
    ];
  });
  return h("section", { "aria-label": "Steps" }, h("h3", {}, "Steps"),
    h("p", { class: "soft" }, "A step that is taken back stays here: go on from it, or from any other, and compare."),
    table("Steps", ["step", "error of all joints, % of the torque", "", ""], rows, [0, 2, 3], steps.map((step) => (step.id === state.current ? "current" : null))));
}

function branches(state) {
  const steps = ordered(state).filter((step) => step.id !== "robot" && step.errors[judged(step)]);
  if (!steps.length) return null;
  const on = judged(steps[0]);
  const rows = steps[0].errors[on].joints.map((joint, k) => [joint.joint, joint.unit, ...steps.map((step) => {
    const before = state.steps.find((each) => each.id === step.after);
    return against(step.errors[on].joints[k].rmse, before?.errors[on]?.joints[k].rmse);
  })]);
  return h("section", { "aria-label": "Errors of the steps" }, h("h3", {}, on === "test" ? "Error on logs that no step has seen" : "Error on the training logs"),
    h("p", { class: "soft" }, "Root mean square; the change is against the step that it starts from."),
    table("Errors of the steps", ["joint", "unit", ...steps.map((step) => step.name)], rows, [0, 1]));
}
