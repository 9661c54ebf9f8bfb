// What is missing: the candidates of the diagnosis, their signatures, and a click that adds one.

import { getJson, save } from "./api.js";
import { button, choice, fill, h, number, table, words } from "./dom.js";

const VERDICTS = {
  effects_found: "The model lacks",
  nothing_missing: "Nothing is missing: what is left is noise as far as these logs can tell.",
  unexplained_structure: "Something is missing, and no known effect is likely to be it.",
};
const SHOWN = 15;
const hand = { effect: "coulomb_transition", joint: "" };
let open = null;

const names = (one) => (one.joints.length ? one.joints.map((joint) => `${one.effect}@${joint}`) : [one.effect]);
const title = (one) => `${words(one.effect)} at ${one.joints.join(", ") || "the whole arm"}`;

export function update(root, state, app) {
  const step = state.steps.find((each) => each.id === state.current);
  const found = state.diagnosis;
  const fitted = step && step.id !== "robot" && step.ready && !step.rest;
  const add = async (effects) => { if (await app.act("add", { effects })) app.go("steps"); };
  const lead = step?.rest ? h("div", { class: "verdict" }, h("p", { class: "lead" }, "The Gaussian process takes all that is left: go on from the step before it."), button("To the steps", () => app.go("steps"), { class: "main" }))
    : !fitted ? h("div", { class: "verdict" }, h("p", { class: "lead" }, "There is no fit yet."), button("To the fit", () => app.go("fit"), { class: "main" }))
    : found ? verdict(found)
    : h("div", { class: "verdict" }, h("p", { class: "lead" }, state.job ? `Looking for what “${step.name}” lacks: every effect is tried at every joint.` : `What does “${step.name}” lack?`),
      state.job ? h("p", { class: "soft" }, "Cancel at any time: the models stay as they are, and so does what is known by then.") : button("Look for it", () => app.act("diagnose"), { class: "main" }),
      state.hints.length ? [h("p", {}, state.job ? "What is known so far, on the training logs:" : "What was known when the search was stopped, on the training logs:"), h("ul", {}, state.hints.map((text) => h("li", {}, text)))] : null);
  fill(root, h("h2", {}, "What is missing"), lead,
    found ? found.findings.map((one, k) => card(one, k, state, app, add)) : null,
    found ? candidates(others(found), found.candidates.length, state, app, add)
      : fitted && state.ranked ? candidates(state.ranked, state.ranked.length, state, app, add) : null,
    found ? experiment(found, app) : null, fitted ? byHand(state, add) : null, found ? rest(found, app) : null);
  const motion = document.getElementById("next-motion");
  if (motion) Plotly.react(motion, found.next_figure.data, found.next_figure.layout, { displayModeBar: false, responsive: true });
  if (open && (found || state.ranked)) signature(open, state, app);
}

function verdict(found) {
  const texts = new Map();
  for (const one of found.findings) {
    const certain = one.joints.length && one.probability >= 0.9;
    const key = certain ? one.effect : title(one);
    if (certain && texts.has(key)) texts.set(key, `${texts.get(key)}, ${one.joints.join(", ")}`);
    else texts.set(key, one.probability >= 0.9 ? title(one) : `${title(one)} (probability ${one.probability.toFixed(2)})`);
  }
  const names = [...texts.values()];
  return h("div", { class: "verdict" }, h("p", { class: "lead" }, VERDICTS[found.verdict] + (names.length ? ` ${names.join("; ")}.` : "")),
    h("p", { class: "soft" }, `Probability that nothing is missing ${found.probability_nothing_missing.toFixed(2)}, that something unknown is ${found.probability_unexplained.toFixed(2)}.`),
    found.unexplained.map((text) => h("p", {}, `Left over: ${text}`)));
}

const fall = (one, joint) => 100 * (1 - one.rmse_after[joint] / one.rmse_before[joint]);

// The largest change on blocks of time that were left out; what has no evidence was not fitted.
function gained(one) {
  const joints = Object.keys(one.rmse_before).filter((joint) => one.rmse_after[joint] !== one.rmse_before[joint]);
  const best = joints.sort((a, b) => fall(one, b) - fall(one, a))[0];
  if (best === undefined) return "–";
  const value = fall(one, best);
  return h("span", { class: `pair ${value >= 0 ? "good" : "bad"}` }, `${best} ${value >= 0 ? "−" : "+"}${number(Math.abs(value), 2)} %`);
}

const others = (found) => found.candidates.filter((one) => !found.findings.some((other) => title(other) === title(one)));

function card(one, k, state, app, add) {
  const gains = Object.keys(one.rmse_before).map((joint) => [joint, number(one.rmse_before[joint]), number(one.rmse_after[joint]), h("span", { class: fall(one, joint) >= 0 ? "good" : "bad" }, `${fall(one, joint) >= 0 ? "−" : "+"}${number(Math.abs(fall(one, joint)), 2)} %`)]);
  return h("section", { class: "card", "aria-label": title(one) },
    h("h3", {}, `${k + 1}. ${title(one)}, probability ${one.probability.toFixed(2)}`),
    h("p", {}, `${one.evidence}.`),
    one.confusable_with.length ? h("p", {}, `Could also be ${one.confusable_with.map(words).join(", ")}. To tell them apart: ${one.separating_experiment}.`) : null,
    table(`Errors without and with ${title(one)}`, ["joint", "error without", "with, on unseen blocks of time", "change"], gains),
    h("div", { class: "bar" },
      button(one.joints.length > 1 ? "Add it at all of them" : "Add it", () => add(names(one)), { class: "main", "data-key": `add ${k}`, disabled: Boolean(state.job) }),
      one.joints.length > 1 ? one.joints.map((joint) => button(`only at ${joint}`, () => add([`${one.effect}@${joint}`]), { disabled: Boolean(state.job) })) : null,
      button("Show its signature", () => toggle(`f${k}`, one, state, app), { "data-key": `signature f${k}`, "aria-expanded": String(open?.key === `f${k}`) })),
    h("div", { id: `signature-f${k}` }));
}

