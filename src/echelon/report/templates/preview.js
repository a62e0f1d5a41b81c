// What the picture and the plots of a trajectory share: colours and the time that is shown.
const preview = (() => {
  const palettes = {
    light: {
      accent: "#0b5cad", limit: "#a4262c", path: "#c05a00", hull: "#1b8a4b",
      paper: "#f5f7f9", grid: "#cfd6de", shadow: "rgba(27,31,36,0.10)", edge: "#123a63", glow: "rgba(255,255,255,0.45)",
      bodies: ["#2b78bf", "#6ea8dc"], still: "#8d98a3", joint: "#39424c", lid: "#66727e", ghost: "rgba(43,120,191,0.16)",
      cycle: ["#0b5cad", "#c05a00", "#1b8a4b", "#8b2fc9", "#c2185b", "#0b8a9a", "#8a6d00", "#5b6570"],
    },
    dark: {
      accent: "#58a8f2", limit: "#ff8a8a", path: "#ffa14d", hull: "#63d08e",
      paper: "#1d232a", grid: "#37414c", shadow: "rgba(0,0,0,0.28)", edge: "#0d1a28", glow: "rgba(255,255,255,0.22)",
      bodies: ["#5fa6e6", "#3d7db8"], still: "#6b7682", joint: "#c3ccd5", lid: "#98a4b0", ghost: "rgba(95,166,230,0.16)",
      cycle: ["#58a8f2", "#ffa14d", "#63d08e", "#cf94ff", "#ff8ab5", "#4cc9d9", "#e0c341", "#aeb8c2"],
    },
  };
  const listeners = [];
  const self = {
    time: 0,
    colours: () => ({ ...page.colours(), ...palettes[page.shade()] }),
    colour: (k) => self.colours().cycle[k % 8],
    onTime: (listener) => listeners.push(listener),
    setTime(time) {
      self.time = time;
      listeners.forEach((listener) => listener(time));
    },
  };
  return self;
})();
