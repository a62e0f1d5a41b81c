// Small helpers for elements.  Text from files and from Echelon becomes text nodes, never markup.

export const byId = (id) => document.getElementById(id);

/** A new element with properties and children, which are elements or text. */
export function element(tag, properties = {}, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}

export const option = (value, words = value) => element("option", { value }, words);

/** Replace all children. */
export function fill(parent, children) {
  parent.replaceChildren(...children);
  return parent;
}

/** A button that is on or off. */
export function toggle(words, on, act, name = words) {
  const button = element("button", { type: "button", onclick: act }, words);
  button.dataset.name = name;
  button.setAttribute("aria-pressed", on);
  return button;
}

/** A legend of marks and words. */
export function labelled(id, pairs) {
  fill(byId(id), pairs.map(([mark, words]) => element("span", {}, `${mark} ${words}`)));
}