function candidates(all, count, state, app, add) {
  const listed = all.slice(0, SHOWN);
  const judged = Boolean(state.diagnosis);
  const rows = listed.map((one, k) => [
    title(one), judged ? one.probability.toFixed(2) : "–", one.score <= -1e6 ? "–" : number(one.score), gained(one), one.confusable_with.map(words).join(", ") || "–",
    h("span", { class: "pair" }, button("Show", () => toggle(`c${k}`, one, state, app), { "data-key": `signature c${k}`, "aria-label": `Show the signature of ${title(one)}` }), " ",
      button("Add", () => add(names(one)), { "data-key": `add c${k}`, "aria-label": `Add ${title(one)}`, disabled: Boolean(state.job) })),
  ]);
  const caption = judged ? "Other candidates" : "Candidates so far";
  return h("section", { "aria-label": caption }, h("h3", {}, caption),
    h("p", { class: "soft" }, `The best ${listed.length} of ${count}. Evidence: log of the Bayes factor against the model alone, less what looking at so many costs. Error gained: on blocks of time that the fit had not seen, with this effect alone beside the model; – without evidence.${judged ? "" : " Many of them imitate each other: which are there, and how surely, is known when the search ends."}`),
    table(caption, ["effect", "probability", "evidence", "error gained", "looks like", ""], rows, [0, 4, 5]), h("div", { id: "signature-c" }));
}

function experiment(found, app) {
  if (!found.next_figure) return null;
  return h("section", { "aria-label": "Next experiment" }, h("h3", {}, "What to record next"),
    found.next_experiment.map((one) => h("p", {}, `To tell ${words(one.about[0])} from ${one.about.slice(1).map(words).join(" and ")}: ${one.experiment} (${number(one.seconds)} s). Log Bayes factor between them ${one.separation_now.toFixed(1)} now, ${one.separation_expected.toFixed(1)} expected with the motion.`)),
    h("p", { class: "soft" }, "It stays within what the logs show, but takes the arm to new poses: look for collisions first."),
    h("div", { id: "next-motion" }),
    button("The motion (next_experiment.csv)", () => save("next_experiment.csv").catch((error) => app.notice(error.message))));
}

function toggle(key, one, state, app) {
  open = open?.key === key ? null : { key, effect: one.effect, joint: one.joints[0] ?? Object.keys(one.rmse_before)[0] };
  for (const place of document.querySelectorAll("[id^=signature-]")) { Plotly.purge(place); place.replaceChildren(); }
  for (const each of document.querySelectorAll("[aria-expanded]")) each.setAttribute("aria-expanded", String(each.dataset.key === `signature ${open?.key}`));
  if (open) signature(open, state, app);
}

async function signature(one, state, app) {
  const place = document.getElementById(one.key.startsWith("c") ? "signature-c" : `signature-${one.key}`);
  if (!place) return;
  try {
    const found = await getJson("signature", { effect: one.effect, joint: one.joint, step: state.current });
    if (open !== one) return;
    fill(place, h("p", { class: "soft" }, `What the model leaves at ${one.joint} against the variable of ${words(one.effect)}: a mean off zero is what the effect would take.`), h("div", { class: "figure" }));
    Plotly.react(place.lastChild, found.figures[0].data, { ...found.figures[0].layout, dragmode: "zoom" }, { displayModeBar: false, responsive: true });
  } catch (error) { app.notice(error.message); }
}

function byHand(state, add) {
  const joints = [["", "the whole arm"], ...state.robot.joints.map((name) => [name, name])];
  if (!hand.joint) hand.joint = state.robot.joints[0];
  return h("section", { "aria-label": "Add by hand" }, h("h3", {}, "Add one by hand"), h("div", { class: "bar" },
    choice("Effect", "hand effect", state.effects.map((each) => [each.name, words(each.name)]), hand.effect, (value) => { hand.effect = value; }),
    choice("at", "hand joint", joints, hand.joint, (value) => { hand.joint = value; }),
    button("Add", () => add([hand.joint ? `${hand.effect}@${hand.joint}` : hand.effect]), { "data-key": "hand add", disabled: Boolean(state.job) })));
}

function rest(found, app) {
  const sizes = found.detectable.map((one) => [words(one.effect), one.joints.join(", ") || "the whole arm", one.seen_from === null ? "–" : `${number(one.seen_from)} ${one.unit}`, one.torque === null ? "–" : number(one.torque), one.mistaken_for ? words(String(one.mistaken_for)) : "–"]);
  return h("section", { "aria-label": "What these logs cannot tell" },
    h("details", {}, h("summary", { "data-key": "not testable" }, `Not testable with these logs (${found.not_testable.length})`),
      table("Not testable", ["effect", "because"], found.not_testable.map((one) => [words(one.effect), one.why]), [0, 1])),
    h("details", {}, h("summary", { "data-key": "sizes" }, "How small an effect may be to be found"),
      table("Sizes that would be found", ["effect", "where", "seen from", "which is a torque of [N·m, N]", "mistaken for"], sizes, [0, 1, 4])),
    button("Look again", () => app.act("diagnose")));
}
