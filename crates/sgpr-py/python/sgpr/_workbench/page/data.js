// Robot, logs, check, split, fit.

import { upload } from "./api.js";
import { button, choice, fill, h, number, prose, table, words } from "./dom.js";

const ROLES = [["train", "train"], ["test", "test"], ["off", "not used"]];

function counts(state) {
  const of = (role) => state.logs.filter((log) => log.role === role && !log.problem).length;
  return `${of("train")} to train, ${of("test")} to test`;
}

const ready = (state) => state.robot.joints.length > 0 && state.logs.some((log) => log.role === "train" && !log.problem);

function lead(state, app) {
  const robot = state.robot.joints.length ? `${state.robot.name}, ${state.robot.joints.length} joints` : "no robot yet";
  const fitted = state.steps.length > 1;
  const rest = state.logs.some((log) => log.role === "test") ? "" : " No log tests: errors are then those on logs that the fit has seen.";
  const broken = state.logs.filter((log) => stopped(log, state).length).length;
  return h("div", { class: broken ? "verdict bad" : "verdict" },
    h("p", { class: "lead" }, `Robot: ${robot}. Logs: ${counts(state)}.${rest}`),
    broken ? h("p", {}, `${broken} ${broken === 1 ? "log has" : "logs have"} to be repaired, or read in another way, before the fit:`) : null,
    reasons(state).map((text) => h("p", { class: "soft" }, text)),
    h("div", { class: "bar" },
      button(fitted ? "Compare the models" : "Fit the model", async () => {
        if (fitted) app.go("compare");
        else if (await app.act("fit", { effects: state.usual_effects })) app.go("compare");
      }, { class: "main", disabled: !ready(state) || Boolean(state.job) }),
      fitted ? null : h("span", { class: "soft" }, `with ${state.usual_effects.map(words).join(", ")}`)),
    proposals(state, app));
}

// Why a log cannot be used.
function stopped(log, state) {
  if (log.role === "off" || (log.unread && state.job)) return [];
  return [log.problem, ...log.issues.filter((issue) => issue.rank === "stop").map((issue) => issue.text)].filter(Boolean);
}

// Why logs cannot be used, each reason once.
function reasons(state) {
  const found = new Map();
  for (const log of state.logs) {
    for (const text of stopped(log, state)) {
      const key = alike(text);
      found.set(key, { text, names: [...(found.get(key)?.names ?? []), log.name] });
    }
  }
  return [...found.values()].map(({ text, names }) => `${names.length > 1 ? `${names.length} logs` : names[0]}: ${text}`);
}

export const robotStage = {
  update(root, state, app) {
    const names = state.robot.choices.map((name) => [name, name]);
    if (!state.robot.name) names.unshift(["", "choose"]);
    fill(root, h("h2", {}, "Robot and logs"), lead(state, app),
      h("div", { class: "bar" }, choice("Robot", "robot", names, state.robot.name ?? "", (name) => name && app.act("set_robot", { name }))),
      state.robot.problem ? h("p", { class: "bad" }, state.robot.problem) : null,
      state.robot.joints.length ? h("p", { class: "soft" }, `Joints: ${state.robot.joints.join(", ")}`) : null,
      state.robot.warnings.map((text) => h("p", { class: "soft" }, ...prose(text))),
      h("h3", {}, "Logs"), state.logs.length ? logTable(state, app) : h("p", {}, "There is no log in the folder yet."),
      drop(app), state.logs.map((log) => reading(log, app)));
  },
};

function logTable(state, app) {
  const rows = state.logs.map((log) => [
    log.name,
    choice("", `role ${log.name}`, ROLES, log.role, (role) => app.act("set_role", { name: log.name, role })),
    String(log.samples), number(log.seconds, 4), log.rate ? number(log.rate, 4) : "–",
    log.unread && state.job ? "is being read" : log.problem ? h("span", { class: "bad", title: log.problem }, log.unread ? log.problem : "cannot be read") : state_of(log),
  ]);
  const shown = table("Logs", ["log", "use", "samples", "length [s]", "rate [Hz]", "state"], rows, [0, 1, 5]);
  shown.querySelectorAll("select").forEach((select, k) => select.setAttribute("aria-label", `Use of ${state.logs[k].name}`));
  return shown;
}

