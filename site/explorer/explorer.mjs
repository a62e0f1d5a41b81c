// The page: what the visitor chooses becomes a state, the state an address and a request, the reply what is shown.
import { USUAL, understood, written } from "./address.mjs";
import { showAnswer } from "./answer.mjs";
import { Editor } from "./editor.mjs";
import { byId, fill, labelled, option, toggle } from "./elements.mjs";
import { ask, ready } from "./python.mjs";

const EFFECTS = {
  viscous: "viscous friction", coulomb: "Coulomb friction", offset: "offset", rotor_inertia: "rotor inertia",
  spring: "spring",
};
const LARGEST = 4e6; // bytes of a file

let state; // robot (of the list) or name and text (own), and changes
let texts = {}; // of robots of the list, by name
let robots = {}; // of the list, each with its pages in the zoo
let shown = null; // the answer on the page
let answers = 0; // on the page, errors among them
let arm = null;
const SENSORS = ["file", "joints", "base"]; // beside the links whose wrench is measured
let since = null; // seconds of the visit until Echelon could answer
let editor;

// -- from state to answer ----------------------------------------------------------------------------------------------

let running = false; // one request at a time; of what is chosen meanwhile the last counts
let pending = false;

async function update({ fresh = false, keep = false } = {}) {
  if (fresh) shown = null;
  if (!keep) history.pushState(null, "", `#${await written(state)}`);
  showChoices();
  pending = true;
  if (running) return;
  running = true;
  while (pending) {
    pending = false;
    await deriveOnce();
  }
  running = false;
}

async function deriveOnce() {
  const answer = byId("answer");
  answer.setAttribute("aria-busy", "true");
  if (since) byId("status").textContent = "Deriving …";
  const started = performance.now();
  const request = await requested();
  const reply = request.error ? request : await answered(request);
  if (pending) return;
  answer.removeAttribute("aria-busy");
  if (reply.error) return showError(reply.error);
  const seconds = performance.now() / 1000 - Math.max(started / 1000, since ?? 0);
  byId("error").hidden = true;
  byId("result").hidden = byId("arm").hidden = byId("counts").hidden = false;
  byId("status").textContent = since
    ? `Answered in ${seconds.toFixed(2)} s; ready ${since.toFixed(1)} s after the visit began.`
    : "Answered when this page was built; Python is loading …";
  showAnswer(reply, shown, { preferred: state.changes.prefer, prefer, light });
  shown = reply;
  showChoices();
  await draw(reply);
  answer.dataset.answered = ++answers;
}

/** The reply of Echelon, or before it is ready the one that the page brings for the first robot as its file describes it. */
async function answered(request) {
  const first = state.robot && state.robot === Object.keys(robots)[0];
  const usual = JSON.stringify(request.changes) === JSON.stringify(USUAL);
  return !since && first && usual ? (await fetch("robots/first.json")).json() : ask(request);
}

async function requested() {
  const { robot, changes } = state;
  if (!robot) return { name: state.name, text: state.text, changes };
  if (!Object.hasOwn(robots, robot)) return { error: `echelon: there is no robot '${robot}' here` };
  texts[robot] ??= await (await fetch(`robots/${encodeURIComponent(robot)}`)).text();
  if (state.robot === robot && !editor.touched) editor.text = texts[robot];
  return { name: robot, text: texts[robot], changes };
}

function showError(text) {
  byId("error").textContent = text;
  byId("error").hidden = false;
  byId("result").hidden = byId("arm").hidden = byId("counts").hidden = true;
  byId("headline").textContent = "No answer";
  byId("status").textContent = "";
  byId("answer").removeAttribute("aria-busy");
  byId("answer").dataset.answered = ++answers;
}

async function draw(reply) {
  byId("no-picture").hidden = Boolean(reply.picture);
  if (!reply.picture) {
    byId("no-picture").lastChild.textContent = "lengths have no values, or loops do not close.";
    return;
  }
  try {
    const { Arm } = await import("./arm.mjs");
    arm ??= new Arm(byId("canvas"), byId("legend"), light);
    arm.show(reply);
  } catch (error) {
    byId("canvas").hidden = true;
    byId("no-picture").hidden = false;
    byId("no-picture").lastChild.textContent = error.message;
  }
}

