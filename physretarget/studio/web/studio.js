// The studio's page: what the session holds, shown; what the hand does, sent.
"use strict";
(() => {
  const $ = (id) => document.getElementById(id);
  const token = new URLSearchParams(location.search).get("token") || "";
  const DEGREES = 180 / Math.PI;
  let state = null, stage = null, actor = null, character = null, coverage = null;
  let take = 0, seconds = 0, selected = null, pose = null, dragging = null, playing = 0, played = {};

  // ---- the server ----------------------------------------------------------------------------
  async function ask(path, body) {
    const request = { headers: { "X-Studio-Token": token } };
    if (body !== undefined) {
      request.method = "POST";
      request.body = JSON.stringify(body);
      request.headers["Content-Type"] = "application/json";
    }
    let answer;
    try {
      answer = await fetch("/api/" + path, request);
    } catch (error) {
      throw new Error("The studio does not answer: is it still running? Nothing that was saved is lost.");
    }
    const content = await answer.json().catch(() => ({ error: "The studio answered with no JSON." }));
    if (!answer.ok) {
      const text = content.error || "The request was refused.";
      throw Object.assign(new Error(text), { status: answer.status });
    }
    return content;
  }

  function say(text, bad = false) {
    $("saved").textContent = text;
    $("saved").classList.toggle("bad", bad);
  }

  /** Changes go one after the other, each on the revision that the one before left. */
  let last = Promise.resolve();
  function change(what, fields = {}) {
    last = last.then(async () => {
      say("saving…");
      try {
        const found = await ask(what, { revision: state.revision, ...fields });
        take_in(found);
        say("saved");
      } catch (error) {
        say(error.message, true);
        if (error.status === 409 || error.status === 422) take_in(await ask("state"));
      }
    }).catch((error) => say(error.message, true));
    return last;
  }

  function take_in(found) {
    if (stage && found.model !== stage.model) points_changed();
    const fresh = !state || found.revision !== state.revision;
    state = found;
    if (found.selected) selected = found.selected;
    if (selected && !state.poses.some((p) => p.name === selected)) selected = null;
    if (fresh) { played = {}; later(); }
    list();
    select(selected);
  }

  /** What takes a moment, after a change: how well the captures are known, what to pose next. */
  let pending = 0;
  function later() {
    clearTimeout(pending);
    pending = setTimeout(async () => {
      if (!stage.takes.length) return;
      try {
        const [known, queue] = await Promise.all([ask("coverage"), ask("suggest?count=8")]);
        coverage = known;
        expected(known.expected);
        $("queue").replaceChildren(...queue.map(suggestion));
        line();
        if ($("until").value !== "edit") show();
      } catch (error) { say(error.message, true); }
    }, 150);
  }

  /** The error to be expected on unposed frames, and what the last change did to it. */
  let before = null;
  function expected(now) {
    const percent = (share) => `${(100 * share).toFixed(1)} %`;
    let text = "Expected error: two key poses tell.";
    if (now !== null) {
      text = `Expected error on other frames: ${percent(now)} of the height`;
      if (before !== null && Math.abs(now - before) >= 0.0005) text += `, ${now < before ? "fell" : "rose"} by ${percent(Math.abs(now - before))}`;
      text += ".";
    }
    $("known").textContent = text;
    $("known").title = "Root mean square distance of a virtual marker, by the standard deviation that the mapper gives itself";
    before = now;
  }

  // ---- lists ---------------------------------------------------------------------------------
  function button(text, act, note) {
    const item = document.createElement("li"), made = document.createElement("button");
    made.textContent = text;
    if (note) {
      const small = document.createElement("small");
      small.textContent = note;
      made.append(small);
    }
    made.onclick = act;
    item.append(made);
    return item;
  }

  function suggestion(each) {
    return button(`${each.time.toFixed(2)} s in ${stage.takes[each.take].name}`, () => {
      choose(each.take);
      to(each.time);
      change("add", { take: each.take, time: each.time });
    }, each.reason);
  }

  function list() {
    $("count").textContent = `(${state.poses.length})`;
    $("poses").replaceChildren(...state.poses.map((p) => {
      const mine = state.remarks.filter((r) => r.pose === p.name);
      const item = button(p.name, () => { select(p.name, true); });
      const made = item.firstChild;
      made.setAttribute("aria-current", p.name === selected);
      made.title = mine.map((r) => r.message).join("\n");
      if (mine.length) made.className = mine.some((r) => r.severity === "error") ? "bad" : "warn";
      return item;
    }));
    limbs();
    $("undo").disabled = !state.undo;
    $("redo").disabled = !state.redo;
    $("undo").textContent = state.undo ? `Undo: ${state.undo}` : "Undo";
    $("redo").textContent = state.redo ? `Redo: ${state.redo}` : "Redo";
    line();
  }

  // ---- one key pose --------------------------------------------------------------------------
  function select(name, seek = false) {
    selected = name;
    const found = state.poses.find((p) => p.name === name);
    $("tools").hidden = !found;
    $("hint").hidden = !!found;
    for (const each of $("poses").querySelectorAll("button")) {
      each.setAttribute("aria-current", each.firstChild.textContent === name);
    }
    if (!found) { pose = null; character.showHandles(false); return; }
    pose = { ...found, planted: [...found.planted], qpos: [...found.qpos] };
    $("name").textContent = name;
    const other = $("other").value;
    $("other").replaceChildren(...state.poses.filter((p) => p.name !== name).map((p) => new Option(p.name)));
    if (other && other !== name) $("other").value = other;
    for (const box of $("planted").querySelectorAll("input")) box.checked = pose.planted.includes(box.value);
    if (seek) {
      if (found.take !== null) { choose(found.take); to(found.time); }
      $("until").value = "edit";
    }
    if ($("until").value === "edit") show();
  }

  function told(found) {
    pose.qpos = found.qpos;
    character.pose(found.position, found.rotation);
    character.paintHandles(pose.planted, dragging && dragging.handle);
    character.tint(found.touching);
    for (const row of $("joints").children) {
      const value = found.qpos[row.joint.qpos] * (row.joint.kind === "hinge" ? DEGREES : 1);
      row.set(value);
    }
    const alerts = found.errors.map((text) => ["bad", text]);
    if (found.touching.length) alerts.push(["warn", "Two parts are in each other"]);
    if (found.margin === null) alerts.push(["warn", "Nothing stands on the floor"]);
    else if (found.margin < 0) alerts.push(["warn", `Off balance by ${(-1000 * found.margin).toFixed(0)} mm`]);
    else alerts.push(["", `Balanced, ${(1000 * found.margin).toFixed(0)} mm from the edge`]);
    $("alerts").replaceChildren(...alerts.map(([kind, text]) => {
      const span = document.createElement("span");
      span.className = kind;
      span.textContent = text;
      return span;
    }));
  }

  /** Gestures are answered beside the page, by hand.js; the newest answer is shown with the frame. */
  const worker = new Worker("/web/hand.js");
  let about = 0, answered = null, waiting = [];
  const idle = () => new Promise((done) => { if (busy) waiting.push(done); else done(); });
  let busy = false;
  function drag(gesture, held = false) {
    about += 1;
    busy = true;
    const whole = { name: selected, planted: pose.planted, gaze: $("gaze").firstChild.checked, ...gesture };
    worker.postMessage({ gesture: held && dragging.begun ? whole : { ...whole, qpos: pose.qpos }, held, about });
    if (held) dragging.begun = true;
    return idle();
  }
  function arrived() {
    const found = answered;
    answered = null;
    if (found && pose && pose.name === found.name) told(found.found);
  }
  worker.onmessage = ({ data }) => {
    if (data.error) { say(data.error, true); return; }
    if (data.found) {
      if (!answered) requestAnimationFrame(arrived);
      answered = data;
      return;
    }
    if (data.idle !== about) return; // a later gesture is on its way to the worker
    arrived();
    busy = false;
    for (const done of waiting.splice(0)) done();
  };
  worker.postMessage({ token });

  async function settle() {
    worker.postMessage({ released: true });
    await idle();
    if (pose) await change("put", { name: selected, qpos: pose.qpos, planted: pose.planted });
  }

  function joints() {
    $("joints").replaceChildren(...stage.joints.map((joint) => {
      const row = document.createElement("div"), label = document.createElement("label");
      const hinge = joint.kind === "hinge", scale = hinge ? DEGREES : 1;
      const slider = Object.assign(document.createElement("input"), { type: "range", step: hinge ? 0.5 : 0.001,
        min: (joint.low ?? (hinge ? -Math.PI : -1)) * scale, max: (joint.high ?? (hinge ? Math.PI : 1)) * scale });
      const number = Object.assign(document.createElement("input"), { type: "number", step: hinge ? 1 : 0.001 });
      const [x, y, z] = joint.axis.map((v) => v.toFixed(2));
      label.textContent = joint.name;
      label.title = `${hinge ? "turns about" : "slides along"} (${x}, ${y}, ${z}) of its body, `
        + `${(+slider.min).toFixed(hinge ? 0 : 3)} to ${(+slider.max).toFixed(hinge ? 0 : 3)} ${hinge ? "degrees" : "m"}`;
      slider.setAttribute("aria-label", joint.name);
      number.setAttribute("aria-label", `${joint.name}, ${hinge ? "degrees" : "metres"}`);
      row.className = "joint";
      row.joint = joint;
      row.set = (value) => { slider.value = value; if (document.activeElement !== number) number.value = value.toFixed(hinge ? 1 : 3); };
      slider.oninput = () => drag({ joint: joint.name, value: slider.value / scale });
      slider.onchange = settle;
      number.onchange = async () => { drag({ joint: joint.name, value: number.value / scale }); await settle(); };
      row.onpointerenter = () => { for (const h of character.handle) if (h.body === joint.body && !h.tie) h.dot.scale.setScalar(1.8); character.draw(); };
      row.onpointerleave = () => { for (const h of character.handle) h.dot.scale.setScalar(1); character.draw(); };
      row.append(label, number, slider);
      return row;
    }));
    $("planted").replaceChildren(...stage.points.map((point) => {
      const label = document.createElement("label");
      const box = Object.assign(document.createElement("input"), { type: "checkbox", value: point });
      box.onchange = async () => {
        pose.planted = [...$("planted").querySelectorAll("input:checked")].map((each) => each.value);
        drag({});
        await settle();
      };
      label.append(box, " " + point.replace("_", " "));
      return label;
    }));
  }

  /** Which limb of the character acts for which of the actor's. */
  function limbs() {
    $("pairs").replaceChildren(...Object.entries(state.limbs).map(([actor, found]) => {
      const label = document.createElement("label"), select = document.createElement("select");
      const name = actor.replace("_", " ");
      select.append(new Option(`as it is built: ${found.chosen === null ? found.acts || "none" : "…"}`, "?"),
        new Option("none", ""), ...stage.limbs.map((body) => new Option(body, body)));
      select.value = found.chosen === null ? "?" : found.chosen;
      select.setAttribute("aria-label", `Limb for the actor's ${name}`);
      select.onchange = () => change("limb", { name: actor, limb: select.value === "?" ? null : select.value });
      label.append(name, select);
      return label;
    }));
  }

  // ---- contact points and markers ------------------------------------------------------------
  let placing = null;
  function place(point, words) {
    if ($("until").value !== "edit") { $("until").value = "edit"; show(); }
    placing = point;
    $("caption").textContent = point ? `Click where ${words} should be (Esc: nowhere)` : stage.character;
    $("character").classList.toggle("placing", !!point);
  }

  function points() {
    const ties = (tie) => [new Option("nothing", ""), ...stage.ties.map((name) => new Option(name.replace("_", " "), name, false, name === tie))];
    $("contacts").replaceChildren(...stage.handles.filter((h) => h.contact).map((h) => {
      const item = document.createElement("li"), follows = document.createElement("select");
      follows.append(...ties(h.tie));
      follows.value = h.tie || "";
      follows.setAttribute("aria-label", `What ${h.name} follows`);
      follows.onchange = () => change("point/tie", { name: h.name, other: follows.value });
      const again = Object.assign(document.createElement("button"), { textContent: "Place" });
      again.setAttribute("aria-label", `Place ${h.name}`);
      again.onclick = () => place({ name: h.name, other: h.tie || "" }, h.name);
      const drop = Object.assign(document.createElement("button"), { textContent: "×" });
      drop.setAttribute("aria-label", `Remove ${h.name}`);
      drop.onclick = () => change("point/drop", { name: h.name });
      const label = document.createElement("span");
      label.textContent = h.name.replace(/^contact_/, "");
      item.append(label, follows, again, drop);
      return item;
    }));
    $("tie").replaceChildren(...ties(null));
    const marker = $("marker").value;
    $("marker").replaceChildren(...stage.markers.map((m) => new Option(`${m.name.replace(/^marker_/, "")} (${m.body})`, m.name)));
    if (marker) $("marker").value = marker;
    $("place").onclick = () => place({ name: "", other: $("tie").value }, "the contact point");
    $("move").onclick = () => place({ name: $("marker").value, other: "" }, $("marker").value);
  }

  /** The character's file has other points than the page shows. */
  async function points_changed() {
    try {
      stage = await ask("stage");
      character.handles(stage.handles);
      joints();
      points();
      select(selected);
    } catch (error) { say(error.message, true); }
  }

  // ---- the hand ------------------------------------------------------------------------------
  function hands(canvas) {
    canvas.addEventListener("pointerdown", (event) => {
      if (!placing) return;
      event.stopImmediatePropagation();
      const point = placing, way = character.ray(event.clientX, event.clientY).toArray();
      place(null);
      change("point", { ...point, qpos: pose ? pose.qpos : stage.rest, eye: character.camera.position.toArray(), way });
    }, { capture: true });
    canvas.addEventListener("pointerdown", (event) => {
      if (!pose || $("until").value !== "edit") return;
      const handle = character.pick(event.clientX, event.clientY);
      if (!handle) return;
      event.stopImmediatePropagation();
      canvas.setPointerCapture(event.pointerId);
      dragging = { handle, from: handle.dot.position.clone() };
      $("caption").textContent = handle.name;
    }, { capture: true });
    canvas.addEventListener("pointermove", (event) => {
      if (!dragging) { canvas.style.cursor = placing ? "crosshair" : pose && character.pick(event.clientX, event.clientY) ? "grab" : ""; return; }
      event.stopImmediatePropagation();
      const { handle } = dragging, place = character.under(event.clientX, event.clientY, dragging.from);
      dragging.moved = true;
      drag({ hands: [{ body: handle.body, local: handle.local, target: place.toArray() }] }, true);
    }, { capture: true });
    const end = async (event) => {
      if (!dragging) return;
      event.stopImmediatePropagation();
      const { moved } = dragging;
      dragging = null;
      $("caption").textContent = stage.character;
      if (moved) await settle();
    };
    canvas.addEventListener("pointerup", end, { capture: true });
    canvas.addEventListener("pointercancel", end, { capture: true });
  }

  // ---- time ----------------------------------------------------------------------------------
  async function choose(number) {
    if (!stage.takes.length || (number === take && actor)) return;
    take = number;
    $("take").value = number;
    const scene = await ask(`takes/${number}`);
    if (actor) actor.show(scene); else actor = new physretarget.View($("actor").querySelector("canvas"), scene);
    $("actor").querySelector("figcaption").textContent = stage.takes[number].name;
    to(seconds);
    line();
  }

  function to(time) {
    if (!stage.takes.length) return;
    const end = stage.takes[take].seconds;
    seconds = Math.min(Math.max(time, 0), end);
    $("clock").textContent = `${seconds.toFixed(2)} of ${end.toFixed(2)} s`;
    $("cursor").style.left = `${100 * seconds / (end || 1)}%`;
    $("timeline").setAttribute("aria-valuemax", end.toFixed(2));
    $("timeline").setAttribute("aria-valuenow", seconds.toFixed(2));
    if (actor) actor.at(seconds);
    if ($("until").value !== "edit" && character.taken) character.at(seconds);
  }

  async function show() {
    const until = $("until").value;
    if (until === "edit") {
      if (character.taken) { character.show(stage.scene); character.handles(stage.handles); character.taken = false; }
      character.showHandles(!!pose);
      $("verdict").textContent = "";
      if (pose) await drag({ hands: [] });
      return;
    }
    const key = `${state.revision} ${take} ${until}`;
    try {
      $("verdict").textContent = "playing it on the character…";
      const found = played[key] || (played[key] = await ask(`play/${take}?until=${until}`));
      if ($("until").value !== until) return;
      character.show(found.scene);
      character.taken = true;
      $("alerts").replaceChildren();
      $("verdict").textContent = found.words || "";
      to(seconds);
    } catch (error) { $("verdict").textContent = ""; say(error.message, true); $("until").value = "edit"; show(); }
  }

  function line() {
    const canvas = $("timeline").querySelector("canvas"), ratio = devicePixelRatio || 1;
    const w = canvas.width = canvas.clientWidth * ratio, h = canvas.height = canvas.clientHeight * ratio;
    if (!w || !stage.takes.length) return;
    const ink = getComputedStyle(document.body), pen = canvas.getContext("2d"), end = stage.takes[take].seconds || 1;
    const known = coverage && coverage.takes[take];
    if (known && known.time.length) {
      pen.fillStyle = ink.getPropertyValue("--line");
      pen.beginPath();
      pen.moveTo(known.time[0] / end * w, h);
      known.time.forEach((t, k) => pen.lineTo(t / end * w, h - known.unknown[k] * (h - 14 * ratio)));
      pen.lineTo(known.time[known.time.length - 1] / end * w, h);
      pen.fill();
    }
    for (const p of state ? state.poses : []) {
      if (p.take !== take) continue;
      pen.fillStyle = p.name === selected ? ink.getPropertyValue("--accent") : ink.getPropertyValue("--soft");
      pen.beginPath();
      pen.arc(p.time / end * w, 7 * ratio, 4.5 * ratio, 0, 7);
      pen.fill();
    }
  }

  function scrub() {
    const bar = $("timeline");
    const there = (event) => {
      const r = bar.getBoundingClientRect();
      to((event.clientX - r.left) / r.width * stage.takes[take].seconds);
    };
    bar.onpointerdown = (event) => { bar.setPointerCapture(event.pointerId); bar.held = true; stop(); there(event); };
    bar.onpointermove = (event) => { if (bar.held) there(event); };
    bar.onpointerup = bar.onpointercancel = () => { bar.held = false; };
    bar.onkeydown = (event) => {
      const step = { ArrowLeft: -1, ArrowRight: 1, PageUp: -30, PageDown: 30 }[event.key];
      if (step) { event.preventDefault(); to(seconds + step / 30); }
    };
    new ResizeObserver(line).observe(bar);
  }

  function stop() { cancelAnimationFrame(playing); playing = 0; $("play").textContent = "Play"; }

  function play() {
    if (playing) { stop(); return; }
    $("play").textContent = "Pause";
    let before = performance.now();
    const step = (now) => {
      to(seconds >= stage.takes[take].seconds ? 0 : seconds + (now - before) / 1000);
      before = now;
      playing = requestAnimationFrame(step);
    };
    playing = requestAnimationFrame(step);
  }

  // ---- all together --------------------------------------------------------------------------
  function controls() {
    $("undo").onclick = () => change("undo");
    $("redo").onclick = () => change("redo");
    $("plant").onclick = () => change("plant", { name: selected });
    $("mirror").onclick = () => change("mirror", { name: selected });
    $("reset").onclick = () => change("reset", { name: selected });
    $("delete").onclick = () => change("delete", { name: selected });
    $("rename").onclick = () => {
      const name = prompt("Name of the key pose", selected);
      if (name && name !== selected) change("rename", { name: selected, other: name }).then(() => select(name.trim()));
    };
    $("blend").onclick = () => change("blend", { name: selected, other: $("other").value, share: +$("share").value });
    $("add").onclick = () => { $("until").value = "edit"; change("add", { take, time: seconds }); };
    $("until").onchange = show;
    $("take").onchange = () => choose(+$("take").value);
    $("play").onclick = play;
    document.addEventListener("keydown", (event) => {
      if (event.key === "Escape" && placing) { place(null); return; }
      if (event.target.matches("input[type=number], select")) return;
      const key = event.key.toLowerCase();
      if ((event.ctrlKey || event.metaKey) && key === "z") {
        event.preventDefault();
        change(event.shiftKey ? "redo" : "undo");
      }
    });
  }

  async function watch() {
    // Another tab, or a hand in the file.
    for (;;) {
      await new Promise((done) => setTimeout(done, 2000));
      if (dragging || busy || document.hidden) continue;
      try {
        const found = await ask("state");
        if (found.revision !== state.revision) { take_in(found); say("changed elsewhere, read again"); }
      } catch (error) { say(error.message, true); }
    }
  }

  async function open() {
    [stage, state] = await Promise.all([ask("stage"), ask("state")]);
    $("file").firstChild.textContent = stage.file;
    $("file").title = stage.file;
    document.title = `${stage.character}, physretarget studio`;
    $("caption").textContent = stage.character;
    character = new physretarget.View($("character").querySelector("canvas"), stage.scene);
    character.handles(stage.handles);
    character.showHandles(false);
    hands($("character").querySelector("canvas"));
    joints();
    points();
    controls();
    $("gaze").hidden = !stage.face;
    $("limbs").hidden = !stage.limbs.length;
    $("take").replaceChildren(...stage.takes.map((each, k) => new Option(each.name, k)));
    for (const id of ["take", "play", "add", "until"]) $(id).disabled = !stage.takes.length;
    if (stage.takes.length) { scrub(); await choose(0); }
    say("saved");
    list();
    later();
    select(state.poses.length ? state.poses[0].name : null, true);
    document.documentElement.dataset.ready = "yes";
    watch();
  }
  open().catch((error) => say(error.message, true));
})();
