"use strict";
// A neutral head of simple shapes, moved by ARKit's channels: the capture beside the result.
window.faceScene = (D, show) => {
  const box = document.getElementById("scene");
  const NS = "http://www.w3.org/2000/svg";
  const plain = (name) => name.split(".").pop().replace(/_l$/i, "left").replace(/_r$/i, "right").replace(/[_ ]/g, "").toLowerCase();
  const T0 = D.time[0], T1 = D.time[D.time.length - 1], step = (T1 - T0) / (D.time.length - 1);
  const clamp = (x, a = 0, b = 1) => Math.min(Math.max(x, a), b);

  const sampled = (values) => (t) => {
    const at = clamp((t - T0) / step, 0, values.length - 1), k = Math.min(Math.floor(at), values.length - 2);
    return values[k] + (at - k) * (values[k + 1] - values[k]);
  };
  // The Bézier's parameter at a time, by halving: time runs forward in every span.
  const keyed = (c) => (t) => {
    const n = c.t.length;
    if (n < 2 || t <= c.t[0]) return c.v[0];
    if (t >= c.t[n - 1]) return c.v[n - 1];
    let k = 0;
    while (c.t[k + 1] <= t) k++;
    if (c.s[k]) return c.s[k] === 1 ? c.v[k] : c.v[k + 1];
    const [x1, y1, x2, y2] = c.h[k], cubic = (a, b, d, e, u) => ((1 - u) ** 3 * a + 3 * (1 - u) ** 2 * u * b + 3 * (1 - u) * u * u * d + u ** 3 * e);
    let low = 0, high = 1;
    for (let i = 0; i < 40; i++) {
      const u = (low + high) / 2;
      if (cubic(c.t[k], x1, x2, c.t[k + 1], u) < t) low = u; else high = u;
    }
    return cubic(c.v[k], y1, y2, c.v[k + 1], (low + high) / 2);
  };
  const original = new Map(), result = new Map();
  for (const c of D.channels) { original.set(plain(c.name), sampled(c.capture)); result.set(plain(c.name), keyed(c.curve)); }
  for (const [name, values] of Object.entries(D.dense)) { original.set(plain(name), sampled(values)); result.set(plain(name), sampled(values)); }
  const KNOWN = ["eyeblinkleft", "eyeblinkright", "browinnerup", "jawopen", "eyelookinleft", "browdownleft", "mouthsmileleft"];
  box.hidden = !KNOWN.some((name) => original.has(name));
  if (box.hidden) return { set() {}, time: () => null };

  const element = (tag, parent, attributes) => {
    const e = document.createElementNS(NS, tag);
    for (const [name, value] of Object.entries(attributes)) e.setAttribute(name, value);
    parent.append(e);
    return e;
  };
  function head(label) {
    const figure = document.createElement("figure");
    const svg = element("svg", figure, { viewBox: "-110 -130 220 260", role: "img", "aria-label": `the ${label}'s face` });
    const whole = element("g", svg, {});
    element("ellipse", whole, { rx: 82, ry: 108, class: "skin" });
    const inner = element("g", whole, {});
    const eyes = [-1, 1].map((side) => {
      const g = element("g", inner, { transform: `translate(${34 * side} -22)` });
      return { white: element("ellipse", g, { rx: 18, ry: 11, class: "white" }), iris: element("circle", g, { r: 6.5, class: "iris" }), lid: element("path", g, { class: "line" }), brow: element("path", inner, { class: "brow" }) };
    });
    const nose = element("path", inner, { class: "line" }), mouth = element("path", inner, { class: "mouth" });
    const caption = document.createElement("figcaption");
    caption.textContent = label;
    figure.append(caption);
    box.querySelector(".heads").append(figure);
    return { whole, inner, eyes, nose, mouth };
  }
  function pose(h, from, t) {
    const get = (name) => (from.has(name) ? from.get(name)(t) : 0);
    // The face's left is on the picture's right.
    h.eyes.forEach((eye, k) => {
      const side = k ? "left" : "right", out = k ? 1 : -1;
      const open = clamp(1 - get("eyeblink" + side) + 0.35 * get("eyewide" + side) - 0.3 * get("eyesquint" + side), 0.02, 1.4);
      const x = 9 * out * (get("eyelookout" + side) - get("eyelookin" + side)), y = 7 * (get("eyelookdown" + side) - get("eyelookup" + side));
      eye.white.setAttribute("ry", 11 * open);
      eye.iris.setAttribute("cx", x);
      eye.iris.setAttribute("cy", y);
      eye.iris.setAttribute("r", open < 0.25 ? 0 : Math.min(6.5, 9 * open));
      const top = -11 * open;
      eye.lid.setAttribute("d", `M-19 0Q0 ${1.9 * top} 19 0`);
      const down = 9 * get("browdown" + side), inside = -13 * get("browinnerup") + down, outside = -13 * get("browouterup" + side) + 0.5 * down;
      const cx = 34 * out;
      eye.brow.setAttribute("d", `M${cx - 21 * out} ${-46 + inside}Q${cx} ${-54 + (inside + outside) / 2} ${cx + 21 * out} ${-45 + outside}`);
    });
    const sneer = 4 * Math.max(get("nosesneerleft"), get("nosesneerright"));
    h.nose.setAttribute("d", `M-9 ${18 - sneer}Q0 ${25 - sneer} 9 ${18 - sneer}`);
    const narrow = 1 - 0.45 * clamp(get("mouthpucker") + 0.7 * get("mouthfunnel")), aside = 10 * (get("mouthleft") - get("mouthright"));
    const corner = (side, out) => {
      const wide = 30 * narrow + 6 * get("mouthstretch" + side) + 5 * get("mouthsmile" + side);
      return [aside + out * wide, 55 - 12 * get("mouthsmile" + side) + 10 * get("mouthfrown" + side)];
    };
    const [rx, ry] = corner("right", -1), [lx, ly] = corner("left", 1);
    const jaw = 44 * clamp(get("jawopen")), gap = Math.max(jaw - 30 * clamp(get("mouthclose")), 0);
    const up = 55 - 9 * (get("mouthupperupleft") + get("mouthupperupright")) / 2 - 0.1 * gap;
    const low = 55 + gap + 9 * (get("mouthlowerdownleft") + get("mouthlowerdownright")) / 2;
    const bend = (ry + ly) / 2;
    h.mouth.setAttribute("d", `M${rx} ${ry}Q${aside} ${2 * up - bend + 8} ${lx} ${ly}Q${aside} ${2 * low - bend + 12} ${rx} ${ry}Z`);
    h.whole.setAttribute("transform", `rotate(${-45 * clamp(get("headroll"), -1, 1)})`);
    h.inner.setAttribute("transform", `translate(${30 * clamp(get("headyaw"), -1, 1)} ${30 * clamp(get("headpitch"), -1, 1)})`);
  }
  box.innerHTML = '<div class="heads"></div><div class="play"><button type="button">Play</button><input type="range" aria-label="Time"><output></output></div>';
  const heads = [[head("capture"), original], [head("result"), result]];
  const [button, slider, output] = box.querySelector(".play").children;
  Object.assign(slider, { min: T0, max: T1, step: step / 2, value: T0 });
  let now = T0, playing = null;
  function set(t) {
    now = clamp(t, T0, T1);
    slider.value = now;
    output.textContent = now.toFixed(2) + " s";
    for (const [h, from] of heads) pose(h, from, now);
    show(now);
  }
  const stop = () => { cancelAnimationFrame(playing); playing = null; button.textContent = "Play"; };
  slider.oninput = () => { stop(); set(Number(slider.value)); };
  button.onclick = () => {
    if (playing) return stop();
    button.textContent = "Stop";
    let last = performance.now();
    if (now >= T1) now = T0;
    const tick = (at) => {
      set(now + (at - last) / 1000);
      last = at;
      if (now >= T1) stop(); else playing = requestAnimationFrame(tick);
    };
    playing = requestAnimationFrame(tick);
  };
  set(T0);
  return { set, time: () => now, stop };
};