/** Show one link in the table and in the drawing. */
function light(index) {
  for (const row of byId("table").rows) row.classList.toggle("lit", row.dataset.body === String(index));
  arm?.light(index);
}

// -- what can be changed -----------------------------------------------------------------------------------------------

const set = (changes) => {
  Object.assign(state.changes, changes);
  update();
};
const switched = (values, value) => (values.includes(value) ? values.filter((v) => v !== value) : [...values, value]);
const prefer = (name) => set({ prefer: switched(state.changes.prefer, name) });

function showChoices() {
  const { changes } = state;
  byId("choice").value = state.robot ?? "";
  const pages = robots[state.robot] ?? [];
  const page = pages.find((slug) => slug.endsWith("-floating") === changes.floating) ?? pages[0];
  byId("page").hidden = !page;
  if (page) byId("page").firstChild.href = `../zoo/${page}/index.html`;
  byId("floating").checked = changes.floating;
  const stated = [...byId("gravity").options].some((o) => o.value === changes.gravity && o.value !== "own");
  byId("gravity").value = stated ? changes.gravity : "own";
  byId("own-gravity").hidden = stated;
  if (!stated) byId("vector").value = changes.gravity;
  byId("sense-file").checked = !changes.sensors.length || changes.sensors.includes("file");
  byId("sense-joints").checked = changes.sensors.includes("joints");
  byId("sense-base").checked = changes.sensors.includes("base");
  byId("order").value = changes.order;
  const { links = [], joints = [], lengths = [] } = shown ?? {};
  const wrist = changes.sensors.find((name) => !SENSORS.includes(name)) ?? "";
  for (const [id, link] of [["wrist", wrist], ["payload", changes.payload]]) {
    fill(byId(id), [option("", "no link"), ...links.map((name) => option(name))]).value = link;
  }
  toggles("joints", joints, changes.locked, (name) => set({ locked: switched(changes.locked, name) }));
  toggles("effects", Object.keys(EFFECTS), changes.effects, (n) => set({ effects: switched(changes.effects, n) }), EFFECTS);
  toggles("prefer", changes.prefer, changes.prefer, prefer);
  const kept = Object.fromEntries(changes.beside.map((text, k) => [text, `${k + 1}: ${words(JSON.parse(text))}`]));
  toggles("beside", changes.beside, changes.beside, (text) => set({ beside: switched(changes.beside, text) }), kept);
  const names = lengths.map(([name]) => name);
  const values = Object.fromEntries(lengths.map(([name, value]) => [name, value === null ? name : `${name} = ${value}`]));
  toggles("lengths", names, changes.zero, (name) => set({ zero: switched(changes.zero, name) }), values);
  for (const id of ["first", "second"]) {
    const before = byId(id).value;
    fill(byId(id), names.map((name) => option(name)));
    byId(id).value = names.includes(before) ? before : (names[id === "first" ? 0 : 1] ?? "");
  }
  byId("lengths-set").hidden = !names.length && !changes.zero.length;
  const pairs = changes.equal.map(([a, b]) => toggle(`${a} = ${b}`, true, () =>
    set({ equal: changes.equal.filter(([c, d]) => c !== a || d !== b) })));
  fill(byId("equals"), pairs);
}

function toggles(id, names, on, act, words = {}) {
  const focused = document.activeElement?.closest(`#${id}`) ? document.activeElement.dataset.name : null;
  fill(byId(id), names.map((name) => toggle(words[name] ?? name, on.includes(name), () => act(name), name)));
  if (focused) [...byId(id).children].find((button) => button.dataset.name === focused)?.focus();
}

/** A kept experiment in words. */
function words({ gravity, locked, payload, sensors }) {
  const said = [gravity === "file" ? "as mounted" : `gravity ${gravity}`];
  if (locked.length) said.push(`${locked.join(", ")} held`);
  if (payload) said.push(`payload on ${payload}`);
  if (sensors.length) said.push(sensors.map((name) => (name === "file" ? "sensors of the file" : name)).join(", "));
  return said.join("; ");
}

function keep() {
  const { gravity, locked, payload, sensors, beside } = state.changes;
  const text = JSON.stringify({ gravity, locked, payload, sensors });
  if (!beside.includes(text)) set({ beside: [...beside, text] });
}

