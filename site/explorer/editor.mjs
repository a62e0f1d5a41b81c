// A text area that completes keys and values of robot descriptions from their JSON schema.

/** What may stand at the caret: words with a description, and where the word that they replace begins. */
export function completions(text, caret, schema) {
  const before = text.slice(0, caret);
  const line = before.slice(before.lastIndexOf("\n") + 1);
  const value = /([\w-]+):\s+([\w-]*)$/.exec(line);
  const key = /(?:^\s*(?:- )*|[{,]\s*)([\w-]*)$/.exec(line);
  if (!value && !key) return { from: caret, words: [] };
  const word = (value ? value[2] : key[1]).toLowerCase();
  const path = pathTo(before.slice(0, caret - word.length), value ? value[1] : null);
  const nodes = descend(schema, path);
  const found = value ? valuesOf(nodes, schema) : keysOf(nodes, schema);
  const words = [...found].filter(([name]) => name.toLowerCase().startsWith(word) && name.toLowerCase() !== word);
  return { from: caret - word.length, words, suffix: value ? "" : ": " };
}

/** Keys from the document's top to a place, "[]" for items of lists; `last` is the key whose value is written. */
function pathTo(before, last) {
  const lines = before.split("\n");
  const line = lines.pop();
  const inner = openBrackets(line);
  const found = last ? [...inner, last] : inner;
  let indent = /^\s*(- )*/.exec(line)[0].length;
  if (/^\s*-/.test(line)) found.unshift("[]");
  let item = /^\s*-/.test(line);
  for (const above of lines.reverse()) {
    const parts = /^(\s*)((?:- )*)([\w-]+):/.exec(above);
    if (!parts) continue;
    const depth = parts[1].length + parts[2].length;
    if (depth < indent || (item && !parts[2] && parts[1].length <= indent - 2)) {
      found.unshift(parts[3]);
      indent = depth;
      item = Boolean(parts[2]);
      if (item) found.unshift("[]");
    } else if (parts[2] && depth === indent && !item) {
      found.unshift("[]"); // this line goes on with an item that began above
      item = true;
    }
  }
  return found;
}

/** The flow collections {…} and […] that are open at a line's end, by the keys that hold them. */
function openBrackets(line) {
  const stack = [];
  for (const [, key, bracket] of line.matchAll(/(?:([\w-]+):\s*)?([{}[\]])/g)) {
    if (bracket === "{") stack.push(key ? [key] : []);
    else if (bracket === "[") stack.push(key ? [key, "[]"] : ["[]"]);
    else stack.pop();
  }
  return stack.flat();
}

/** All alternatives of a part of the schema. */
function parts(node, schema, depth = 0) {
  if (!node || depth > 8) return [];
  if (node.$ref) return parts(schema.$defs[node.$ref.split("/").pop()], schema, depth + 1);
  const some = [...(node.anyOf ?? []), ...(node.oneOf ?? []), ...(node.allOf ?? [])];
  return [node, ...some.flatMap((other) => parts(other, schema, depth + 1))];
}

function descend(schema, path) {
  let nodes = parts(schema, schema);
  for (const step of path) {
    const next = nodes.map((node) => (step === "[]" ? node.items : (node.properties?.[step] ?? node.additionalProperties)));
    nodes = next.filter((node) => typeof node === "object").flatMap((node) => parts(node, schema));
  }
  return nodes;
}

function keysOf(nodes) {
  const pairs = nodes.flatMap((node) => Object.entries(node.properties ?? {}));
  return new Map(pairs.map(([name, node]) => [name, node.description ?? ""]));
}

function valuesOf(nodes) {
  const words = nodes.flatMap((node) => [...(node.enum ?? []), ...("const" in node ? [node.const] : [])]);
  return new Map(words.filter((word) => typeof word === "string").map((word) => [word, ""]));
}

export class Editor {
  constructor(area, list, schema) {
    Object.assign(this, { area, list, schema, touched: false, chosen: -1, offer: null });
    area.addEventListener("input", () => {
      this.touched = true;
      this.suggest();
    });
    area.addEventListener("keydown", (event) => this.key(event));
    area.addEventListener("blur", () => this.close());
    list.addEventListener("mousedown", (event) => {
      event.preventDefault(); // the text area keeps the focus
      const item = event.target.closest("li");
      if (item) this.accept([...list.children].indexOf(item));
    });
  }

  get text() {
    return this.area.value;
  }

  set text(text) {
    this.area.value = text;
    this.close();
  }

  suggest(asked = false) {
    const { area } = this;
    if (area.value.trimStart().startsWith("<")) return this.close();
    this.offer = completions(area.value, area.selectionStart, this.schema);
    const typed = area.selectionStart > this.offer.from;
    if (!this.offer.words.length || !(typed || asked)) return this.close();
    this.list.replaceChildren(...this.offer.words.map(([name, about], k) => this.item(name, about, k)));
    this.list.hidden = false;
    this.list.style.top = `${this.caretLine() * parseFloat(getComputedStyle(area).lineHeight) + 10 - area.scrollTop}px`;
    area.setAttribute("aria-expanded", "true");
    this.choose(0);
  }

  item(name, about, k) {
    const item = document.createElement("li");
    item.id = `word-${k}`;
    item.setAttribute("role", "option");
    const small = document.createElement("small");
    small.textContent = about.split("\n")[0];
    item.append(name, small);
    return item;
  }

  caretLine() {
    return this.area.value.slice(0, this.area.selectionStart).split("\n").length;
  }

  choose(k) {
    const items = [...this.list.children];
    this.chosen = (k + items.length) % items.length;
    items.forEach((item, other) => item.setAttribute("aria-selected", other === this.chosen));
    items[this.chosen].scrollIntoView({ block: "nearest" });
    this.area.setAttribute("aria-activedescendant", items[this.chosen].id);
  }

  accept(k) {
    const { area, offer } = this;
    area.setRangeText(offer.words[k][0] + offer.suffix, offer.from, area.selectionStart, "end");
    this.touched = true;
    this.close();
  }

  close() {
    this.list.hidden = true;
    this.area.setAttribute("aria-expanded", "false");
    this.area.removeAttribute("aria-activedescendant");
  }

  key(event) {
    if (event.ctrlKey && event.key === "Enter") return this.area.form.requestSubmit();
    if (event.ctrlKey && event.key === " ") {
      event.preventDefault();
      return this.suggest(true);
    }
    if (this.list.hidden) return undefined;
    const act = {
      ArrowDown: () => this.choose(this.chosen + 1), ArrowUp: () => this.choose(this.chosen - 1),
      Enter: () => this.accept(this.chosen), Tab: () => this.accept(this.chosen), Escape: () => this.close(),
    }[event.key];
    if (!act) return undefined;
    event.preventDefault();
    return act();
  }
}
