"use strict";
(() => {
  const D = JSON.parse(document.getElementById("data").textContent);
  const $ = (id) => document.getElementById(id);
  const make = (tag, text, cls) => {
    const e = document.createElement(tag);
    if (text !== undefined) e.textContent = text;
    if (cls) e.className = cls;
    return e;
  };
  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const percent = (x) => (x === null || x === undefined ? "–" : (100 * x).toFixed(x < 0.1 ? 2 : 1) + " %");
  const seconds = (x) => x.toFixed(2) + " s";
  const T0 = D.time[0], T1 = D.time[D.time.length - 1];
  let view = [T0, T1], picked = null, sharing = false;
  const charts = new Map(); // channel index → uPlot
  let face = null; // the drawn heads

  // ---------------------------------------------------------------- head
  $("title").textContent = D.title;
  $("method").textContent = D.method;
  for (const [label, text] of Object.entries(D.figures)) {
    const row = make("div");
    row.append(make("dt", label), make("dd", text));
    $("figures").append(row);
  }
  if (D.comparison.length) {
    const table = make("table");
    D.comparison.forEach((cells, k) => {
      const row = table.insertRow();
      for (const cell of cells) row.append(make(k ? "td" : "th", cell));
    });
    $("comparison").append(table);
  }
  for (const note of D.notes) $("notes").append(make("li", note));
  $("more").hidden = !D.comparison.length && !D.notes.length;

  const lows = D.channels.map((c) => c.spans.filter((s) => s.low).length);
  const flags = D.channels.flatMap((c, i) => c.spans.filter((s) => s.low).map((s) => [i, s]));
  const groups = [...new Set(D.channels.map((c) => c.group))];
  for (const name of ["all groups", ...groups]) $("group").append(new Option(name, name));
  $("flagged").textContent = `Flagged only (${lows.filter(Boolean).length})`;
  $("flag").textContent = `Next flag (${flags.length})`;
  $("flag").disabled = $("flagged").disabled = !flags.length;

  // ---------------------------------------------------------------- channels
  const frames = [], buttons = [];
  const fill = () => {
    const group = $("group").value, only = $("flagged").getAttribute("aria-pressed") === "true";
    D.channels.forEach((c, i) => {
      const shown = (group === "all groups" || c.group === group) && (!only || lows[i]);
      frames[i].hidden = buttons[i].hidden = !shown;
    });
    document.querySelectorAll("nav h2").forEach((h) => {
      let e = h.nextElementSibling, any = false;
      for (; e && e.tagName !== "H2"; e = e.nextElementSibling) any = any || !e.hidden;
      h.hidden = !any;
    });
  };
  // ---------------------------------------------------------------- events
  const marks = D.events.map((e) => {
    const b = make("button");
    b.type = "button";
    b.append(make("b", e.kind), make("small", `${e.a.toFixed(2)}–${seconds(e.b)}`));
    b.title = e.channels.length ? e.channels.join(", ") : "all keyed channels";
    b.onclick = () => {
      const pad = Math.max(0.5, e.b - e.a);
      marks.forEach((m) => m.classList.toggle("on", m === b));
      shown = e;
      zoom(e.a - pad, e.b + pad);
      if (face.stop) face.stop();
      face.set(e.peak);
      const first = D.channels.findIndex((c) => e.channels.includes(c.name));
      if (first >= 0) show(first);
    };
    return b;
  });
  let shown = null;
  if (marks.length) {
    const box = make("details");
    box.append(make("summary", `Events (${marks.length})`), ...marks);
    box.open = true;
    $("list").append(box);
  }
  let last = null;
  const order = D.channels.map((_, i) => i).sort((a, b) => groups.indexOf(D.channels[a].group) - groups.indexOf(D.channels[b].group) || a - b);
  for (const i of order) {
    const c = D.channels[i];
    if (c.group !== last) $("list").append(make("h2", (last = c.group)));
    const button = make("button");
    button.type = "button";
    button.append(make("b", c.name));
    if (lows[i]) button.append(make("em", "▲" + lows[i]));
    button.append(make("small", c.curve.t.length + " keys"));
    button.title = c.name;
    button.onclick = () => show(i);
    $("list").append(button);
    buttons[i] = button;
    const box = make("section", undefined, "chart");
    box.id = "c" + i;
    const title = make("h3", c.name);
    title.append(make("span", `${c.curve.t.length} keys of ${D.time.length} frames`));
    if (c.error !== null) title.append(make("span", "error " + percent(c.error)));
    if (c.timing !== null) title.append(make("span", `turning points off by ${c.timing.toFixed(1)} frames`));
    if (lows[i]) title.append(make("span", `▲ ${lows[i]} doubtful`, "warn"));
    box.append(title);
    frames[i] = box;
    $("charts").append(box);
  }
  const watcher = new IntersectionObserver((seen) => {
    for (const e of seen) if (e.isIntersecting) draw(Number(e.target.id.slice(1)));
  }, { rootMargin: "500px" });
  frames.forEach((f) => watcher.observe(f));

  function show(i) {
    draw(i);
    frames[i].scrollIntoView({ block: "center", behavior: "auto" });
    buttons.forEach((b, k) => b.classList.toggle("on", k === i));
    frames.forEach((b, k) => b.classList.toggle("on", k === i));
  }

  // ---------------------------------------------------------------- one timeline
  function extent(c) {
    let a = Infinity, b = -Infinity;
    for (const v of c.capture) { if (v < a) a = v; if (v > b) b = v; }
    for (const v of c.curve.v) { if (v < a) a = v; if (v > b) b = v; }
    for (const h of c.curve.h) { a = Math.min(a, h[1], h[3]); b = Math.max(b, h[1], h[3]); }
    const least = 0.02 * (c.range[1] - c.range[0]) || 1;
    if (b - a < least) { const m = (a + b) / 2; a = m - least / 2; b = m + least / 2; }
    const pad = 0.08 * (b - a);
    return [a - pad, b + pad];
  }
  const LANE = 12; // css px of the sources' lane under the plot

  function path(ctx, curve, X, Y) {
    ctx.beginPath();
    curve.t.forEach((t, k) => {
      if (!k) { ctx.moveTo(X(t), Y(curve.v[0])); return; }
      const h = curve.h[k - 1], s = curve.s[k - 1];
      if (s === 1) { ctx.lineTo(X(t), Y(curve.v[k - 1])); ctx.lineTo(X(t), Y(curve.v[k])); }
      else if (s === 2) { ctx.lineTo(X(curve.t[k - 1]), Y(curve.v[k])); ctx.lineTo(X(t), Y(curve.v[k])); }
      else ctx.bezierCurveTo(X(h[0]), Y(h[1]), X(h[2]), Y(h[3]), X(t), Y(curve.v[k]));
    });
  }

  function overlay(u, i) {
    const c = D.channels[i], ctx = u.ctx, r = devicePixelRatio || 1;
    const X = (t) => u.valToPos(t, "x", true), Y = (v) => u.valToPos(v, "y", true);
    const box = u.bbox;
    ctx.save();
    ctx.beginPath();
    ctx.rect(box.left, box.top, box.width, box.height + (LANE + 4) * r);
    ctx.clip();
    const top = box.top + box.height + 3 * r;
    c.spans.forEach((s, k) => {
      const a = X(s.a), w = Math.max(X(s.b) - a, 1);
      if (s.low) {
        ctx.fillStyle = css("--low"); ctx.globalAlpha = 0.13;
        ctx.fillRect(a, box.top, w, box.height); ctx.globalAlpha = 1;
      }
      ctx.fillStyle = s.low ? css("--low") : css(s.kind === "matched" ? (k % 2 ? "--m0" : "--m1") : s.kind === "locked" ? "--locked" : "--fitted");
      ctx.fillRect(a, top, w - r, LANE * r - 2);
    });
    if (shown && (!shown.channels.length || shown.channels.includes(c.name))) {
      ctx.fillStyle = css("--result"); ctx.globalAlpha = 0.1;
      ctx.fillRect(X(shown.a), box.top, X(shown.b) - X(shown.a), box.height); ctx.globalAlpha = 1;
    }
    if (face && face.time() !== null) {
      ctx.fillStyle = css("--accent");
      ctx.fillRect(X(face.time()), box.top, r, box.height);
    }
    ctx.strokeStyle = css("--result"); ctx.lineWidth = 2 * r; ctx.lineJoin = "round";
    path(ctx, c.curve, X, Y);
    ctx.stroke();
    const marked = picked && picked.channel === i ? picked.key : -1;
    if (marked >= 0) {
      ctx.strokeStyle = css("--accent"); ctx.lineWidth = 1.5 * r;
      [[marked - 1, 2], [marked, 0]].forEach(([h, at]) => {
        const handle = c.curve.h[h];
        if (!handle || c.curve.s[h]) return;
        ctx.beginPath(); ctx.moveTo(X(c.curve.t[marked]), Y(c.curve.v[marked]));
        ctx.lineTo(X(handle[at]), Y(handle[at + 1])); ctx.stroke();
        ctx.beginPath(); ctx.arc(X(handle[at]), Y(handle[at + 1]), 3 * r, 0, 7); ctx.fillStyle = css("--accent"); ctx.fill();
      });
    }
    c.curve.t.forEach((t, k) => {
      if (t < view[0] || t > view[1]) return;
      const d = (k === marked ? 6.5 : 4.5) * r, x = X(t), y = Y(c.curve.v[k]), kept = c.locked.includes(k);
      ctx.beginPath();
      if (kept) ctx.rect(x - d, y - d, 2 * d, 2 * d);
      else { ctx.moveTo(x, y - d); ctx.lineTo(x + d, y); ctx.lineTo(x, y + d); ctx.lineTo(x - d, y); ctx.closePath(); }
      ctx.fillStyle = k === marked ? css("--accent") : kept ? css("--locked-key") : css("--result");
      ctx.fill();
      ctx.strokeStyle = css("--panel"); ctx.lineWidth = 1.2 * r; ctx.stroke();
    });
    ctx.restore();
  }

  function draw(i) {
    if (charts.has(i)) return;
    const c = D.channels[i], box = frames[i], y = extent(c);
    const axis = { stroke: () => css("--soft"), grid: { stroke: () => css("--grid"), width: 1 }, ticks: { show: false }, font: "11px system-ui" };
    const u = new uPlot({
      width: box.clientWidth - 20, height: 168, legend: { show: false }, pxAlign: false,
      padding: [6, 18, 0, 0],
      cursor: { y: false, points: { show: false }, drag: { x: true, y: false, setScale: true }, sync: { key: "face", setSeries: false, scales: ["x", null] }, bind: { dblclick: () => () => { zoom(T0, T1); return null; } } },
      scales: { x: { time: false, range: () => view }, y: { range: () => y } },
      series: [{}, { stroke: () => css("--capture"), width: 3, points: { show: false } }],
      axes: [{ ...axis, size: 22 + LANE, gap: LANE + 1, values: (_, v) => v.map((x) => +x.toFixed(3) + " s") }, { ...axis, size: 52 }],
      hooks: {
        draw: [(p) => overlay(p, i)],
        setSelect: [(p) => {
          if (p.select.width < 4) return;
          zoom(p.posToVal(p.select.left, "x"), p.posToVal(p.select.left + p.select.width, "x"));
          p.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
        }],
      },
    }, [D.time, c.capture], box);
    u.over.tabIndex = 0;
    u.over.setAttribute("role", "application");
    u.over.setAttribute("aria-label", `${c.name}: arrow keys step through its keys`);
    let down = 0;
    u.over.addEventListener("mousedown", (e) => (down = e.clientX));
    u.over.addEventListener("click", (e) => {
      if (Math.abs(e.clientX - down) > 4 && down) return;
      const place = u.over.getBoundingClientRect();
      hit(u, i, e.clientX - place.left, e.clientY - place.top);
    });
    u.root.querySelector("canvas").addEventListener("click", (e) => {
      const place = u.over.getBoundingClientRect();
      const t = u.posToVal(e.clientX - place.left, "x");
      const n = c.spans.findIndex((s) => t >= s.a && t <= s.b);
      if (n >= 0) pickSpan(i, n);
    });
    u.over.addEventListener("keydown", (e) => {
      const step = e.key === "ArrowRight" ? 1 : e.key === "ArrowLeft" ? -1 : 0;
      if (!step) return;
      e.preventDefault();
      const at = picked && picked.channel === i ? picked.key + step : 0;
      if (c.curve.t[at] !== undefined) pick(i, at);
    });
    u.over.addEventListener("wheel", (e) => {
      if (!e.shiftKey && !e.ctrlKey) return;
      e.preventDefault();
      const t = u.posToVal(e.clientX - u.over.getBoundingClientRect().left, "x");
      const f = (e.deltaY || e.deltaX) > 0 ? 1.25 : 0.8;
      zoom(t - (t - view[0]) * f, t + (view[1] - t) * f);
    }, { passive: false });
    charts.set(i, u);
  }

  function hit(u, i, x, y) {
    const c = D.channels[i];
    let best = -1, near = 22;
    c.curve.t.forEach((t, k) => {
      if (t < view[0] || t > view[1]) return;
      const d = Math.hypot(u.valToPos(t, "x") - x, 0.5 * (u.valToPos(c.curve.v[k], "y") - y));
      if (d < near) { near = d; best = k; }
    });
    if (best >= 0) return pick(i, best);
    const t = u.posToVal(x, "x"), n = c.spans.findIndex((s) => t >= s.a && t <= s.b);
    if (n >= 0) pickSpan(i, n);
  }

  const redraw = () => charts.forEach((u) => u.redraw(false, true));
  function zoom(a, b) {
    const least = 0.2, span = Math.min(Math.max(b - a, least), T1 - T0);
    const start = Math.min(Math.max((a + b - span) / 2, T0), T1 - span);
    view = [start, start + span];
    if (sharing) return;
    sharing = true;
    charts.forEach((u) => u.setScale("x", { min: view[0], max: view[1] }));
    sharing = false;
  }
  const scaled = (f, shift) => {
    const w = view[1] - view[0], m = (view[0] + view[1]) / 2 + shift * w;
    zoom(m - (w * f) / 2, m + (w * f) / 2);
  };
  $("in").onclick = () => scaled(0.5, 0);
  $("out").onclick = () => scaled(2, 0);
  $("left").onclick = () => scaled(1, -0.4);
  $("right").onclick = () => scaled(1, 0.4);
  $("all").onclick = () => zoom(T0, T1);
  $("group").onchange = fill;
  $("flagged").onclick = (e) => {
    e.target.setAttribute("aria-pressed", String(e.target.getAttribute("aria-pressed") !== "true"));
    fill();
  };
  let flag = -1;
  $("flag").onclick = () => {
    flag = (flag + 1) % flags.length;
    const [i, s] = flags[flag], c = D.channels[i];
    if (frames[i].hidden) { $("group").value = "all groups"; fill(); }
    if (view[1] - view[0] < T1 - T0) zoom(s.a - 1, s.b + 1);
    show(i);
    pickSpan(i, c.spans.indexOf(s));
  };

  // ---------------------------------------------------------------- where a key comes from
  function sketch(curve) {
    const NS = "http://www.w3.org/2000/svg", svg = document.createElementNS(NS, "svg");
    const ys = [...curve.v, ...curve.h.flatMap((h) => [h[1], h[3]])];
    const x0 = curve.t[0], x1 = curve.t[curve.t.length - 1], y0 = Math.min(...ys), y1 = Math.max(...ys);
    const X = (t) => 10 + (280 * (t - x0)) / (x1 - x0 || 1), Y = (v) => 74 - (64 * (v - y0)) / (y1 - y0 || 1);
    let d = "";
    const pen = { moveTo: (x, y) => (d += `M${x} ${y}`), lineTo: (x, y) => (d += `L${x} ${y}`), bezierCurveTo: (...p) => (d += "C" + p.join(" ")), beginPath() {} };
    path(pen, curve, X, Y);
    svg.setAttribute("viewBox", "0 0 300 84");
    svg.setAttribute("preserveAspectRatio", "none");
    svg.setAttribute("role", "img");
    svg.setAttribute("aria-label", "the example's own keys");
    const line = document.createElementNS(NS, "path");
    line.setAttribute("d", d); line.setAttribute("fill", "none"); line.setAttribute("stroke", "currentColor"); line.setAttribute("stroke-width", "1.6"); line.setAttribute("vector-effect", "non-scaling-stroke");
    svg.append(line);
    curve.t.forEach((t, k) => {
      const dot = document.createElementNS(NS, "rect");
      for (const [n, v] of Object.entries({ x: X(t) - 2.5, y: Y(curve.v[k]) - 3, width: 5, height: 6, fill: "currentColor" })) dot.setAttribute(n, v);
      svg.append(dot);
    });
    return svg;
  }

  const KINDS = {
    matched: "Its source was not recorded.", fitted: "A gap: no segment was good enough here.",
    plain: "No past shot explains this better than a plain ease.", rest: "Nothing moves here: a rest has no source.",
    locked: "The animator's own locked keys, kept as they were.", reduced: "Made by plain key reduction, from the capture alone.",
  };
  function tell(panel, label, s) {
    panel.append(make("h4", `${label}, ${seconds(s.a)} to ${seconds(s.b)}`));
    const o = s.from;
    if (!o) { panel.append(make("p", KINDS[s.kind])); if (s.low) panel.append(make("p", "▲ flagged", "flag")); return; }
    if (o.shot) panel.append(make("p", o.shot, "shot"), make("p", `${o.channel}, ${seconds(o.start)} to ${seconds(o.end)} of the shot`));
    else panel.append(make("p", o.what, "shot"), make("p", KINDS[s.kind]));
    const list = make("dl");
    const rows = o.shot ? [["time scale", o.scale.toFixed(2) + "×"], ["height scale", +o.amplitude.toPrecision(3) + "×"]] : [];
    rows.push(["error", percent(o.error)], ["confidence", percent(o.confidence)]);
    if (o.shot) rows.push(["likelier than an ease by", o.margin === null ? "–" : `${o.margin.toFixed(1)} nats`], ["segments of this shape", o.alike]);
    for (const [a, b] of rows) { const row = make("div"); row.append(make("dt", a), make("dd", b)); list.append(row); }
    panel.append(list);
    if (s.low) panel.append(make("p", "▲ doubtful: other solutions that are about as likely have keys elsewhere, so look at this span", "flag"));
    if (o.curve && o.curve.t.length > 1) panel.append(sketch(o.curve));
  }
  function open(i, title, sub) {
    const panel = $("source");
    panel.replaceChildren();
    panel.classList.remove("empty");
    const close = make("button", "Close", "close");
    close.type = "button";
    close.onclick = () => { picked = null; nothing(); redraw(); };
    if (getComputedStyle(panel).position === "fixed") frames[i].scrollIntoView({ block: "start" });
    panel.append(close, make("h2", title), make("p", sub, "soft"));
    panel.scrollTop = 0;
    return panel;
  }
  function pick(i, k) {
    const c = D.channels[i], t = c.curve.t[k];
    picked = { channel: i, key: k };
    face.set(t);
    if (t < view[0] || t > view[1]) zoom(t - (view[1] - view[0]) / 2, t + (view[1] - view[0]) / 2);
    const panel = open(i, c.name, `key ${k + 1} of ${c.curve.t.length} at ${seconds(t)}, value ${+c.curve.v[k].toPrecision(4)}; in ${c.types[k][0]}, out ${c.types[k][1]}`);
    if (c.locked.includes(k)) panel.append(make("p", "■ locked: the animator's own key, kept as it was", "flag"));
    const step = make("div", undefined, "step");
    for (const [name, to] of [["◀ key", k - 1], ["key ▶", k + 1]]) {
      const b = make("button", name);
      b.type = "button";
      b.disabled = c.curve.t[to] === undefined;
      b.onclick = () => pick(i, to);
      step.append(b);
    }
    panel.append(step);
    const e = 1e-4, near = c.spans.filter((s) => t >= s.a - e && t <= s.b + e);
    if (!near.length) panel.append(make("p", "No source was recorded for this key."));
    for (const s of near) {
      const at = near.length < 2 ? "This key" : s.b <= t + e ? "Before this key" : "After this key";
      tell(panel, at, s);
    }
    redraw();
  }
  function pickSpan(i, n) {
    picked = null;
    const c = D.channels[i], panel = open(i, c.name, `span ${n + 1} of ${c.spans.length}`);
    tell(panel, "This span", c.spans[n]);
    redraw();
  }
  function nothing() {
    const panel = $("source");
    panel.replaceChildren(make("h2", "Where a key comes from"), make("p", "Click a key (a diamond) or a span (the strip below a timeline): its shot, the time in that shot, scale, error and confidence are told here.", "soft"), make("p", "Drag over a timeline to zoom all of them, double-click for the whole take; Shift + wheel zooms too. Arrow keys step through the keys of the timeline in focus.", "soft"));
    panel.classList.add("empty");
  }
  nothing();
  fill();
  face = window.faceScene(D, () => charts.forEach((u) => u.redraw(false, true)));
  let wide = innerWidth;
  addEventListener("resize", () => {
    if (innerWidth === wide) return;
    wide = innerWidth;
    charts.forEach((u, i) => u.setSize({ width: Math.max(frames[i].clientWidth - 20, 100), height: 168 }));
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  window.faceReport = { face, pick, pickSpan, zoom, show, charts, view: () => view };
})();