function state_of(log) {
  const stops = log.issues.filter((issue) => issue.rank === "stop").length;
  const looks = log.issues.filter((issue) => issue.rank === "look").length;
  if (stops) return h("span", { class: "bad" }, `${stops} to repair`);
  return looks ? `${looks} to look at` : "in order";
}

export function proposals(state, app) {
  if (!state.proposals.length) return null;
  return h("section", { "aria-label": "Proposals" }, h("p", {}, "The checks propose:"),
    h("div", { class: "bar" }, state.proposals.map((one) => button(one.title, () => app.act("set_reading", { name: "", settings: merged(one.settings, state) })))),
    h("p", { class: "soft" }, "For all logs of the folder; kept in sgpr.toml, and taken back under “How … is read”."));
}

// Findings that are right add to those that were confirmed before.
function merged(settings, state) {
  if (!settings.accept) return settings;
  return { ...settings, accept: [...new Set([...state.logs.flatMap((log) => log.settings.accept ?? []), ...settings.accept])] };
}

function drop(app) {
  const take = async (files) => {
    for (const file of files) {
      try { await upload(file); } catch (error) { app.notice(error.message); }
    }
    app.act("look_again");
  };
  const input = h("input", { type: "file", multiple: true, id: "files", onchange: (event) => take(event.target.files) });
  return h("div", {
    class: "drop",
    ondragover: (event) => { event.preventDefault(); event.currentTarget.classList.add("over"); },
    ondragleave: (event) => event.currentTarget.classList.remove("over"),
    ondrop: (event) => { event.preventDefault(); event.currentTarget.classList.remove("over"); take(event.dataTransfer.files); },
  }, h("label", { for: "files" }, "Drop logs or a robot file here, or choose them: "), input,
  h("p", { class: "soft" }, "They are copied into the folder. ", button("Look into the folder again", () => app.act("look_again"))));
}

const REPAIRS = ["sort", "drop_duplicates", "drop_not_finite", "replace_strays", "drop_repeated", "unwrap"];
const QUANTITIES = [["time", "ms, us, ns"], ["position", "deg"], ["velocity", "rpm, deg/s"], ["torque", "mNm"]];

function reading(log, app) {
  const settings = log.settings;
  const inputs = [];
  const field = (label, id, value, hint) => {
    const input = h("input", { type: "text", id: `${log.name} ${id}`, value: value ?? "", placeholder: hint });
    inputs.push([id, input]);
    return [h("label", { for: `${log.name} ${id}` }, label), input];
  };
  const listed = (value) => (Array.isArray(value) ? value.join(", ") : value ?? "");
  const constants = settings.torque_constants;
  const fields = [
    ...QUANTITIES.flatMap(([key, hint]) => field(`unit of ${key}`, `units.${key}`, settings.units?.[key], hint)),
    ...QUANTITIES.flatMap(([key]) => field(`columns of ${key}`, `columns.${key}`, listed(settings.columns?.[key]), "pattern such as q{} or names, with commas")),
    ...field("torque constants [N·m/A]", "torque_constants",
      Array.isArray(constants) ? constants.join(", ") : Object.entries(constants ?? {}).map(([k, v]) => `${k}=${v}`).join(", "), "9.6, 9.6, 6.0 or elbow=9.6"),
    ...field("samples per second, of a log without time [Hz]", "rate", settings.sample_rate_hz, "100"),
    ...field("resample at [Hz]", "resample", settings.resample, "median, or a rate"),
    ...field("cut at gaps longer than [s]", "split_gaps", settings.split_gaps, "0.1"),
    ...field("keep from, to [s]", "trim", listed(settings.trim), "2, 18"),
    ...field("repairs", "repairs", REPAIRS.filter((name) => settings[name]).join(", "), REPAIRS.join(", ")),
    ...field("findings that are right", "accept", listed(settings.accept), "joints_by_order, position_in_degrees"),
  ];
  const apply = (name) => () => app.act("set_reading", { name, settings: settingsFrom(inputs) });
  const first = app.state.logs.find((other) => other.role !== "off" && other.problem && !other.unread);
  return h("details", { open: log === first && !app.state.job },
    h("summary", { "data-key": `reading ${log.name}` }, `How ${log.name} is read`),
    h("p", {}, log.layout || (log.problem ?? "By the names in the file.")),
    log.said.map((text) => h("p", { class: "soft" }, text)),
    h("div", { class: "form" }, fields),
    h("div", { class: "bar" }, button("Read it like this", apply(log.name), { "data-key": `apply ${log.name}` }),
      button("Read all logs like this", apply(""), { "data-key": `apply all ${log.name}` }),
      h("span", { class: "soft" }, "kept in sgpr.toml, which all commands read")));
}

