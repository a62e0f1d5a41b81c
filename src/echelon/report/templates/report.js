// Measured and predicted signals, residuals; the table of parameters can be searched.
(() => {
  const { data, plain, axis, layout, line, options } = page;
  const palettes = {
    light: { measured: "#20262d", under: "rgba(32,38,45,0.32)", predicted: "#e8590c", prior: "#1c7ed6", band: "rgba(232,89,12,0.13)" },
    dark: { measured: "#e6eaee", under: "rgba(230,234,238,0.38)", predicted: "#ff922b", prior: "#4dabf7", band: "rgba(255,146,43,0.18)" },
  };
  const colours = () => ({ ...page.colours(), ...palettes[page.shade()] });
  const floats = (text, offset = 0) => page.floats(text).map((x) => x + offset);
  const count = (n) => String(n).replace(/\B(?=(\d{3})+$)/g, "\u202f");
  const [log, view, prior] = ["log", "view", "prior"].map((id) => document.getElementById(id));
  const isRaw = (trace) => trace.raw && view && view.value === "raw";
  const shown = (trace) => (isRaw(trace) ? trace.raw : trace.fitted);

  // -- plots ---------------------------------------------------------------------------------------------------
  function tracePlot(trace) {
    const c = colours(), signals = shown(trace).signals;
    const signal = (name) => [floats(signals[name][0], trace.start), floats(signals[name][1])];
    // a wide line shows on both sides of the thin one that hides it
    const lines = [line("measured", ...signal("measured"), c.under, { line: { color: c.under, width: 5 } })];
    if (signals.prior && prior && prior.checked) lines.push(line("prior", ...signal("prior"), c.prior, { line: { color: c.prior, width: 1.3, dash: "dot" } }));
    lines.push(line("predicted", ...signal("predicted"), c.predicted));
    lines.push(line("residual", ...signal("residual"), c.predicted, { yaxis: "y2", showlegend: false }));
    const time = trace.since === null ? "time / s" : "time since " + trace.since.toFixed(3) + " s / s";
    return [lines, layout(430, {
      showlegend: true,
      xaxis: axis(time, { anchor: "y2" }), yaxis: axis(plain(trace.unit), { domain: [0.36, 1] }),
      yaxis2: axis("residual", { domain: [0, 0.28] }),
    })];
  }
  function histogram(trace) {
    const c = colours(), r = trace.residual, edges = floats(r.edges);
    const middle = edges.slice(1).map((e, k) => (e + edges[k]) / 2);
    return [[
      { type: "bar", name: "residual", x: middle, y: floats(r.density), width: edges[1] - edges[0], marker: { color: c.measured }, hovertemplate: "%{y:.2f} %" },
      line("normal", middle, floats(r.normal), c.predicted, { hovertemplate: "%{y:.2f} %" }),
    ], layout(230, { xaxis: axis(plain(trace.unit)), yaxis: axis("% of samples") })];
  }
  function correlation(trace) {
    const c = colours(), r = trace.residual, lags = floats(r.lags);
    const last = lags[lags.length - 1];
    return [[line("autocorrelation", lags, floats(r.correlation), c.predicted)], layout(230, {
      xaxis: axis("lag / s"), yaxis: axis("autocorrelation"),
      shapes: [{ type: "rect", x0: 0, x1: last, y0: -r.band, y1: r.band, fillcolor: c.band, line: { width: 0 }, layer: "below" }],
    })];
  }
  function spectrum(trace) {
    const c = colours(), r = trace.residual, f = floats(r.frequency);
    return [[
      line("spectrum", f, floats(r.amplitude), c.predicted),
      line("white", [f[0], f[f.length - 1]], [r.white, r.white], c.soft, { line: { color: c.soft, dash: "dash", width: 1 } }),
    ], layout(230, { xaxis: axis("frequency / Hz", { type: "log", dtick: 1, exponentformat: "none" }), yaxis: axis(plain(trace.unit) + " / √Hz", { rangemode: "tozero" }) })];
  }
  function speed(trace) {
    const c = colours(), s = trace.speeds, v = floats(s.speed);
    const edge = { line: { color: c.soft, width: 0.5 }, hoverinfo: "skip" };
    return [[
      line("mean − deviation", v, floats(s.low), c.soft, edge),
      line("mean + deviation", v, floats(s.high), c.soft, { ...edge, fill: "tonexty", fillcolor: c.band }),
      line("mean", v, floats(s.mean), c.predicted),
    ], layout(230, { xaxis: axis("speed / (" + s.unit + ")"), yaxis: axis(plain(trace.unit)) })];
  }
  const kinds = { trace: tracePlot, histogram, correlation, spectrum, speed };

  function draw(node) {
    const trace = data.traces[log.value + "/" + node.dataset.output];
    const caption = node.parentElement.querySelector(".caption");
    const needed = { trace: "fitted", speed: "speeds" }[node.dataset.plot] || "residual";
    const missing = !trace || !trace[needed];
    node.classList.toggle("empty", missing);
    if (missing) {
      Plotly.purge(node);
      const none = node.dataset.plot === "speed" ? "This output has no speed, or too few samples." : "There is no residual to analyse: too few samples, or all alike.";
      node.textContent = trace ? none : "This log has no signal of this output.";
      if (caption) caption.textContent = "";
      return;
    }
    if (!node.classList.contains("js-plotly-plot")) node.textContent = "";
    const [lines, shape] = kinds[node.dataset.plot](trace);
    // px of a page, which no script can measure
    if (page.printing) Object.assign(shape, { trace: { width: 700, height: 330 }, speed: { width: 700, height: 200 } }[node.dataset.plot] || { width: 226, height: 200 });
    Plotly.react(node, lines, shape, options(node.dataset.plot === "trace"));
    if (caption) {
      const { samples, drawn, lost } = shown(trace);
      caption.textContent = count(samples) + (isRaw(trace) ? " samples, " : " rows, ") + (drawn < samples ? "of which at most " + count(drawn) + " are drawn: the extremes of " + count(data.buckets) + " stretches" : "all drawn") +
        (lost ? "; " + count(lost) + " values are not finite" : "") + ".";
    }
  }
  if (log) {
    const again = page.plots(draw, (node) => node.closest("details").open);
    for (const control of [log, view, prior]) if (control) control.addEventListener("change", again);
  }

  // -- the table of parameters ---------------------------------------------------------------------------------
  const search = document.getElementById("search");
  const rows = [...document.getElementById("parameter-table").tBodies[0].rows];
  search.addEventListener("input", () => {
    const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
    rows.forEach((row) => { row.hidden = !words.every((word) => row.dataset.text.toLowerCase().includes(word)); });
    document.getElementById("found").textContent = words.length ? rows.filter((row) => !row.hidden).length + " of " + rows.length : "";
  });

  // -- the picture of B ----------------------------------------------------------------------------------------
  const entry = document.getElementById("entry");
  document.querySelectorAll(".matrix use").forEach((mark) => mark.addEventListener("pointerenter", () => {
    entry.textContent = mark.querySelector("title").textContent;
  }));
})();
