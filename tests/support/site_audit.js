// What a reader of the page that is open would stumble over; a test adds what else it wants to know.
(async () => {
const rest = (ms) => new Promise((resolve) => setTimeout(resolve, ms));
const channel = (c) => { c /= 255; return c <= 0.03928 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4; };
const light = ([r, g, b]) => 0.2126 * channel(r) + 0.7152 * channel(g) + 0.0722 * channel(b);
const numbers = (text) => (text.match(/[\d.]+/g) ?? [0, 0, 0, 0]).map(Number);
function over(below, above) {
  const [r, g, b, a = 1] = above;
  return [r, g, b].map((c, k) => a * c + (1 - a) * below[k]);
}
function background(element, view) {
  const layers = [];
  for (let e = element; e; e = e.parentElement) layers.unshift(numbers(view.getComputedStyle(e).backgroundColor));
  return layers.reduce(over, [255, 255, 255]);
}
function faint(page, view) {
  const weak = new Set();
  const walker = page.createTreeWalker(page.body, NodeFilter.SHOW_TEXT);
  for (let k = 0; walker.nextNode() && k < 4000; k++) {
    const element = walker.currentNode.parentElement, text = walker.currentNode.textContent.trim();
    if (!text || element.closest("svg, script, style, math, [hidden], .headerlink, [aria-hidden=true]")) continue;
    if (!element.checkVisibility({ opacityProperty: true, visibilityProperty: true })) continue;
    const style = view.getComputedStyle(element), size = parseFloat(style.fontSize);
    const large = size >= 24 || (size >= 18.6 && Number(style.fontWeight) >= 700);
    const behind = background(element, view), ink = over(behind, numbers(style.color));
    const [a, b] = [light(ink), light(behind)].sort((x, y) => y - x);
    const ratio = (a + 0.05) / (b + 0.05);
    if (ratio < (large ? 3 : 4.5)) weak.add(ratio.toFixed(1) + " " + element.tagName + "." + element.className + ": " + text.slice(0, 30));
  }
  return [...weak];
}
const named = (e) => e.textContent.trim() || e.getAttribute("aria-label") || e.title || e.querySelector("img[alt]");
const shown = (page, selector) => [...page.querySelectorAll(selector)].filter((e) => e.checkVisibility({ visibilityProperty: true }));
await rest(120);
const page = document, view = window;
return {
  title: page.title, lang: page.documentElement.lang, headings: shown(page, "h1").length,
  wide: page.documentElement.scrollWidth, room: view.innerWidth,
  unlabelled: shown(page, "input, select, textarea").filter((e) => !e.labels?.length && !e.ariaLabel).map((e) => e.outerHTML.slice(0, 80)),
  nameless: shown(page, "button, a[href]").filter((e) => !named(e)).map((e) => e.outerHTML.slice(0, 80)),
  pictures: shown(page, "img").filter((e) => !e.alt || !e.complete || !e.naturalWidth).map((e) => e.outerHTML.slice(0, 80)),
  unreachable: shown(page, ".scroll, pre").filter((e) => e.scrollWidth > e.clientWidth + 1 && e.tabIndex < 0 && !e.querySelector("[tabindex]")).length,
  links: [...new Set([...page.querySelectorAll("a[href]")].map((e) => new URL(e.getAttribute("href"), page.baseURI).href))].filter((h) => h.startsWith(location.origin)).map((h) => h.slice(location.origin.length)),
  faint: faint(page, view), first: page.querySelector("a[href], button, input, select")?.className ?? "",
  ...(await (ACT)(page, rest)),
};
})()
