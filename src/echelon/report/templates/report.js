"use strict";
(() => {
  const data = JSON.parse(document.getElementById("plot-data").textContent);
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const palettes = {
    light: { ink: "#1b1f24", soft: "#5b6570", line: "#dfe3e8", measured: "#20262d", predicted: "#e8590c", prior: "#1c7ed6", band: "rgba(232,89,12,0.13)" },
    dark: { ink: "#e6eaee", soft: "#9aa5b1", line: "#2b333c", measured: "#e6eaee", predicted: "#ff922b", prior: "#4dabf7", band: "rgba(255,146,43,0.18)" },
  };
  let printing = false;
  const colours = () => palettes[dark.matches && !printing ? "dark" : "light"];

  // -- numbers -------------------------------------------------------------------------------------------------
  function floats(text, offset = 0) {
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    const view = new DataView(bytes.buffer);
    return Array.from({ length: bytes.length / 4 }, (_, k) => view.getFloat32(4 * k, true) + offset);
  }
  const plain = (text) => text.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
  const count = (n) => String(n).replace(/\B(?=(\d{3})+$)/g, "\u202f");

  // -- plots ---------------------------------------------------------------------------------------------------
  const log = document.getElementById("log");
  const prior = document.getElementById("prior");
  const plots = [...document.querySelectorAll("[data-plot]")];
  const drawn = new Set();

  const axis = (title, more = {}) => {
    const c = colours();
    return { title: { text: title, font: { size: 12 }, standoff: 6 }, gridcolor: c.line, zerolinecolor: c.soft, zerolinewidth: 0.7, linecolor: c.soft, exponentformat: "power", ...more };
  };
  const layout = (height, more) => ({
    height, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", font: { color: colours().ink, size: 11 },
    margin: { l: 68, r: 12, t: 8, b: 40 }, showlegend: false, modebar: { bgcolor: "rgba(0,0,0,0)", color: colours().soft, activecolor: colours().ink }, hovermode: "x unified", hoverlabel: { font: { size: 11 } }, ...more,
  });
  // the buttons are listed one by one, so that none that talks to a server is among them
  const buttons = [["toImage", "zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d"]];
  const calm = { responsive: true, displaylogo: false, typesetMath: false };
  const options = { trace: { ...calm, modeBarButtons: buttons }, other: { ...calm, displayModeBar: false } };
  const line = (name, xy, color, more = {}) => ({ type: "scatter", mode: "lines", name, x: xy[0], y: xy[1], line: { color, width: 1.3 }, hovertemplate: "%{y:.4g}", ...more });

  function tracePlot(trace) {
    const c = colours();
    const signal = (name) => [floats(trace.signals[name][0], trace.start), floats(trace.signals[name][1])];
    const lines = [line("measured", signal("measured"), c.measured, { line: { color: c.measured, width: 2 } })];
    if (trace.signals.prior && prior && prior.checked) lines.push(line("prior", signal("prior"), c.prior, { line: { color: c.prior, width: 1.3, dash: "dot" } }));
    lines.push(line("predicted", signal("predicted"), c.predicted));
    lines.push(line("residual", signal("residual"), c.predicted, { yaxis: "y2", showlegend: false }));
    const time = trace.since === null ? "time / s" : "time since " + trace.since.toFixed(3) + " s / s";
    return [lines, layout(430, {
      showlegend: true, legend: { orientation: "h", x: 0, y: 1.02, yanchor: "bottom" }, margin: { l: 68, r: 12, t: 30, b: 40 },
      xaxis: axis(time, { anchor: "y2" }), yaxis: axis(plain(trace.unit), { domain: [0.36, 1] }),
      yaxis2: axis("residual", { domain: [0, 0.28] }),
    })];
  }
  function histogram(trace) {
    const c = colours(), r = trace.residual, edges = floats(r.edges);
    const middle = edges.slice(1).map((e, k) => (e + edges[k]) / 2);
    return [[
      { type: "bar", name: "residual", x: middle, y: floats(r.density), width: edges[1] - edges[0], marker: { color: c.measured }, hovertemplate: "%{y:.2f} %" },
      line("normal", [middle, floats(r.normal)], c.predicted, { hovertemplate: "%{y:.2f} %" }),
    ], layout(230, { xaxis: axis(plain(trace.unit)), yaxis: axis("% of samples") })];
  }
  function correlation(trace) {
    const c = colours(), r = trace.residual, lags = floats(r.lags);
    const last = lags[lags.length - 1];
    return [[line("autocorrelation", [lags, floats(r.correlation)], c.predicted)], layout(230, {
      xaxis: axis("lag / s"), yaxis: axis("autocorrelation"),
      shapes: [{ type: "rect", x0: 0, x1: last, y0: -r.band, y1: r.band, fillcolor: c.band, line: { width: 0 }, layer: "below" }],
    })];
  }
  function spectrum(trace) {
    const c = colours(), r = trace.residual, f = floats(r.frequency);
    return [[
      line("spectrum", [f, floats(r.amplitude)], c.predicted),
      line("white", [[f[0], f[f.length - 1]], [r.white, r.white]], c.soft, { line: { color: c.soft, dash: "dash", width: 1 } }),
    ], layout(230, { xaxis: axis("frequency / Hz", { type: "log", dtick: 1, exponentformat: "none" }), yaxis: axis(plain(trace.unit) + " / √Hz", { rangemode: "tozero" }) })];
  }
  const kinds = { trace: tracePlot, histogram, correlation, spectrum };

  function draw(node) {
    drawn.add(node);
    const trace = data.traces[log.value + "/" + node.dataset.output];
    const caption = node.parentElement.querySelector(".caption");
    const missing = !trace || (node.dataset.plot !== "trace" && !trace.residual);
    node.classList.toggle("empty", missing);
    if (missing) {
      Plotly.purge(node);
      node.textContent = trace ? "There is no residual to analyse: too few samples, or all alike." : "This log has no signal of this output.";
      if (caption) caption.textContent = "";
      return;
    }
    if (!node.classList.contains("js-plotly-plot")) node.textContent = "";
    const [lines, shape] = kinds[node.dataset.plot](trace);
    // px of a page, which no script can measure
    if (printing) Object.assign(shape, node.dataset.plot === "trace" ? { width: 700, height: 330 } : { width: 226, height: 200 });
    Plotly.react(node, lines, shape, options[node.dataset.plot] || options.other);
    if (caption) {
      const thinned = trace.drawn < trace.samples;
      caption.textContent = count(trace.samples) + " samples, " + (thinned ? "of which at most " + count(trace.drawn) + " are drawn: the extremes of " + count(data.buckets) + " stretches" : "all drawn") +
        (trace.lost ? "; " + count(trace.lost) + " values are not finite" : "") + ".";
    }
  }
  const redraw = () => drawn.forEach(draw);
  if (log) {
    const watcher = new IntersectionObserver((entries) => entries.forEach((e) => {
      if (e.isIntersecting && !drawn.has(e.target)) draw(e.target);
    }), { rootMargin: "600px" });
    plots.forEach((node) => watcher.observe(node));
    log.addEventListener("change", redraw);
    if (prior) prior.addEventListener("change", redraw);
    dark.addEventListener("change", redraw);
    window.addEventListener("beforeprint", () => {
      printing = true;
      plots.filter((node) => node.closest("details").open).forEach(draw);
    });
    window.addEventListener("afterprint", () => { printing = false; redraw(); });
  }

  // -- the table of parameters ---------------------------------------------------------------------------------
  const table = document.getElementById("parameter-table");
  const rows = [...table.tBodies[0].rows];
  const number = (row, k) => { const x = parseFloat(row.cells[k].dataset.key.replace("inf", "Infinity")); return Number.isNaN(x) ? -Infinity : x; };
  const text = (row) => row.dataset.text;
  table.tHead.addEventListener("click", (event) => {
    const head = event.target.closest("th"), button = head && head.querySelector("button");
    if (!button) return;
    const k = head.cellIndex;
    const up = head.getAttribute("aria-sort") !== "ascending";
    [...table.tHead.rows[0].cells].forEach((cell) => cell.hasAttribute("aria-sort") && cell.setAttribute("aria-sort", "none"));
    head.setAttribute("aria-sort", up ? "ascending" : "descending");
    const order = button.dataset.sort === "text" ? (a, b) => text(a).localeCompare(text(b), "en", { numeric: true }) : (a, b) => number(a, k) - number(b, k) || 0;
    table.tBodies[0].append(...[...rows].sort(up ? order : (a, b) => order(b, a)));
  });
  const search = document.getElementById("search");
  search.addEventListener("input", () => {
    const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
    const hit = (row) => words.every((word) => text(row).toLowerCase().includes(word));
    rows.forEach((row) => { row.hidden = !hit(row); });
    document.getElementById("found").textContent = words.length ? rows.filter((row) => !row.hidden).length + " of " + rows.length : "";
  });

  // -- the picture of B ----------------------------------------------------------------------------------------
  const entry = document.getElementById("entry");
  document.querySelectorAll(".matrix use").forEach((mark) => mark.addEventListener("pointerenter", () => {
    entry.textContent = mark.querySelector("title").textContent;
  }));
})();
