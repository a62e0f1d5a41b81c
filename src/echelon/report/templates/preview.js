"use strict";
// What the picture and the plots share: numbers, colours and the time that is shown.
const preview = (() => {
  const data = JSON.parse(document.getElementById("preview-data").textContent);
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const palettes = {
    light: {
      ink: "#1b1f24", soft: "#5b6570", line: "#dfe3e8", accent: "#0b5cad", limit: "#a4262c", path: "#c05a00",
      paper: "#f5f7f9", grid: "#cfd6de", shadow: "rgba(27,31,36,0.10)", edge: "#123a63", glow: "rgba(255,255,255,0.45)",
      bodies: ["#2b78bf", "#6ea8dc"], still: "#8d98a3", joint: "#39424c", lid: "#66727e", ghost: "rgba(43,120,191,0.16)",
    },
    dark: {
      ink: "#e6eaee", soft: "#9aa5b1", line: "#2b333c", accent: "#58a8f2", limit: "#ff8a8a", path: "#ffa14d",
      paper: "#1d232a", grid: "#37414c", shadow: "rgba(0,0,0,0.28)", edge: "#0d1a28", glow: "rgba(255,255,255,0.22)",
      bodies: ["#5fa6e6", "#3d7db8"], still: "#6b7682", joint: "#c3ccd5", lid: "#98a4b0", ghost: "rgba(95,166,230,0.16)",
    },
  };
  const cycle = ["#0b5cad", "#c05a00", "#1b8a4b", "#8b2fc9", "#c2185b", "#0b8a9a", "#8a6d00", "#5b6570"];
  const bright = ["#58a8f2", "#ffa14d", "#63d08e", "#cf94ff", "#ff8ab5", "#4cc9d9", "#e0c341", "#aeb8c2"];
  const listeners = [];
  const self = {
    data, time: 0, printing: false, looks: [],
    isDark: () => dark.matches && !self.printing,
    colours: () => palettes[self.isDark() ? "dark" : "light"],
    colour: (k) => (self.isDark() ? bright : cycle)[k % cycle.length],
    floats(text) {
      const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0)), view = new DataView(bytes.buffer);
      return Float64Array.from({ length: bytes.length / 4 }, (_, k) => view.getFloat32(4 * k, true));
    },
    onTime: (listener) => listeners.push(listener),
    setTime(time) {
      self.time = time;
      listeners.forEach((listener) => listener(time));
    },
  };
  const redraw = () => self.looks.forEach((look) => look());
  dark.addEventListener("change", redraw);
  window.addEventListener("beforeprint", () => { self.printing = true; redraw(); });
  window.addEventListener("afterprint", () => { self.printing = false; redraw(); });
  return self;
})();
