// The answer on the page: counts, what changed, the table, closed forms, evidence.
import { byId, element, fill } from "./elements.mjs";
import katex from "./vendor/katex.mjs";

const MARKS = { alone: "●", combined: "◐", unseen: "·" };
const WORDS = { alone: "identifiable alone", combined: "identifiable in combination", unseen: "not identifiable" };
const OPEN = 120; // closed forms that are shown at once; of larger robots one opens links one by one

/** Show a reply; `before` is the last one, or null for another robot. */
export function showAnswer(reply, before, { preferred, prefer, light }) {
  byId("headline").textContent = reply.headline;
  const alone = Object.values(reply.classes).filter((kind) => kind === "alone").length;
  byId("counts").textContent = `${counted(reply.rank, "combination")}; ${counted(alone, "parameter")} known alone`;
  const moved = changed(reply, before);
  byId("changed").hidden = !before;
  fill(byId("differences"), sentences(reply, before, moved).map((text) => element("li", {}, text)));
  table(reply, moved, preferred, prefer, light);
  forms(reply);
  fill(byId("facts"), reply.facts.flatMap(([label, text]) => [element("dt", {}, label), element("dd", {}, ...linked(text))]));
}

const counted = (count, what) => `${count} ${what}${count === 1 ? "" : "s"}`;

/** A text in which files of the documentation are links to its pages. */
function linked(text) {
  const parts = text.split(/\bdocs\/([\w-]+)\.md\b/);
  return parts.map((part, k) => (k % 2 ? element("a", { href: `../${part}.html` }, part) : part));
}

// -- what changed ------------------------------------------------------------------------------------------------------

const STEPS = {
  won: (a, b) => a === "unseen" && b !== "unseen",
  lost: (a, b) => a !== "unseen" && b === "unseen",
  merged: (a, b) => a === "alone" && b === "combined",
  parted: (a, b) => a === "combined" && b === "alone",
  added: (a, b) => a === undefined && b !== undefined,
  removed: (a, b) => a !== undefined && b === undefined,
};

/** Parameters by what the last change did to them. */
function changed(reply, before) {
  const found = Object.fromEntries(Object.keys(STEPS).map((step) => [step, []]));
  if (!before) return found;
  for (const name of new Set([...Object.keys(before.classes), ...Object.keys(reply.classes)])) {
    const [a, b] = [before.classes[name], reply.classes[name]];
    const step = a === b ? null : ["added", "removed"].find((s) => STEPS[s](a, b)) ??
      Object.keys(STEPS).find((s) => STEPS[s](a, b));
    if (step) found[step].push(name);
  }
  return found;
}

function sentences(reply, before, moved) {
  if (!before) return [];
  const said = [`Base parameters: ${before.rank} → ${reply.rank}.`];
  for (const [step, names] of Object.entries(moved)) if (names.length) said.push(`${step}: ${names.join(", ")}`);
  const was = new Map(before.forms.map((form) => [form.name, form.text]));
  const other = reply.forms.filter((form) => was.get(form.name) !== form.text).map((form) => form.name);
  const gone = before.forms.filter((old) => !reply.forms.some((form) => form.name === old.name)).map((form) => form.name);
  if (other.length) said.push(`new or other closed forms: ${other.join(", ")}`);
  if (gone.length) said.push(`no representatives any more: ${gone.join(", ")}`);
  return said;
}

// -- the table ---------------------------------------------------------------------------------------------------------

function table(reply, moved, preferred, prefer, light) {
  const focused = document.activeElement?.dataset?.parameter;
  const touched = new Set(Object.values(moved).flat());
  const cell = (name, kind) => {
    const button = element("button", { type: "button", className: kind, title: `${name}: ${WORDS[kind]}` }, MARKS[kind]);
    button.setAttribute("aria-label", `${name}: ${WORDS[kind]}; prefer as representative`);
    button.setAttribute("aria-pressed", preferred.includes(name));
    button.dataset.parameter = name;
    button.classList.toggle("moved", touched.has(name));
    button.onclick = () => prefer(name);
    return element("td", {}, button);
  };
  const head = element("tr", {}, ...["link", ...reply.kinds].map((text) => element("th", { scope: "col" }, text)));
  const rows = reply.bodies.map((body) => {
    const title = element("th", { scope: "row", title: body.words }, `${body.label}  ${body.name}`);
    const cells = body.cells.map((kind, k) => (kind ? cell(`${reply.kinds[k]}${body.label}`, kind) : element("td")));
    const row = element("tr", { onmouseenter: () => light(body.index), onfocusin: null }, title, ...cells);
    row.addEventListener("focusin", () => light(body.index));
    row.dataset.body = body.index;
    return row;
  });
  const inertial = new Set(reply.bodies.flatMap((body) => reply.kinds.map((kind) => `${kind}${body.label}`)));
  const others = Object.entries(reply.classes).filter(([name]) => !inertial.has(name));
  const drives = others.map(([name, kind]) => element("tr", {}, element("th", { scope: "row" }, name), cell(name, kind)));
  fill(byId("table"), [element("thead", {}, head), element("tbody", {}, ...rows, ...drives)]);
  if (focused) [...byId("table").querySelectorAll("button")].find((b) => b.dataset.parameter === focused)?.focus();
}

// -- closed forms ------------------------------------------------------------------------------------------------------

function forms(reply) {
  const numbered = reply.forms.map((form, k) => ({ ...form, number: k + 1 }));
  const titles = new Map(reply.bodies.map((body) => [body.index, `link ${body.label}, ${body.name}`]));
  const groups = new Map([...titles.values()].map((title) => [title, []]));
  for (const form of numbered) {
    const title = titles.get(form.body) ?? "drives and joints";
    groups.set(title, [...(groups.get(title) ?? []), form]);
  }
  const some = [...groups].filter(([, list]) => list.length);
  fill(byId("forms"), some.map(([title, list]) => group(title, list, reply.forms.length <= OPEN)));
}

function group(title, some, open) {
  const list = element("ol", { start: some[0].number });
  const folded = element("details", {}, element("summary", {}, `${title} (${some.length})`), list);
  folded.addEventListener("toggle", () => list.childElementCount || list.append(...some.map(line)));
  if (open) list.append(...some.map(line));
  folded.open = open;
  return folded;
}

function line(form) {
  const formula = element("span");
  katex.render(form.latex, formula, { throwOnError: false, trust: false, maxExpand: 100 });
  const item = element("li", { value: form.number }, formula, element("small", {}, form.unit));
  item.dataset.text = form.text;
  return item;
}
