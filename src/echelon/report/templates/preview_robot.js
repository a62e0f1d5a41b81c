// The moving robot: points of every picture are projected here, far ones drawn first.
(() => {
  const robot = page.data.robot, canvas = document.getElementById("robot-view");
  if (!robot || !canvas) return;
  const pen = canvas.getContext("2d");
  const byId = (id) => document.getElementById(id);
  const count = robot.bodies.length, width = robot.coordinates.length;
  const all = { origins: page.floats(robot.origins), axes: page.floats(robot.axes), tips: page.floats(robot.tips), turned: page.floats(robot.turned) };
  const states = { q: page.floats(robot.q), qd: page.floats(robot.qd) };

  // -- vectors -------------------------------------------------------------------------------------------------
  const add = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
  const times = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const size = (a) => Math.hypot(a[0], a[1], a[2]);
  const unit = (a) => times(a, 1 / (size(a) || 1));
  const up = robot.up;
  const side = unit(cross(up, Math.abs(up[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0])), front = cross(side, up);

  // -- pictures ------------------------------------------------------------------------------------------------
  const places = (time) => {
    const x = robot.duration > 0 ? Math.min(Math.max(time / robot.duration, 0), 1) * (robot.pictures - 1) : 0;
    const k = Math.min(Math.floor(x), Math.max(robot.pictures - 2, 0));
    return [k, Math.min(k + 1, robot.pictures - 1), x - k];
  };
  const between = (values, n, time) => {
    const [k, next, share] = places(time);
    return Array.from({ length: n }, (_, i) => values[k * n + i] * (1 - share) + values[next * n + i] * share);
  };
  const points = (values, n, time) => {
    const flat = between(values, 3 * n, time);
    return Array.from({ length: n }, (_, i) => flat.slice(3 * i, 3 * i + 3));
  };
  const tipCount = robot.bodies.filter((body) => body.last !== null).length;
  const picture = (time) => ({ origins: points(all.origins, count, time), axes: points(all.axes, count, time), tips: points(all.tips, tipCount, time), turned: points(all.turned, 2 * robot.shapes.length, time) });

  // -- what there is to be seen --------------------------------------------------------------------------------
  const low = [0, 0, 0], high = [0, 0, 0];
  for (const values of [all.origins, all.tips]) {
    for (let k = 0; k < values.length; k++) {
      low[k % 3] = Math.min(low[k % 3], values[k]);
      high[k % 3] = Math.max(high[k % 3], values[k]);
    }
  }
  const middle = times(add(low, high), 0.5);
  let reach = size(middle);
  for (const values of [all.origins, all.tips]) {
    for (let k = 0; k < values.length; k += 3) {
      reach = Math.max(reach, Math.hypot(values[k] - middle[0], values[k + 1] - middle[1], values[k + 2] - middle[2]));
    }
  }
  reach = reach || 1;
  const paths = robot.bodies.flatMap((body, i) => (body.last === null ? [] : [
    Array.from({ length: robot.pictures }, (_, k) => [0, 1, 2].map((x) => all.origins[3 * (k * count + i) + x])),
  ]));

  // -- camera --------------------------------------------------------------------------------------------------
  const begin = { turn: robot.turn, tilt: robot.elevation, zoom: 1 };
  const camera = { ...begin };
  let wide = 1, tall = 1, fit = 1, look;
  // everything that is seen from the first view, as large as there is room for
  function measure() {
    const own = { ...camera };
    Object.assign(camera, begin); fit = 1; aim();
    let least = 0.5;
    for (const values of [all.origins, all.tips]) {
      for (let k = 0; k < values.length; k += 3) {
        const at = look.place(values.slice(k, k + 3));
        least = Math.max(least, Math.abs(at.x - wide / 2) / (0.44 * wide), Math.abs(at.y - tall / 2) / (0.42 * tall));
      }
    }
    fit = 1 / least;
    Object.assign(camera, own);
  }
  function aim() {
    const right = add(times(side, Math.cos(camera.turn)), front, Math.sin(camera.turn)), away = cross(up, right);
    const above = add(times(up, Math.cos(camera.tilt)), away, Math.sin(camera.tilt));
    const scale = fit * camera.zoom * 0.44 * Math.min(wide, tall) / reach, far = 6 * reach;
    const toward = cross(right, above);
    look = {
      toward, scale,
      place(point) {
        const p = add(point, middle, -1), depth = dot(p, toward);
        const s = scale * far / Math.max(far - depth, 0.2 * far);
        return { x: wide / 2 + s * dot(p, right), y: tall / 2 - s * dot(p, above), depth, s };
      },
    };
  }

  // -- drawing -------------------------------------------------------------------------------------------------
  const line = (from, to, color, thick, cap = "round") => {
    pen.strokeStyle = color; pen.lineWidth = thick; pen.lineCap = cap;
    pen.beginPath(); pen.moveTo(from.x, from.y); pen.lineTo(to.x, to.y); pen.stroke();
  };
  const curve = (some, color, thick) => {
    pen.strokeStyle = color; pen.lineWidth = thick; pen.lineJoin = pen.lineCap = "round";
    pen.beginPath(); some.forEach((p) => { const at = look.place(p); pen.lineTo(at.x, at.y); }); pen.stroke();
  };
  const floor = (point) => add(point, up, -dot(point, up));
  const radius = 0.026 * reach;

  function grid(c) {
    const step = [1, 2, 5, 10].map((x) => x * 10 ** Math.floor(Math.log10(reach / 4))).find((x) => x >= reach / 4);
    const span = (axis) => {
      const ends = [low, high].flatMap((a) => [low, high].flatMap((b) => [low, high].map((d) => dot([a[0], b[1], d[2]], axis))));
      return [Math.floor(Math.min(...ends) / step) - 1, Math.ceil(Math.max(...ends) / step) + 1];
    };
    const [a, b] = span(side), [d, e] = span(front);
    const at = (i, j) => look.place(add(times(side, i * step), front, j * step));
    for (let i = a; i <= b; i++) line(at(i, d), at(i, e), c.grid, i === 0 ? 1.6 : 0.8);
    for (let j = d; j <= e; j++) line(at(a, j), at(b, j), c.grid, j === 0 ? 1.6 : 0.8);
    pen.fillStyle = c.soft; pen.font = "12px system-ui, sans-serif";
    pen.fillText("grid " + Number(step.toPrecision(2)) + " m", 12, tall - 12);
  }
  function obstacles(c) {
    pen.font = "11px system-ui, sans-serif";
    robot.obstacles.forEach((one) => {
      one.curves.forEach((some) => curve(some, c.limit, 1));
      const at = look.place(one.curves[0][0]);
      pen.fillStyle = c.limit; pen.fillText(one.name, at.x + 4, at.y - 4);
    });
  }
  function shapes(c, now) {
    pen.globalAlpha = 0.8;
    robot.shapes.forEach((one, k) => {
      const origin = one.body < 0 ? [0, 0, 0] : now.origins[one.body];
      const x = now.turned[2 * k], y = now.turned[2 * k + 1], z = cross(x, y);
      const at = (p) => add(add(add(origin, x, p[0]), y, p[1]), z, p[2]);
      one.curves.forEach((some) => curve(some.map(at), c.hull, 1));
    });
    pen.globalAlpha = 1;
  }
  function baseAxes(c) {
    [[1, 0, 0], [0, 1, 0], [0, 0, 1]].forEach((axis, k) => {
      const end = look.place(times(axis, 0.22 * reach));
      line(look.place([0, 0, 0]), end, ["#c62828", "#2e8b3d", "#2962d9"][k], 1.8);
      pen.fillStyle = c.soft; pen.font = "11px system-ui, sans-serif"; pen.fillText("xyz"[k], end.x + 4, end.y - 3);
    });
  }
  // segments of a picture: [from, to, body or −1 for the ground, stub]
  function bones(now) {
    return robot.bodies.flatMap((body, i) => {
      const found = [[body.parent < 0 ? [0, 0, 0] : now.origins[body.parent], now.origins[i], body.parent, false]];
      if (body.last !== null) found.push([now.origins[i], now.tips[body.last], i, true]);
      return found.filter(([from, to]) => size(add(from, to, -1)) > 1e-6 * reach);
    });
  }
  function bone(c, [from, to, owner, stub]) {
    const a = look.place(from), b = look.place(to), body = robot.bodies[owner];
    const thick = Math.max(2 * radius * (a.s + b.s) / 2 * (stub ? 0.62 : 1), 3.5);
    const color = !body || body.still ? c.still : c.bodies[owner % 2];
    line(a, b, c.edge, thick + 1.6); line(a, b, color, thick); line(a, b, c.glow, thick * 0.28);
  }
  function joint(c, origin, axis, body) {
    const long = size(axis);
    if (body.joint === "fixed" || !long) {
      const at = look.place(origin);
      pen.fillStyle = c.joint; pen.beginPath(); pen.arc(at.x, at.y, Math.max(radius * at.s, 2.5), 0, 7); pen.fill();
      return;
    }
    const slide = body.joint === "slide", half = radius * (slide ? 3.4 : 1.7);
    let a = look.place(add(origin, axis, -half / long)), b = look.place(add(origin, axis, half / long));
    if (b.depth < a.depth) [a, b] = [b, a];
    const r = Math.max(radius * (slide ? 0.6 : 1.45) * (a.s + b.s) / 2, 3), angle = Math.atan2(b.y - a.y, b.x - a.x);
    const flat = r * Math.min(Math.abs(dot(axis, look.toward)) / long, 1);
    const disc = (p) => pen.ellipse(p.x, p.y, flat, r, angle, 0, 2 * Math.PI);
    pen.fillStyle = c.joint;
    pen.beginPath(); disc(a); pen.fill();
    line(a, b, c.joint, 2 * r, "butt");
    pen.fillStyle = c.lid; pen.strokeStyle = c.joint; pen.lineWidth = 1;
    pen.beginPath(); disc(b); pen.fill(); pen.stroke();
  }
  function body3d(c, now) {
    const jobs = bones(now).map((one) => [look.place(times(add(one[0], one[1]), 0.5)).depth, () => bone(c, one)]);
    robot.bodies.forEach((body, i) => jobs.push([look.place(now.origins[i]).depth + radius, () => joint(c, now.origins[i], now.axes[i], body)]));
    jobs.sort((a, b) => a[0] - b[0]).forEach((job) => job[1]());
  }
  function shadow(c, now) {
    pen.strokeStyle = c.shadow; pen.lineCap = pen.lineJoin = "round"; pen.lineWidth = Math.max(2 * radius * look.scale, 3);
    pen.beginPath(); // one stroke, so that overlaps do not add up
    bones(now).forEach(([from, to]) => {
      const a = look.place(floor(from)), b = look.place(floor(to));
      pen.moveTo(a.x, a.y); pen.lineTo(b.x, b.y);
    });
    pen.stroke();
  }
  function ghosts(c) {
    for (let k = 0; k < 12; k++) {
      bones(picture(robot.duration * k / 12)).forEach(([from, to]) => line(look.place(from), look.place(to), c.ghost, Math.max(1.5 * radius * look.scale, 3)));
    }
  }
  function names(now) {
    const c = preview.colours();
    pen.font = "600 12px system-ui, sans-serif"; pen.lineWidth = 3; pen.lineJoin = "round";
    robot.bodies.forEach((body, i) => {
      const at = look.place(now.origins[i]), text = body.name.length > 28 ? body.name.slice(0, 27) + "…" : body.name;
      pen.strokeStyle = c.paper; pen.strokeText(text, at.x + 10, at.y - 8);
      pen.fillStyle = c.ink; pen.fillText(text, at.x + 10, at.y - 8);
    });
  }
  function draw() {
    const ratio = page.printing ? 2 : window.devicePixelRatio || 1;
    wide = canvas.clientWidth || 900; tall = canvas.clientHeight || 400;
    if (canvas.width !== Math.round(wide * ratio) || canvas.height !== Math.round(tall * ratio)) {
      canvas.width = Math.round(wide * ratio); canvas.height = Math.round(tall * ratio);
      measure();
    }
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    aim();
    const c = preview.colours(), now = picture(preview.time);
    pen.fillStyle = c.paper; pen.fillRect(0, 0, wide, tall);
    grid(c); obstacles(c); shadow(c, now); baseAxes(c);
    if (byId("show-ghosts").checked) ghosts(c);
    if (byId("show-path").checked) paths.forEach((path) => curve(path, c.path, 1.3));
    body3d(c, now);
    if (byId("show-shapes")?.checked) shapes(c, now);
    if (byId("show-path").checked) {
      robot.bodies.forEach((body, i) => {
        if (body.last === null) return;
        const at = look.place(now.origins[i]);
        pen.fillStyle = c.path; pen.beginPath(); pen.arc(at.x, at.y, 3.5, 0, 7); pen.fill();
      });
    }
    if (byId("show-names").checked) names(now);
  }
  let waiting = false;
  const later = () => {
    if (!waiting) requestAnimationFrame(() => { waiting = false; draw(); });
    waiting = true;
  };

  // -- time ----------------------------------------------------------------------------------------------------
  const slider = byId("time"), clock = byId("clock"), play = byId("play");
  const rows = [...document.querySelectorAll(".now li")];
  const minus = (x) => x.toFixed(3).replace("-", "−").replace(/^−(0\.0+)$/, "$1");
  slider.max = robot.duration;
  preview.onTime((time) => {
    slider.value = time;
    clock.textContent = time.toFixed(2) + " s";
    slider.setAttribute("aria-valuetext", time.toFixed(2) + " seconds");
    const q = between(states.q, width, time), qd = between(states.qd, width, time);
    rows.forEach((row, k) => row.querySelectorAll(".q, .qd").forEach((cell, i) => { cell.textContent = minus((i ? qd : q)[k]); }));
    later();
  });
  let running = false, before = null;
  function tick(stamp) {
    if (!running) return;
    if (before !== null) {
      const next = preview.time + Math.min(stamp - before, 200) / 1000 * Number(byId("speed").value);
      preview.setTime(next > robot.duration ? 0 : next);
    }
    before = stamp;
    requestAnimationFrame(tick);
  }
  function run(on) {
    running = on; before = null;
    play.setAttribute("aria-pressed", String(on));
    play.setAttribute("aria-label", on ? "pause" : "play");
    if (on) requestAnimationFrame(tick);
  }
  play.addEventListener("click", () => run(!running));
  slider.addEventListener("input", () => { run(false); preview.setTime(Number(slider.value)); });
  slider.addEventListener("keydown", (event) => { // steps of a slider without steps differ between browsers
    const step = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 }[event.key];
    if (!step) return;
    event.preventDefault(); run(false);
    preview.setTime(Math.min(Math.max(preview.time + step * robot.duration / 100, 0), robot.duration));
  });
  preview.pause = () => run(false);

  // -- view ----------------------------------------------------------------------------------------------------
  const turn = (by, tilt) => {
    camera.turn += by;
    camera.tilt = Math.min(Math.max(camera.tilt + tilt, -Math.PI / 2), Math.PI / 2);
    later();
  };
  const zoom = (by) => { camera.zoom = Math.min(Math.max(camera.zoom * by, 0.2), 20); later(); };
  const views = { start: begin, front: { turn: 0, tilt: 0 }, side: { turn: Math.PI / 2, tilt: 0 }, top: { turn: 0, tilt: Math.PI / 2 } };
  document.querySelectorAll("[data-view]").forEach((button) => button.addEventListener("click", () => {
    Object.assign(camera, views[button.dataset.view]); later();
  }));
  const fingers = new Map();
  const spread = () => { const [a, b] = [...fingers.values()]; return Math.hypot(a.x - b.x, a.y - b.y); };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  });
  canvas.addEventListener("pointermove", (event) => {
    const was = fingers.get(event.pointerId);
    if (!was) return;
    const wideness = fingers.size === 2 ? spread() : 0;
    fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (wideness) zoom(spread() / wideness);
    turn(-(event.clientX - was.x) * 0.008 / fingers.size, (event.clientY - was.y) * 0.008 / fingers.size);
  });
  ["pointerup", "pointercancel", "lostpointercapture"].forEach((kind) => canvas.addEventListener(kind, (event) => fingers.delete(event.pointerId)));
  // a wheel that was scrolling the page goes on doing so when the picture comes under the pointer
  let scrolled = -Infinity;
  window.addEventListener("wheel", (event) => { if (event.target !== canvas) scrolled = event.timeStamp; }, { passive: true, capture: true });
  canvas.addEventListener("wheel", (event) => {
    if (event.timeStamp - scrolled < 300) { scrolled = event.timeStamp; return; }
    event.preventDefault();
    zoom(Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0015)));
  }, { passive: false });
  const keys = {
    ArrowLeft: () => turn(0.1, 0), ArrowRight: () => turn(-0.1, 0), ArrowUp: () => turn(0, 0.1), ArrowDown: () => turn(0, -0.1),
    "+": () => zoom(1.15), "=": () => zoom(1.15), "-": () => zoom(1 / 1.15), 0: () => { Object.assign(camera, begin); later(); }, " ": () => run(!running),
  };
  canvas.addEventListener("keydown", (event) => {
    if (!keys[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault(); keys[event.key]();
  });
  ["show-path", "show-names", "show-ghosts", "show-shapes"].forEach((id) => byId(id)?.addEventListener("change", later));
  new ResizeObserver(later).observe(canvas);
  page.looks.push(draw);
  preview.setTime(0);
})();