function wire() {
  const sensed = () => {
    const chosen = [...SENSORS.filter((name) => byId(`sense-${name}`).checked), byId("wrist").value].filter(Boolean);
    return chosen.length === 1 && chosen[0] === "file" ? [] : chosen;
  };
  byId("choice").onchange = () => choose({ robot: byId("choice").value });
  byId("floating").onchange = ({ target }) => set({ floating: target.checked });
  byId("gravity").onchange = ({ target }) => set({ gravity: target.value === "own" ? "0,0,-9.80665" : target.value });
  byId("vector").onchange = ({ target }) => set({ gravity: target.value || "none" });
  for (const id of [...SENSORS.map((name) => `sense-${name}`), "wrist"]) byId(id).onchange = () => set({ sensors: sensed() });
  byId("payload").onchange = ({ target }) => set({ payload: target.value });
  byId("order").onchange = ({ target }) => set({ order: target.value });
  byId("equate").onclick = () => {
    const pair = [byId("first").value, byId("second").value];
    if (pair[0] && pair[1] && pair[0] !== pair[1]) set({ equal: [...state.changes.equal, pair] });
  };
  byId("keep").onclick = keep;
  byId("reset").onclick = () => set(structuredClone(USUAL));
  byId("share").onclick = async () => {
    await navigator.clipboard.writeText(location.href).catch(() => {});
    byId("shared").textContent = "The link in the address bar holds everything.";
  };
  for (const button of document.querySelectorAll("[data-file]")) button.onclick = () => download(button.dataset.file);
  byId("changes").onsubmit = (event) => event.preventDefault();
  byId("robot").onsubmit = (event) => {
    event.preventDefault();
    chooseText(editor.text.trimStart().startsWith("<") ? "robot.urdf" : "robot.yaml", editor.text);
  };
  wireFiles();
}

function wireFiles() {
  const drop = byId("drop");
  byId("file").onchange = ({ target }) => take(target.files[0]);
  for (const kind of ["dragenter", "dragover", "dragleave", "drop"]) {
    addEventListener(kind, (event) => {
      event.preventDefault();
      drop.classList.toggle("over", kind === "dragenter" || kind === "dragover");
      if (kind === "drop") take(event.dataTransfer.files[0]);
    });
  }
}

async function take(file) {
  if (!file) return;
  if (file.size > LARGEST) return showError(`echelon: ${file.name}: the file is too large for the explorer`);
  editor.text = await file.text();
  chooseText(file.name, editor.text);
}

const chooseText = (name, text) => choose({ robot: null, name, text });

function choose(robot) {
  if (robot.robot) editor.touched = false;
  state = { ...robot, changes: structuredClone(USUAL) };
  update({ fresh: true });
}

async function download(file) {
  const reply = await ask({ ...(await requested()), file });
  if (reply.error) return showError(reply.error);
  for (const [name, text] of Object.entries(reply.files)) {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([text]));
    link.download = name.replace(/[^\w.-]/g, "_");
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  }
}

// -- the visit begins --------------------------------------------------------------------------------------------------

async function visit() {
  state = await understood(location.hash);
  if (!state.robot && state.text === null) state.robot = Object.keys(robots)[0];
  if (state.text !== null) editor.text = state.text;
  await update({ fresh: true, keep: true });
}

async function begin() {
  ready.then(async (seconds) => {
    since = seconds;
    import("./arm.mjs").catch(() => {}); // it is fetched while the first answer is derived; who draws says why not
    if (running || !shown) return;
    byId("status").textContent = `Ready ${since.toFixed(1)} s after the visit began.`;
    await ask(await requested()); // the first click finds everything imported
  }).catch((error) => showError(`echelon: ${error.message}`));
  editor = new Editor(byId("editor"), byId("words"), await (await fetch("robot.schema.json")).json());
  robots = await (await fetch("robots/robots.json")).json();
  fill(byId("choice"), [option("", "own file"), ...Object.keys(robots).map((name) => option(name))]);
  labelled("marks", [["●", "alone"], ["◐", "in combination"], ["·", "not at all"]]);
  wire();
  addEventListener("popstate", visit);
  await visit();
}

begin();
