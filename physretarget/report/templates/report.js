// The report page: charts, maps and tables that share the replay's clock.
"use strict";
(() => {
  const data = JSON.parse(document.getElementById("page-data").textContent);
  const place = document.getElementById("dock-place"), frame = document.getElementById("player");
  const player = physretarget.mount(frame, data.scene, { autoplay: data.autoplay });
  const stage = player.stage;
  const time = Array.from(physretarget.frameTimes(data.scene.time));
  const charts = [];
  globalThis.player = player;

  const ink = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  const clear = (name, part) => `color-mix(in srgb, ${ink(name)} ${part}%, transparent)`;

  // ---- jumping -------------------------------------------------------------------------------
  function show(seconds) {
    player.pause();
    player.seek(seconds);
    const box = place.getBoundingClientRect();
    const hidden = box.bottom < 80 || box.top > innerHeight - 80;
    if (hidden && !frame.classList.contains("docked")) place.scrollIntoView({ block: "center" });
  }
  const showFrame = (index) => show(time[Math.min(Math.max(index, 0), time.length - 1)]);
  document.addEventListener("click", (event) => {
    const at = event.target.closest("[data-frame]");
    if (at) showFrame(Number(at.dataset.frame));
  });
  document.addEventListener("keydown", (event) => {
    if (event.key !== "Enter" || !event.target.matches(".tile[data-frame]")) return;
    showFrame(Number(event.target.dataset.frame));
  });

  // ---- charts --------------------------------------------------------------------------------
  let zooming = false;
  function zoomAll(source) {
    if (zooming) return;
    zooming = true;
    const { min, max } = source.scales.x;
    charts.forEach((c) => c !== source && c.setScale("x", { min, max }));
    zooming = false;
    placeNow();
  }
  function placeNow() {
    for (const chart of charts) {
      if (!chart.now) continue; // uPlot builds itself a moment later
      const x = chart.valToPos(player.time, "x");
      chart.now.style.display = x >= -1 && x <= chart.over.clientWidth + 1 ? "" : "none";
      chart.now.style.transform = `translateX(${x - 1}px)`;
    }
  }
  function clickable(chart) {
    chart.now = Object.assign(document.createElement("div"), { className: "now-line" });
    chart.over.append(chart.now);
    placeNow();
    chart.setLegend({ idx: player.frame });
    let from = null;
    chart.over.addEventListener("mousedown", (event) => { from = event.clientX; });
    chart.over.addEventListener("click", (event) => {
      if (from !== null && Math.abs(event.clientX - from) > 4) return; // that was a zoom
      show(chart.posToVal(event.clientX - chart.over.getBoundingClientRect().left, "x"));
    });
  }
  const axis = (more) => ({
    stroke: () => ink("soft"), font: "12px system-ui, sans-serif",
    grid: { stroke: () => ink("line"), width: 1 }, ticks: { stroke: () => ink("line"), width: 1, size: 5 },
    ...more,
  });
  const seconds = () => axis({ size: 32, values: (u, splits) => splits.map((v) => `${+v.toFixed(3)} s`) });
  function base(height) {
    return {
      width: 400, height, padding: [10, 12, 0, 0],
      scales: { x: { time: false } },
      cursor: { sync: { key: "clock", setSeries: false }, drag: { x: true, y: false }, points: { size: 7 } },
      hooks: { ready: [clickable], setScale: [(u, key) => key === "x" && zoomAll(u)] },
    };
  }
  const short = (v) => {
    if (v == null) return "–";
    const size = Math.abs(v);
    return size >= 100 ? v.toFixed(0) : size >= 1 ? v.toFixed(2) : size >= 0.01 || v === 0 ? v.toFixed(3)
      : v.toPrecision(2);
  };
  /** Tick labels with as many decimals as their step needs. */
  const ticks = (u, splits) => {
    const step = Math.abs(splits[1] - splits[0]) || 1;
    const decimals = Math.min(Math.max(0, -Math.floor(Math.log10(step) + 1e-9)), 8);
    return splits.map((v) => (step * 10 ** decimals % 1 > 1e-6 ? v.toFixed(decimals + 1) : v.toFixed(decimals)));
  };

  function levelsOf(chart) {
    return (u) => {
      const pen = u.ctx, ratio = devicePixelRatio || 1;
      pen.save();
      pen.beginPath();
      pen.rect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height);
      pen.clip();
      pen.strokeStyle = pen.fillStyle = ink("grey");
      pen.font = `${11 * ratio}px system-ui, sans-serif`;
      pen.setLineDash([3 * ratio, 4 * ratio]);
      for (const [value, label] of chart.levels) {
        const y = Math.round(u.valToPos(value, "y", true));
        pen.beginPath();
        pen.moveTo(u.bbox.left, y);
        pen.lineTo(u.bbox.left + u.bbox.width, y);
        pen.stroke();
        pen.textAlign = "right";
        pen.save();
        pen.setLineDash([]);
        pen.lineWidth = 4 * ratio;
        pen.strokeStyle = ink("card"); // a halo keeps the words readable over lines
        pen.strokeText(label, u.bbox.left + u.bbox.width - 4 * ratio, y - 4 * ratio);
        pen.restore();
        pen.fillText(label, u.bbox.left + u.bbox.width - 4 * ratio, y - 4 * ratio);
      }
      pen.restore();
    };
  }
  function lineChart(root, chart) {
    const options = base(innerWidth < 640 ? 200 : 236), columns = [time];
    const values = chart.series.map((s) =>
      Array.from(physretarget.unpack(s.values), (v) => Number.isFinite(v) ? v : null));
    columns.push(...values);
    if (chart.range) options.scales.y = { range: chart.range };
    options.axes = [
      seconds(),
      axis({ size: 58, values: ticks, label: chart.unit, labelSize: 20, labelFont: "12px system-ui, sans-serif" }),
    ];
    options.series = [{ label: "time", value: (u, v) => v == null ? "–" : `${v.toFixed(2)} s` },
      ...chart.series.map((s) => ({
        label: s.label, stroke: () => ink(s.ink), width: 1.8, dash: s.dashed ? [7, 4] : undefined,
        fill: s.fill ? () => clear(s.ink, 16) : undefined, points: { show: false },
        value: (u, v) => short(v), spanGaps: false,
      }))];
    options.hooks.draw = [levelsOf(chart)];
    charts.push(new uPlot(options, columns, root));
  }
  function laneChart(root, chart) {
    const row = 22, rows = chart.lanes.length, options = base(rows * row + 46);
    options.scales.y = { range: [0, rows] };
    options.legend = { show: false };
    options.cursor.points = { show: false };
    const width = Math.min(130, 22 + 7.2 * Math.max(...chart.lanes.map((l) => l.label.length)));
    options.axes = [
      seconds(),
      axis({ size: width, splits: () => chart.lanes.map((_, i) => rows - i - 0.5),
        values: () => chart.lanes.map((l) => l.label), grid: { show: false }, ticks: { show: false } }),
    ];
    options.series = [{}, { stroke: "transparent", points: { show: false } }];
    options.hooks.draw = [(u) => {
      const pen = u.ctx, step = u.bbox.height / rows, right = u.bbox.left + u.bbox.width;
      chart.lanes.forEach((lane, i) => {
        const y = u.bbox.top + i * step + 0.2 * step;
        for (const [first, last, name] of lane.spans) {
          const end = time[Math.min(last + 1, time.length - 1)];
          const a = Math.max(u.valToPos(time[first], "x", true), u.bbox.left);
          const b = Math.min(u.valToPos(end, "x", true), right);
          if (b < u.bbox.left || a > right) continue;
          pen.fillStyle = ink(name);
          pen.beginPath();
          pen.roundRect(a, y, Math.max(b - a, 3 * (devicePixelRatio || 1)), 0.6 * step, 0.15 * step);
          pen.fill();
        }
      });
    }];
    charts.push(new uPlot(options, [time, time.map(() => null)], root));
  }
  function build() {
    for (const root of document.querySelectorAll("[data-chart]")) {
      const chart = data.charts[root.dataset.chart];
      if (!chart) continue;
      (chart.lanes ? laneChart : lineChart)(root, chart);
      const made = charts[charts.length - 1];
      const fit = () => {
        const width = Math.floor(root.clientWidth);
        if (width < 50 || width === made.width) return;
        made.setSize({ width, height: made.height });
        placeNow();
      };
      fit();
      new ResizeObserver(() => requestAnimationFrame(fit)).observe(root);
    }
  }

  // ---- latent maps ---------------------------------------------------------------------------
  const maps = [...document.querySelectorAll("[data-latent]")].map((svg) => {
    const points = physretarget.unpack(data.latent[Number(svg.dataset.latent)]);
    svg.addEventListener("click", (event) => {
      const box = svg.getBoundingClientRect();
      const x = 100 * (event.clientX - box.left) / box.width, y = 100 * (event.clientY - box.top) / box.height;
      let best = 0, near = Infinity;
      for (let i = 0; i < points.length / 2; i++) {
        const d = (points[2 * i] - x) ** 2 + (points[2 * i + 1] - y) ** 2;
        if (d < near) { near = d; best = i; }
      }
      showFrame(best);
    });
    return { now: svg.querySelector(".now"), points };
  });

  // ---- follow the clock ----------------------------------------------------------------------
  const rows = [...document.querySelectorAll(".findings tr[data-frame]")];
  const spans = rows.map((row, i) => data.spans[i]);
  function follow(seconds, at) {
    placeNow();
    for (const chart of charts) { // the legend tells the values now, or under the mouse
      if (chart.now && chart.legend.idx !== at && chart.cursor.left < 0) chart.setLegend({ idx: at });
    }
    for (const map of maps) {
      map.now.setAttribute("cx", map.points[2 * at]);
      map.now.setAttribute("cy", map.points[2 * at + 1]);
    }
    rows.forEach((row, i) => row.classList.toggle("on", spans[i][0] <= at && at <= spans[i][1]));
  }

  // ---- the replay stays in sight ---------------------------------------------------------------
  function dock() {
    const close = Object.assign(document.createElement("button"),
      { className: "undock", type: "button", textContent: "×", title: "Close the small replay" });
    let wanted = true;
    close.setAttribute("aria-label", close.title);
    close.addEventListener("click", () => { wanted = false; frame.classList.remove("docked"); });
    frame.append(close);
    const settle = () => {
      const below = place.getBoundingClientRect().bottom; // how much of its place is in sight
      if (below > 90) wanted = true;
      frame.classList.toggle("docked", below < 60 && wanted && innerWidth >= 1000);
    };
    addEventListener("scroll", settle, { passive: true });
    addEventListener("resize", settle);
    settle();
  }

  const repaint = () => charts.forEach((chart) => chart.redraw(false));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", repaint);
  addEventListener("beforeprint", () => { document.documentElement.dataset.theme = "light"; repaint(); });
  addEventListener("afterprint", () => { delete document.documentElement.dataset.theme; repaint(); });

  build();
  player.on("time", follow);
  follow(player.time, player.frame);
  dock();
  const strip = document.getElementById("strip");
  if (strip && data.strip) {
    physretarget.filmstrip(strip, data.scene, { ...data.strip, onpick: show });
  }
})();
