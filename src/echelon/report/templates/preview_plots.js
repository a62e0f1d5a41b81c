// Plots of joint motion, conditioning and starts.
(() => {
  const { data, plain, axis, line } = page;
  // px of a page, which no script can measure
  const layout = (height, more) => page.layout(height, { ...more, ...(page.printing ? { width: 700 } : {}) });

  // -- joint motion --------------------------------------------------------------------------------------------
  const { motion } = data;
  const signals = motion.coordinates.map((coordinate) => coordinate.orders.map((order) => ({
    ...order, time: page.floats(order.time), values: page.floats(order.values),
  })));
  const choice = document.getElementById("coordinate");
  const domains = [[0.7, 1], [0.36, 0.66], [0.02, 0.32]];
  const dashed = (row, value, color) => ({ type: "line", xref: "paper", x0: 0, x1: 1, yref: "y" + (row ? row + 1 : ""), y0: value, y1: value, line: { color, width: 1.3, dash: "dash" } });
  const share = (order) => {
    const { low, high } = order, centre = (low + high) / 2;
    return order.values.map((value) => 100 * (value - centre) / ((high - low) / 2));
  };
  function motionPlot() {
    const c = preview.colours(), lines = [], shapes = [], chosen = choice.value;
    const axes = { xaxis: axis("time / s", { anchor: "y3", range: [0, motion.duration] }) };
    domains.forEach((domain, row) => {
      const y = row ? "y" + (row + 1) : "y", key = "yaxis" + (row ? row + 1 : "");
      if (chosen === "all") {
        signals.forEach((orders, k) => {
          const order = orders[row];
          if (order.low === null || order.high === null) return;
          lines.push(line(plain(motion.coordinates[k].name), order.time, share(order), preview.colour(k), { yaxis: y, hovertemplate: "%{y:.1f} %", showlegend: row === 0, legendgroup: String(k) }));
        });
        shapes.push(dashed(row, 100, c.limit), dashed(row, -100, c.limit));
        axes[key] = axis(motion.titles[row] + " / %", { domain, range: [-112, 112], dtick: 50 });
      } else {
        const order = signals[chosen][row];
        lines.push(line(motion.titles[row], order.time, order.values, c.accent, { yaxis: y }));
        const limits = [order.low, order.high].filter((value) => value !== null);
        limits.forEach((value) => shapes.push(dashed(row, value, c.limit)));
        const shown = order.values.filter(Number.isFinite).concat(limits);
        const least = shown.reduce((a, b) => Math.min(a, b), Infinity), most = shown.reduce((a, b) => Math.max(a, b), -Infinity);
        const room = 0.08 * (most - least || 1);
        axes[key] = axis(motion.titles[row] + " / " + plain(order.unit), { domain, range: [least - room, most + room] });
      }
    });
    return [lines, layout(page.printing ? 480 : 620, {
      ...axes, shapes, showlegend: chosen === "all", hoversubplots: "axis",
    })];
  }
  const head = document.querySelector(".playhead"), motionNode = document.querySelector("[data-plot=motion]");
  function placeHead() {
    const full = motionNode._fullLayout, x = full && full.xaxis;
    head.hidden = !x || !x.l2p || !preview.onStage || preview.time < x.range[0] || preview.time > x.range[1];
    if (head.hidden) return;
    head.style.left = full._size.l + x.l2p(preview.time) + "px";
    head.style.top = full._size.t + "px";
    head.style.height = full._size.h + "px";
  }
  preview.onStage = Boolean(data.robot);
  preview.onTime(placeHead);

  // -- the others ----------------------------------------------------------------------------------------------
  function conditioningPlot() {
    const { time, condition } = data.conditioning;
    return [[line("condition number", time, condition, preview.colours().accent, { mode: "lines+markers", marker: { size: 4 } })], layout(260, {
      xaxis: axis("time / s", { range: [0, motion.duration * 1.01] }), yaxis: axis("condition number", { type: "log", dtick: 1 }), hovermode: "closest",
    })];
  }
  function distancesPlot(node) {
    const time = page.floats(data.distances.time), pairs = data.distances.groups[node.dataset.group], c = preview.colours();
    const lines = pairs.map((pair, k) => line(plain(pair.name), time, page.floats(pair.distance), preview.colour(k), { hovertemplate: "%{y:.3f} m", connectgaps: false }));
    const lows = [...new Set(pairs.map((pair) => pair.low))];
    const rows = Math.ceil(pairs.length / Math.max(Math.floor((node.clientWidth || 700) / 270), 1));
    return [lines, layout(250 + 20 * rows, {
      xaxis: axis("time / s", { range: [0, motion.duration] }), yaxis: axis("distance / m", { rangemode: "tozero" }), showlegend: true,
      hovermode: "closest", shapes: lows.map((low) => dashed(0, low, c.limit)),
    })];
  }
  function startsPlot() {
    const lines = data.starts.filter((start) => start.history.length).map((start, k) =>
      line("start " + start.number, start.history.map((_, i) => i + 1), start.history, preview.colour(k), { line: { color: preview.colour(k), width: 1.6, shape: "hv" }, hovertemplate: "%{y:.5g}" }));
    return [lines, layout(280, { xaxis: axis("number of the improvement"), yaxis: axis("best criterion so far"), showlegend: lines.length > 1 })];
  }
  const kinds = { motion: motionPlot, conditioning: conditioningPlot, distances: distancesPlot, starts: startsPlot };
  function draw(node) {
    const kind = node.dataset.plot;
    if (kind === "conditioning" && !data.conditioning.time.length) {
      node.classList.add("empty");
      node.textContent = "At no time are all base parameters seen.";
      return;
    }
    const [lines, shape] = kinds[kind](node);
    const fresh = !node.classList.contains("js-plotly-plot");
    Plotly.react(node, lines, shape, page.options(kind === "motion"));
    if (kind !== "motion") return;
    if (fresh) {
      node.on("plotly_afterplot", placeHead);
      node.on("plotly_click", (event) => {
        if (!preview.onStage) return;
        preview.pause();
        preview.setTime(Math.min(Math.max(Number(event.points[0].x), 0), motion.duration));
      });
    }
    placeHead();
  }
  page.plots(draw);
  choice.addEventListener("change", () => draw(motionNode));
})();
