// A clip's page: motions and models come from shared files, baseline and now share one clock.
"use strict";
(() => {
  const page = JSON.parse(document.getElementById("page-data").textContent);
  const loaded = {}, waiting = {};
  globalThis.physretargetData = (kind, key, content) => { loaded[`${kind}/${key}`] = content; };
  // A page opened from disk may not fetch, but it may load scripts.
  function load(kind, key) {
    const name = `${kind}/${key}`, inside = document.getElementById(name);
    // A page that stands alone brings its data along.
    if (inside) waiting[name] ??= Promise.resolve(JSON.parse(inside.textContent));
    waiting[name] ??= new Promise((done, failed) => {
      const script = document.createElement("script");
      script.src = `../${kind === "model" ? "models" : kind}/${key}.js`;
      script.onload = () => loaded[name] ? done(loaded[name]) : failed(new Error(`${name} is empty`));
      script.onerror = () => failed(new Error(`${script.src} is missing`));
      document.head.append(script);
    });
    return waiting[name];
  }

  // ---- one scene out of two ------------------------------------------------------------------
  const { unpack, frameTimes } = physretarget;
  const bytesOf = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  function textOf(bytes) {
    let text = "";
    for (let i = 0; i < bytes.length; i += 8192) text += String.fromCharCode(...bytes.subarray(i, i + 8192));
    return btoa(text);
  }
  /** A packed track with other rows: row i of the result is row order[i]. */
  function gather(packed, order) {
    const kind = ["u16", "f32", "u8"].find((k) => packed[k] !== undefined);
    const from = bytesOf(packed[kind]), width = from.length / packed.shape[0];
    const to = new Uint8Array(width * order.length);
    order.forEach((row, i) => to.set(from.subarray(row * width, (row + 1) * width), i * width));
    return { ...packed, [kind]: textOf(to), shape: [order.length, ...packed.shape.slice(1)] };
  }
  const keptTimes = (scene) => {
    const times = frameTimes(scene.time);
    return scene.keep ? Array.from(unpack(scene.keep), (f) => times[f]) : Array.from(times);
  };
  /** Put a figure on another clock: at each tick its nearest frame, the ends held. */
  function onClock(figure, own, clock) {
    if (own.length === clock.length && own.every((t, i) => Math.abs(t - clock[i]) < 1e-6)) return figure;
    let row = 0;
    const order = clock.map((t) => {
      while (row + 1 < own.length && Math.abs(own[row + 1] - t) <= Math.abs(own[row] - t)) row++;
      return row;
    });
    const moved = { ...figure };
    for (const track of ["position", "rotation", "com"]) moved[track] = gather(figure[track], order);
    if (figure.contacts && figure.contacts.active) {
      moved.contacts = { ...figure.contacts, active: gather(figure.contacts.active, order) };
    }
    if (figure.forces) {
      moved.forces = { ...figure.forces, origin: gather(figure.forces.origin, order), vector: gather(figure.forces.vector, order) };
    }
    return moved;
  }
  function stageOf(parts) {
    const clock = parts.map(({ motion }) => motion.scene).reduce((a, b) => b.time.frames > a.time.frames ? b : a);
    const ticks = keptTimes(clock), meshes = [];
    const figures = parts.map(({ motion, model, name }, i) => {
      const own = keptTimes(motion.scene), first = meshes.length;
      meshes.push(...model.meshes);
      const shapes = model.shapes.map((s) => s.mesh === undefined ? s : { ...s, mesh: s.mesh + first });
      const { shapes: _, meshes: __, ...looks } = model;
      const figure = onClock({ ...motion.scene.figures[0], ...looks, shapes }, own, ticks);
      const side = parts.length > 1 ? (i ? -0.6 : 0.6) * figure.height : 0;
      return { ...figure, name, offset: [0, side, 0] };
    });
    const now = parts[parts.length - 1].motion.scene;
    return { ...clock, figures, meshes, marks: now.marks, title: now.title, layout: parts.length > 1 ? "split" : "stage" };
  }

  // ---- timelines -----------------------------------------------------------------------------
  const ink = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  const short = (v) => v == null ? "–" : String(+v.toPrecision(3));
  const charts = [];
  let player, zooming = false;
  function placeNow() {
    for (const chart of charts) {
      if (!chart.now) continue;
      const x = chart.valToPos(player.time, "x");
      chart.now.style.display = x >= -1 && x <= chart.over.clientWidth + 1 ? "" : "none";
      chart.now.style.transform = `translateX(${x - 1}px)`;
    }
  }
  function zoomAll(source) {
    if (zooming) return;
    zooming = true;
    const { min, max } = source.scales.x;
    charts.forEach((c) => c !== source && c.setScale("x", { min, max }));
    zooming = false;
    placeNow();
  }
  function go(seconds) {
    player.pause();
    player.seek(seconds);
  }
  function ready(chart) {
    chart.now = Object.assign(document.createElement("div"), { className: "now-line" });
    chart.over.append(chart.now);
    let from = null;
    chart.over.addEventListener("mousedown", (event) => { from = event.clientX; });
    chart.over.addEventListener("click", (event) => {
      if (from !== null && Math.abs(event.clientX - from) > 4) return; // that was a zoom
      go(chart.posToVal(event.clientX - chart.over.getBoundingClientRect().left, "x"));
    });
    requestAnimationFrame(placeNow);
  }
  const axis = (more) => ({ stroke: () => ink("soft"), font: "12px system-ui, sans-serif",
    grid: { stroke: () => ink("line"), width: 1 }, ticks: { stroke: () => ink("line"), width: 1, size: 5 }, ...more });
  function chartOf(group, parts) {
    const looks = group.map((name) => page.charts[name]), tables = [], series = [{ label: "time", value: (u, v) => v == null ? "–" : `${v.toFixed(2)} s` }];
    parts.forEach(({ motion, name: whose }, which) => {
      const old = parts.length > 1 && which === 0, times = Array.from(frameTimes(motion.scene.time));
      const mine = group.filter((name) => motion.series[name]);
      tables.push([times, ...mine.map((name) => Array.from(unpack(motion.series[name]), (v) => Number.isFinite(v) ? v : null))]);
      for (const name of mine) {
        const look = page.charts[name];
        series.push({ label: old ? `${look.label}, ${whose}` : look.label, width: old ? 1.3 : 1.8,
          stroke: () => ink(old && group.length === 1 ? "grey" : look.ink), dash: old ? [5, 4] : undefined,
          points: { show: false }, spanGaps: true, value: (u, v) => short(v) });
      }
    });
    if (series.length < 2) return;
    const figure = Object.assign(document.createElement("figure"), { className: "plot" });
    const caption = document.createElement("figcaption"), root = document.createElement("div");
    caption.textContent = looks[0].title + (looks[0].unit ? `, ${looks[0].unit}` : "");
    root.className = "chart";
    figure.append(caption, root);
    document.getElementById("charts").append(figure);
    const chart = new uPlot({
      width: Math.max(root.clientWidth, 200), height: 190, padding: [10, 12, 0, 0], series,
      scales: { x: { time: false } },
      axes: [axis({ size: 30, values: (u, s) => s.map((v) => `${+v.toFixed(3)} s`) }), axis({ size: 58 })],
      cursor: { sync: { key: "clock", setSeries: false }, drag: { x: true, y: false } },
      hooks: { ready: [ready], setScale: [(u, key) => key === "x" && zoomAll(u)] },
    }, uPlot.join(tables), root);
    charts.push(chart);
    new ResizeObserver(() => requestAnimationFrame(() => {
      const width = Math.floor(root.clientWidth);
      if (width > 50 && width !== chart.width) { chart.setSize({ width, height: 190 }); placeNow(); }
    })).observe(root);
  }
  function timelines(parts) {
    const groups = {};
    for (const [name, look] of Object.entries(page.charts)) (groups[look.group] ??= []).push(name);
    Object.values(groups).forEach((group) => chartOf(group, parts));
    player.on("time", placeNow);
    placeNow();
  }

  // ---- everything ----------------------------------------------------------------------------
  async function start() {
    const place = document.getElementById("player");
    const [then, today] = page.names ?? ["baseline", "now"];
    const wanted = [[then, page.baseline], [today, page.now]].filter(([, key]) => key);
    const parts = await Promise.all(wanted.map(async ([name, key]) => {
      const motion = await load("motion", key);
      return { name, motion, model: await load("model", page.names ? key : motion.model) };
    }));
    player = physretarget.mount(place, stageOf(parts), { autoplay: false });
    globalThis.player = player;
    const own = frameTimes(parts[parts.length - 1].motion.scene.time);
    document.addEventListener("click", (event) => {
      const at = event.target.closest("[data-frame]");
      if (!at) return;
      go(own[Math.min(Math.max(Number(at.dataset.frame), 0), own.length - 1)]);
      const box = place.getBoundingClientRect();
      if (box.bottom < 80 || box.top > innerHeight - 80) place.scrollIntoView({ block: "center" });
    });
    timelines(parts);
  }
  start().catch((error) => {
    const note = Object.assign(document.createElement("p"), { className: "calm", textContent: `The replay cannot be shown: ${error.message}.` });
    document.getElementById("player").replaceChildren(note);
  });
})();
