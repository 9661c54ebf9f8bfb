// The frame: stages, progress, notices; each stage draws itself from the state of the server.

import { post, getJson } from "./api.js";
import { button, fill, h } from "./dom.js";
import * as compare from "./compare.js";
import * as data from "./data.js";
import * as fails from "./fails.js";
import * as missing from "./missing.js";
import * as steps from "./steps.js";
import * as take from "./take.js";

const STAGES = [
  ["robot", "Robot and logs", data.robotStage, (s) => s.robot.joints.length && s.logs.some((log) => !log.problem)],
  ["check", "Check and split", data.checkStage, (s) => s.logs.some((log) => log.role === "train") && s.logs.some((log) => log.role === "test")],
  ["fit", "Fit", data.fitStage, (s) => s.steps.length > 1],
  ["compare", "Compare", compare, (s) => s.steps.length > 1],
  ["fails", "Where it fails", fails, (s) => s.steps.length > 1],
  ["missing", "What is missing", missing, (s) => s.diagnosis],
  ["steps", "Add, watch, take back", steps, (s) => s.steps.some((step) => step.after)],
  ["take", "Take away", take, () => false],
];

const app = { state: null, stage: null, go, act, notice, cancel: () => post("cancel") };
let said = null;
let lost = 0;
let waiting = false;

function go(name) {
  const stage = STAGES.find(([each]) => each === name) ?? STAGES[0];
  app.stage = stage[0];
  if (location.hash !== `#${stage[0]}`) history.replaceState(null, "", `#${stage[0]}`);
  const root = document.getElementById("stage");
  root.replaceChildren();
  stage[2].mount?.(root, app);
  stage[2].update(root, app.state, app);
  drawStages();
  root.focus({ preventScroll: true });
  scrollTo(0, 0);
}

async function act(action, values = {}) {
  said = null;
  try {
    take_up(await post(`do/${action}`, values));
    poll();
    return true;
  } catch (error) {
    notice(error.message);
    return false;
  }
}

function notice(text) {
  said = text;
  drawNotices();
}

function take_up(state) {
  app.state = state;
  document.getElementById("folder").textContent = state.folder;
  document.title = `${state.folder} – sgpr workbench`;
  drawJob(state.job);
  drawNotices();
  drawStages();
  const root = document.getElementById("stage");
  // What somebody writes is not taken from under his hands.
  const writes = root.contains(document.activeElement) && document.activeElement.matches("input[type=text], input[type=number]");
  waiting = writes;
  if (!writes) STAGES.find(([name]) => name === app.stage)[2].update(root, state, app);
}

document.addEventListener("focusout", () => setTimeout(() => { if (waiting && app.state) take_up(app.state); }, 50));

function drawStages() {
  fill(document.getElementById("stages"), STAGES.map(([name, title, , done], k) => h("li", {},
    h("button", { type: "button", "data-key": name, "aria-current": app.stage === name ? "step" : null, onclick: () => go(name) },
      h("span", { class: "mark", "aria-hidden": "true" }, app.state && done(app.state) ? "✓" : String(k + 1)), title,
      app.state && done(app.state) ? h("span", { class: "skip" }, " (done)") : null))));
}

function drawJob(job) {
  const place = document.getElementById("job");
  if (!job) { place.replaceChildren(); delete place.dataset.busy; return; }
  if (place.dataset.busy !== job.title) {
    place.dataset.busy = job.title;
    fill(place, h("span", { id: "job-text" }), h("progress", { "aria-label": job.title }),
      button("Cancel", () => app.cancel()));
  }
  const bar = place.querySelector("progress");
  const left = job.left === null || job.stops ? "" : `, about ${Math.max(1, job.left)} s left of this stage`;
  const of = job.total > 1 ? ` ${job.done} of ${job.total}` : "";
  const text = `${job.title}: ${job.stops ? "stops" : `${job.stage || "begins"}${of}`}, ${Math.round(job.seconds)} s${left}`;
  place.querySelector("#job-text").textContent = text;
  if (job.total > 0) { bar.max = job.total; bar.value = job.done; } else bar.removeAttribute("value");
}

function drawNotices() {
  const state = app.state;
  const texts = [said, state?.message?.text, state?.unsaved,
    lost > 2 ? "The server is gone. Nothing is lost: start `sgpr workbench` again, and open the address that it prints." : null];
  fill(document.getElementById("notices"), texts.filter(Boolean).map((text) => h("div", { role: "alert" }, text,
    text === said ? button("Close", () => notice(null)) : null)));
}

let timer = null;
async function poll() {
  clearTimeout(timer);
  let busy = false;
  try {
    const state = await getJson("state", { version: app.state?.version ?? "" });
    if (lost) { lost = 0; drawNotices(); }
    busy = Boolean(state.job);
    if (!state.same) take_up(state);
    else drawJob(state.job);
  } catch (error) {
    lost += 1;
    if (lost === 3) drawNotices();
  }
  timer = setTimeout(poll, busy ? 250 : 1200);
}

addEventListener("hashchange", () => go(location.hash.slice(1)));
app.state = await getJson("state");
take_up_first();
function take_up_first() {
  const first = location.hash.slice(1) || (app.state.steps.length > 1 ? "steps" : "robot");
  app.stage = STAGES.some(([name]) => name === first) ? first : "robot";
  go(app.stage);
  take_up(app.state);
  poll();
}
