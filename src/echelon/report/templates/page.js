"use strict";
// What all pages share: data, colours by day, by night and on paper, plots, and tables that can be sorted.
const page = (() => {
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const shades = {
    light: { ink: "#1b1f24", soft: "#5b6570", line: "#dfe3e8" },
    dark: { ink: "#e6eaee", soft: "#9aa5b1", line: "#2b333c" },
  };
  const self = {
    data: JSON.parse(document.getElementById("page-data").textContent),
    printing: false, looks: [],
    shade: () => (dark.matches && !self.printing ? "dark" : "light"),
    colours: () => shades[self.shade()],

    floats(text) {
      const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0)), view = new DataView(bytes.buffer);
      return Array.from({ length: bytes.length / 4 }, (_, k) => view.getFloat32(4 * k, true));
    },
    plain: (text) => text.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;"),

    axis(title, more = {}) {
      const c = self.colours();
      return { title: { text: title, font: { size: 12 }, standoff: 6 }, gridcolor: c.line, zerolinecolor: c.soft, zerolinewidth: 0.7, linecolor: c.soft, exponentformat: "power", ...more };
    },
    layout: (height, more) => ({
      height, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", font: { color: self.colours().ink, size: 11 },
      margin: { l: 68, r: 12, t: more.showlegend ? 32 : 8, b: 40 }, legend: { orientation: "h", x: 0, y: 1.02, yanchor: "bottom" },
      showlegend: false, hovermode: "x unified", hoverlabel: { font: { size: 11 } },
      modebar: { bgcolor: "rgba(0,0,0,0)", color: self.colours().soft, activecolor: self.colours().ink }, ...more,
    }),
    line: (name, x, y, color, more = {}) => ({ type: "scatter", mode: "lines", name, x, y, line: { color, width: 1.4 }, hovertemplate: "%{y:.4g}", ...more }),
    // the buttons are listed one by one, so that none that talks to a server is among them
    options: (large) => ({
      responsive: true, displaylogo: false, typesetMath: false,
      ...(large ? { modeBarButtons: [["toImage", "zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d"]] } : { displayModeBar: false }),
    }),
    // draws each plot when it comes near the window, on paper those that are to be printed; returns what draws them again
    plots(draw, printed = () => true) {
      const nodes = [...document.querySelectorAll("[data-plot]")], drawn = new Set();
      const show = (node) => { drawn.add(node); draw(node); };
      const watcher = new IntersectionObserver((entries) => entries.forEach((entry) => {
        if (entry.isIntersecting && !drawn.has(entry.target)) show(entry.target);
      }), { rootMargin: "600px" });
      nodes.forEach((node) => watcher.observe(node));
      const again = () => (self.printing ? nodes.filter(printed) : [...drawn]).forEach(show);
      self.looks.push(again);
      return again;
    },
  };
  const redraw = () => self.looks.forEach((look) => look());
  const paper = (printing) => { self.printing = printing; redraw(); };
  dark.addEventListener("change", redraw);
  window.addEventListener("beforeprint", () => paper(true));
  window.addEventListener("afterprint", () => paper(false));

  const key = (row, k) => row.cells[k].dataset.key;
  const number = (row, k) => {
    const x = parseFloat(key(row, k).replace("inf", "Infinity"));
    return Number.isNaN(x) ? -Infinity : x;
  };
  document.querySelectorAll("table.sortable").forEach((table) => {
    const rows = [...table.tBodies[0].rows];
    table.tHead.addEventListener("click", (event) => {
      const head = event.target.closest("th"), button = head && head.querySelector("button");
      if (!button) return;
      const k = head.cellIndex, rising = head.getAttribute("aria-sort") !== "ascending";
      table.tHead.querySelectorAll("[aria-sort]").forEach((cell) => cell.setAttribute("aria-sort", "none"));
      head.setAttribute("aria-sort", rising ? "ascending" : "descending");
      const order = button.dataset.sort === "text"
        ? (a, b) => key(a, k).localeCompare(key(b, k), "en", { numeric: true })
        : (a, b) => number(a, k) - number(b, k) || 0;
      table.tBodies[0].append(...[...rows].sort(rising ? order : (a, b) => order(b, a)));
    });
  });
  return self;
})();