function settingsFrom(inputs) {
  const found = { units: {}, columns: {} };
  const parts = (text) => text.split(",").map((part) => part.trim()).filter(Boolean);
  for (const [id, input] of inputs) {
    const text = input.value.trim();
    if (id.startsWith("units.")) { if (text) found.units[id.slice(6)] = text; }
    else if (id.startsWith("columns.")) { if (text) found.columns[id.slice(8)] = text.includes(",") ? parts(text) : text; }
    else if (id === "accept") found.accept = parts(text);
    else if (id === "repairs") for (const name of REPAIRS) found[name] = parts(text).includes(name) || null;
    else if (id === "resample") found.resample = text === "" || text === "median" ? text : Number(text);
    else if (id === "rate") found.rate = text === "" ? null : Number(text);
    else if (id === "split_gaps") found.split_gaps = text === "" ? null : Number(text);
    else if (id === "trim") found.trim = text === "" ? null : parts(text).map(Number);
    else if (text.includes("=")) found.torque_constants = Object.fromEntries(parts(text).map((part) => [part.split("=")[0], Number(part.split("=")[1])]));
    else found.torque_constants = parts(text).map(Number);
  }
  return found;
}

const alike = (text) => text.replaceAll(/[\d.]+(e-?\d+)?/g, "#");

// What is said of several logs and differs only in its numbers stands once.
function sameOnce(logs) {
  const found = new Map();
  for (const log of logs) {
    for (const { rank, text } of log.issues) {
      const key = `${rank} ${alike(text)}`;
      if (!found.has(key)) found.set(key, { rank, text, names: [], others: [] });
      found.get(key).names.push(log.name);
      found.get(key).others.push(`${log.name}: ${text}`);
    }
  }
  const order = { stop: 0, look: 1, know: 2 };
  return [...found.values()].sort((a, b) => order[a.rank] - order[b.rank]).map(({ rank, text, names, others }) => [
    rank, names.length > 1 ? `${names[0]} and ${names.length - 1} more` : names[0],
    names.length > 1 ? [prose(text), h("details", {}, h("summary", { "data-key": `all ${rank} ${text}` }, `In all ${names.length}`), others.map((each) => h("p", {}, prose(each))))] : prose(text),
  ]);
}

export const checkStage = {
  update(root, state, app) {
    const issues = sameOnce(state.logs);
    fill(root, h("h2", {}, "Check and split"), lead(state, app),
      h("p", {}, "Logs that test are not used to learn: their error is what a new motion would see."),
      state.logs.length ? logTable(state, app) : null,
      h("h3", {}, "What the checks found"),
      issues.length ? table("Findings in the logs", ["rank", "log", "finding"], issues, [0, 1, 2]) : h("p", {}, "Nothing is wrong with the logs."),
      h("h3", {}, "What the physics says"),
      state.checks.excitation ? h("p", {}, `In the training logs ${state.checks.excitation}.`) : h("p", { class: "soft" }, "After the first fit: how well the motion excites the parameters, and what is suspicious."),
      (state.checks.texts ?? []).map((text) => h("p", {}, prose(text))));
  },
};

let chosen = null;

export const fitStage = {
  update(root, state, app) {
    chosen ??= new Set(state.usual_effects);
    const boxes = state.effects.map((effect) => h("label", { class: "soft", title: effect.summary },
      h("input", { type: "checkbox", "data-key": effect.name, checked: chosen.has(effect.name),
        onchange: (event) => (event.target.checked ? chosen.add(effect.name) : chosen.delete(effect.name)) }), ` ${words(effect.name)}`));
    const start = async () => {
      const effects = state.effects.map((each) => each.name).filter((name) => chosen.has(name));
      if (await app.act("fit", { effects })) app.go("compare");
    };
    fill(root, h("h2", {}, "Fit"), lead(state, app),
      h("p", {}, "Inertia and gravity of all links are always fitted. Effects that every joint has from the start:"),
      h("div", { class: "bar" }, boxes),
      button(state.steps.length > 1 ? "Fit once more" : "Fit with these", start, { disabled: !ready(state) || Boolean(state.job) }),
      h("p", { class: "soft" }, "An effect at a single joint is better added later, when the diagnosis has found it."));
  },
};
