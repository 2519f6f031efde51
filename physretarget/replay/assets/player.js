// The player: a stage, a camera and a time bar. physretarget.mount(element, data) -> Player.
"use strict";
(() => {
  const { Vector3 } = THREE;
  const ICONS = {
    play: "M7 4.5v15l13-7.5z", pause: "M6 4.5h4.2v15H6zM13.8 4.5H18v15h-4.2z",
    back: "M18 5v14l-9-7zM6 5h2.4v14H6z", next: "M6 5v14l9-7zM15.6 5H18v14h-2.4z",
    loop: "M7 7h9.5l-2-2L16 3.6 20.4 8 16 12.4l-1.5-1.4 2-2H9v3H7zM17 17H7.5l2 2L8 20.4 3.6 16 8 11.6l1.5 1.4-2 2H15v-3h2z",
    full: "M4 9V4h5v2H6v3zM15 4h5v5h-2V6h-3zM4 15h2v3h3v2H4zM18 15h2v5h-5v-2h3z",
    home: "M12 5a7 7 0 1 1-6.6 4.7l1.9.7A5 5 0 1 0 12 7v3L7.500 6 12 2z",
  };
  const SPEEDS = [0.1, 0.25, 0.5, 1, 2];
  const LAYOUTS = { split: "Side by side", stage: "One stage", overlay: "Overlaid" };
  const TOGGLES = [
    ["forces", "Forces", "Contact forces as arrows (F); beyond 2 body weights their length grows with the logarithm"],
    ["contacts", "Contacts", "Contact points, green while they stand (C)"],
    ["trail", "CoM trail", "Path of the centre of mass (T)"],
    ["ghost", "Ghost", "Where it was and will be (G)"],
    ["follow", "Follow", "The camera follows the motion (V)"],
  ];

  function el(tag, attributes = {}, ...children) {
    const node = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) {
      if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
      else if (value === true) node.setAttribute(name, "");
      else if (value !== false && value != null) node.setAttribute(name, value);
    }
    node.append(...children);
    return node;
  }
  function icon(name) {
    const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    svg.setAttribute("viewBox", "0 0 24 24");
    svg.setAttribute("aria-hidden", "true");
    const path = document.createElementNS("http://www.w3.org/2000/svg", "path");
    path.setAttribute("d", ICONS[name]);
    svg.append(path);
    return svg;
  }
  const css = (color) => "#" + color.toString(16).padStart(6, "0");

  class Player {
    constructor(root, data, options = {}) {
      this.root = root;
      this.data = data;
      this.listeners = { time: [], frame: [] };
      this.speed = 1;
      this.loop = options.loop ?? true;
      this.playing = false;
      this.shows = { forces: true, contacts: true, trail: false, ghost: false, follow: true,
        ...(options.shows || {}) };
      root.classList.add("pr-player");
      root.replaceChildren();
      this.canvas = el("canvas", { class: "pr-canvas", "aria-label": data.title });
      this.view = el("div", { class: "pr-view", tabindex: 0, role: "application",
        "aria-label": `3D replay of ${data.title}. Space plays, arrows step.` }, this.canvas);
      root.append(this.view);
      this.renderer = physretarget.makeRenderer(this.canvas);
      if (!this.renderer) {
        const times = data.time, end = times.start + (times.step || 0) * (times.frames - 1);
        this.clock = new physretarget.Clock([times.start, Math.max(end, times.start + 1e-3)]);
        this.view.append(el("p", { class: "pr-none" },
          "This browser offers no WebGL, so the 3D replay cannot be shown. " +
          "Everything else on this page works without it."));
        this.time = this.clock.start;
        return;
      }
      this.stage = new physretarget.Stage(data, this.renderer);
      this.clock = this.stage.clock;
      this.time = this.clock.start;
      this.layout = data.figures.length > 1 ? options.layout || data.layout : "stage";
      this.buildCamera();
      this.buildOverlay();
      this.buildBar();
      this.bindKeys(options.global);
      this.watch();
      const calm = matchMedia("(prefers-reduced-motion: reduce)").matches;
      if (options.autoplay && !calm && this.clock.duration > 0) this.play();
      this.dirty = true;
      this.tick = this.tick.bind(this);
      requestAnimationFrame(this.tick);
    }

    // ---- what other parts of a page use --------------------------------------------------------
    get frame() { return this.clock.frameAt(this.time); }
    on(event, listener) { this.listeners[event].push(listener); return this; }
    play() {
      if (!this.renderer) return;
      if (this.time >= this.clock.end - 1e-6) this.time = this.clock.start;
      this.playing = true;
      this.last = null;
      this.showPlaying();
    }
    pause() { this.playing = false; this.showPlaying(); }
    toggle() { this.playing ? this.pause() : this.play(); }
    seek(seconds) {
      this.time = Math.min(Math.max(seconds, this.clock.start), this.clock.end);
      this.dirty = true;
      this.announce();
    }
    seekFrame(frame) {
      this.pause();
      const index = Math.min(Math.max(Math.round(frame), 0), this.clock.frames - 1);
      this.seek(this.clock.time[index]);
    }
    announce() {
      const frame = this.frame;
      this.listeners.time.forEach((f) => f(this.time, frame));
      if (frame !== this.lastFrame) {
        this.lastFrame = frame;
        this.listeners.frame.forEach((f) => f(frame, this.time));
      }
      this.showTime();
    }

    // ---- camera ----------------------------------------------------------------------------------
    // The orbit lives in a space of its own: origin on the floor below the subject, unit = the
    // subject's size. Every view (one per figure when side by side) is that orbit, carried over.
    buildCamera() {
      this.orbit = new THREE.PerspectiveCamera(30, 1, 0.01, 100);
      this.orbit.up.set(0, 0, 1);
      this.lens = this.orbit.clone();
      this.controls = new THREE.OrbitControls(this.orbit, this.canvas);
      Object.assign(this.controls, { enableDamping: true, dampingFactor: 0.12,
        maxPolarAngle: 1.62, minDistance: 0.5, maxDistance: 25, zoomSpeed: 0.8 });
      this.controls.addEventListener("change", () => { this.dirty = true; });
      this.resetCamera();
    }
    resetCamera() {
      const far = 2.5;
      this.controls.target.set(0, 0, 0.47);
      this.orbit.position.set(0.74, -0.56, 0.33).multiplyScalar(far).add(this.controls.target);
      this.controls.update();
      this.dirty = true;
    }
    subject(figures, spread) {
      const shown = figures.length ? figures : this.stage.figures;
      const at = new Vector3(), height = Math.max(...shown.map((f) => f.height));
      let reach = height;
      const places = shown.map((f) => {
        const p = this.shows.follow ? f.comAt(this.time, f.smooth)
          : f.comAt((this.clock.start + this.clock.end) / 2, f.smooth);
        return spread ? p.add(f.offset) : p;
      });
      places.forEach((p) => at.add(p));
      at.multiplyScalar(1 / places.length);
      for (const p of places) reach = Math.max(reach, 0.5 * height + 0.85 * Math.hypot(p.x - at.x, p.y - at.y));
      if (!this.shows.follow) reach = Math.max(reach, ...shown.map((f) => 0.6 * f.extent()));
      // A wide group is looked at lower than a tall figure of that size would be.
      const low = 0.6 * (reach - height) + (places.length > 1 && spread ? 0.16 * height : 0);
      return { x: at.x, y: at.y, z: -low, size: reach, group: places.length > 1 && spread };
    }
    viewFrom(subject, aspect) {
      const lens = this.lens, need = subject.group ? 1.3 : 0.8, wide = Math.max(need / aspect, 1);
      lens.position.copy(this.orbit.position).sub(this.controls.target).multiplyScalar(wide)
        .add(this.controls.target).multiplyScalar(subject.size);
      lens.position.add(subject);
      const target = this.controls.target.clone().multiplyScalar(subject.size);
      target.add(subject);
      lens.near = 0.02 * subject.size; lens.far = 120 * subject.size;
      lens.aspect = aspect;
      lens.lookAt(target);
      lens.updateProjectionMatrix();
    }

    // ---- drawing ---------------------------------------------------------------------------------
    views(width, height) {
      const shown = this.stage.figures.map((f, i) => i).filter((i) => this.stage.figures[i].shown);
      if (this.layout !== "split" || shown.length < 2) return [{ box: [0, 0, width, height] }];
      const upright = width / height < 0.9, n = shown.length;
      return shown.map((index, k) => ({
        index,
        box: upright ? [0, (k * height) / n, width, height / n]
          : [(k * width) / n, 0, width / n, height],
      }));
    }
    draw() {
      const { stage, renderer } = this, width = this.view.clientWidth, height = this.view.clientHeight;
      if (!width || !height) return;
      const spread = this.layout === "stage";
      stage.update(this.time, this.shows, spread);
      const views = this.views(width, height);
      renderer.setScissorTest(true);
      for (const { box: [x, y, w, h], index } of views) {
        const alone = index !== undefined;
        if (alone) stage.solo(index);
        const subject = this.subject(
          alone ? [stage.figures[index]] : stage.figures.filter((f) => f.shown), spread);
        stage.world.around(subject.x, subject.y, subject.size);
        this.viewFrom(subject, w / h);
        renderer.setViewport(x, height - y - h, w, h);
        renderer.setScissor(x, height - y - h, w, h);
        renderer.render(stage.world.scene, this.lens);
        if (alone) this.placeTag(this.tags[index], x, y);
      }
      this.rule(views, width);
      if (views[0].index === undefined) this.tagsOverFigures(width, height, spread);
    }
    /** Thin rules between the views. */
    rule(views, width) {
      const key = views.map((v) => v.box.join()).join(";");
      if (key === this.ruled) return;
      this.ruled = key;
      this.rules.replaceChildren(...views.slice(1).map(({ box: [x, y, w, h] }) => el("div", {
        class: "pr-rule", style: x > 0 ? `left:${x}px;top:0;width:1px;height:${h}px`
          : `left:0;top:${y}px;width:${w}px;height:1px` })));
    }
    placeTag(tag, x, y) {
      tag.style.transform = `translate(${x + 14}px, ${y + 12}px)`;
      tag.classList.remove("pr-over");
    }
    tagsOverFigures(width, height, spread) {
      this.stage.figures.forEach((figure, i) => {
        const p = figure.comAt(this.time);
        if (spread) p.add(figure.offset);
        p.z += 0.58 * figure.height;
        p.project(this.lens);
        const tag = this.tags[i];
        tag.classList.add("pr-over");
        tag.style.transform = this.layout === "overlay"
          ? `translate(14px, ${12 + 30 * i}px)`
          : `translate(${((p.x + 1) / 2) * width}px, ${((1 - p.y) / 2) * height}px) translate(-50%, -100%)`;
      });
    }
    tick(now) {
      requestAnimationFrame(this.tick);
      if (this.playing) {
        const elapsed = this.last == null ? 0 : Math.min((now - this.last) / 1000, 0.1);
        this.last = now;
        this.time = this.clock.advance(this.time, elapsed, this);
        if (!this.loop && this.time >= this.clock.end) this.pause();
        this.dirty = true;
        this.announce();
      }
      this.controls.update();
      if (!this.dirty || !this.visible) return;
      this.dirty = false;
      this.draw();
    }

    // ---- labels over the picture -----------------------------------------------------------------
    buildOverlay() {
      this.tags = this.stage.figures.map((figure) => el("button", {
        class: `pr-tag${figure.shown ? "" : " pr-off"}`, type: "button", title: "Show or hide", style: `--c:${css(figure.accent)}`,
        "aria-pressed": String(figure.shown),
        onclick: () => this.showFigure(figure, !figure.shown),
      }, figure.name));
      const many = this.stage.figures.length > 1;
      const tags = el("div", { class: "pr-tags" }, ...(many ? this.tags : []));
      this.alerts = el("div", { class: "pr-alerts", "aria-live": "polite" });
      this.rules = el("div");
      this.view.append(this.rules, tags, this.alerts);
    }
    showFigure(figure, on) {
      const others = this.stage.figures.some((f) => f !== figure && f.shown);
      figure.shown = on || !others; // never an empty stage
      this.tags.forEach((tag, i) => {
        tag.setAttribute("aria-pressed", String(this.stage.figures[i].shown));
        tag.classList.toggle("pr-off", !this.stage.figures[i].shown);
      });
      for (const chip of this.chips || []) {
        chip.button.setAttribute("aria-pressed", String(chip.figure.shown));
      }
      this.dirty = true;
    }

    // ---- the bar ---------------------------------------------------------------------------------
    button(name, label, action, text) {
      return el("button", { class: "pr-button", type: "button", title: label, "aria-label": label,
        onclick: action }, text || icon(name));
    }
    buildBar() {
      this.playButton = this.button("play", "Play or pause (space)", () => this.toggle());
      this.playButton.classList.add("pr-main");
      this.loopButton = this.button("loop", "Loop (L)", () => this.setLoop(!this.loop));
      this.speedSelect = el("select", { class: "pr-select", title: "Speed (< and >)", "aria-label": "Speed",
        onchange: () => { this.speed = Number(this.speedSelect.value); } },
        ...SPEEDS.map((s) => el("option", { value: s, selected: s === 1 }, `${s}×`)));
      this.clockText = el("output", { class: "pr-clock" });
      const controls = el("div", { class: "pr-controls" },
        this.playButton,
        this.button("back", "Previous frame (left arrow)", () => this.seekFrame(this.frame - 1)),
        this.button("next", "Next frame (right arrow)", () => this.seekFrame(this.frame + 1)),
        this.loopButton, this.speedSelect, this.clockText,
        el("div", { class: "pr-options" }, ...this.layoutControl(), ...this.figureChips(),
          ...this.toggleButtons(),
          this.button("home", "Reset the camera (R)", () => this.resetCamera()),
          this.button("full", "Full screen", () => this.fullScreen())));
      this.root.append(this.buildTimeline(), controls);
      this.setLoop(this.loop);
      this.showPlaying();
      this.announce();
    }
    layoutControl() {
      if (this.stage.figures.length < 2) return [];
      this.layoutSelect = el("select", { class: "pr-select", title: "Arrangement", "aria-label": "Arrangement",
        onchange: () => { this.layout = this.layoutSelect.value; this.resetCamera(); } },
        ...Object.entries(LAYOUTS).map(([value, text]) =>
          el("option", { value, selected: value === this.layout }, text)));
      return [this.layoutSelect];
    }
    figureChips() {
      if (this.stage.figures.length < 2) return [];
      this.chips = this.stage.figures.map((figure) => ({ figure, button: el("button", {
        class: "pr-chip pr-figure", type: "button", title: `Show or hide ${figure.name}`,
        style: `--c:${css(figure.accent)}`, "aria-pressed": String(figure.shown),
        onclick: () => this.showFigure(figure, !figure.shown) }, figure.name) }));
      return this.chips.map((chip) => chip.button);
    }
    toggleButtons() {
      const able = {
        forces: this.stage.figures.some((f) => f.forces),
        contacts: this.stage.figures.some((f) => f.contacts),
      };
      this.toggles = {};
      return TOGGLES.filter(([name]) => able[name] !== false).map(([name, text, title]) => {
        this.toggles[name] = el("button", { class: "pr-chip", type: "button", title,
          "aria-pressed": String(this.shows[name]), onclick: () => this.show(name) }, text);
        return this.toggles[name];
      });
    }
    show(name) {
      if (!this.toggles[name]) return;
      this.shows[name] = !this.shows[name];
      this.toggles[name].setAttribute("aria-pressed", String(this.shows[name]));
      this.dirty = true;
    }
    setLoop(on) {
      this.loop = on;
      this.loopButton.setAttribute("aria-pressed", String(on));
    }
    showPlaying() {
      if (!this.playButton) return;
      this.playButton.replaceChildren(icon(this.playing ? "pause" : "play"));
      this.root.classList.toggle("pr-playing", this.playing);
    }
    fullScreen() {
      if (document.fullscreenElement) document.exitFullscreen();
      else if (this.root.requestFullscreen) this.root.requestFullscreen();
    }

    // ---- the time line ---------------------------------------------------------------------------
    buildTimeline() {
      this.fill = el("div", { class: "pr-fill" });
      this.knob = el("div", { class: "pr-knob" });
      const lanes = this.markLanes();
      this.track = el("div", { class: "pr-track", role: "slider", tabindex: 0, "aria-label": "Time",
        "aria-valuemin": this.clock.start.toFixed(2), "aria-valuemax": this.clock.end.toFixed(2) },
        el("div", { class: "pr-rail" }, this.fill), this.knob);
      const seekTo = (event) => {
        const box = this.track.getBoundingClientRect();
        const part = Math.min(Math.max((event.clientX - box.left) / box.width, 0), 1);
        this.seek(this.clock.start + part * this.clock.duration);
      };
      this.track.addEventListener("pointerdown", (event) => {
        this.resume = this.playing;
        this.pause();
        this.track.setPointerCapture(event.pointerId);
        seekTo(event);
      });
      this.track.addEventListener("pointermove", (event) => {
        if (this.track.hasPointerCapture(event.pointerId)) seekTo(event);
      });
      this.track.addEventListener("pointerup", () => { if (this.resume) this.play(); });
      return el("div", { class: "pr-timeline" }, lanes, this.track);
    }
    fraction(frame) {
      const index = Math.min(Math.max(frame, 0), this.clock.frames - 1);
      return this.clock.duration > 0 ? (this.clock.time[index] - this.clock.start) / this.clock.duration : 0;
    }
    markLanes() {
      const ends = [], lanes = el("div", { class: "pr-marks" });
      const order = { error: 0, warning: 1, info: 2 };
      const marks = [...this.data.marks].sort(
        (a, b) => order[a.severity] - order[b.severity] || a.first - b.first).slice(0, 400);
      for (const mark of marks) {
        const from = this.fraction(mark.first), to = this.fraction(mark.last + 1);
        let lane = ends.findIndex((spans) => spans.every(([a, b]) => to < a || from > b));
        if (lane < 0) lane = ends.length < 4 ? ends.push([]) - 1 : 3;
        ends[lane].push([from - 0.012, Math.max(to, from + 0.012)]);
        lanes.append(el("button", { class: `pr-mark pr-${mark.severity}`, type: "button",
          tabindex: -1, "aria-label": `${mark.code} at frame ${mark.first}: ${mark.message}`,
          title: `${mark.code} · frame ${mark.first}–${mark.last}\n${mark.message}`,
          style: `left:${100 * from}%;width:${100 * (to - from)}%;top:${lane * 8}px`,
          onclick: () => this.seekFrame(mark.look) }));
      }
      lanes.style.height = `${Math.min(ends.length, 4) * 8}px`;
      return lanes;
    }
    showTime() {
      if (!this.clockText) return;
      const part = this.clock.duration > 0 ? (this.time - this.clock.start) / this.clock.duration : 0;
      this.fill.style.width = this.knob.style.left = `${100 * part}%`;
      const frame = this.frame;
      this.clockText.textContent = `${this.time.toFixed(2)} s  ·  ${frame} / ${this.clock.frames - 1}`;
      this.track.setAttribute("aria-valuenow", this.time.toFixed(2));
      this.track.setAttribute("aria-valuetext", `${this.time.toFixed(2)} seconds, frame ${frame}`);
      if (frame !== this.alertFrame) this.showAlerts(frame);
    }
    showAlerts(frame) {
      this.alertFrame = frame;
      const now = this.data.marks.filter((m) => m.first <= frame && frame <= m.last);
      const key = now.map((m) => m.code + m.first).join();
      if (key === this.alertKey) return;
      this.alertKey = key;
      // The gravest with its words, the others as codes: the picture must stay visible.
      const order = { error: 0, warning: 1, info: 2 };
      now.sort((m, n) => order[m.severity] - order[n.severity] || m.last - m.first - n.last + n.first);
      const shown = now.slice(0, 5).map((m, i) => el("div", {
        class: `pr-alert pr-${m.severity}`, title: `${m.code} ${m.message}` },
        el("b", {}, m.code), i === 0 ? ` ${m.message}` : ""));
      if (now.length > 5) shown.push(el("div", { class: "pr-alert" }, `+${now.length - 5}`));
      this.alerts.replaceChildren(...shown);
    }

    // ---- keys, size, theme -----------------------------------------------------------------------
    bindKeys(global) {
      const actions = {
        " ": () => this.toggle(), ArrowLeft: (e) => this.step(e, -1), ArrowRight: (e) => this.step(e, 1),
        Home: () => this.seekFrame(0), End: () => this.seekFrame(this.clock.frames - 1),
        l: () => this.setLoop(!this.loop), r: () => this.resetCamera(), f: () => this.show("forces"),
        c: () => this.show("contacts"), t: () => this.show("trail"), g: () => this.show("ghost"),
        v: () => this.show("follow"), "<": () => this.setSpeed(-1), ">": () => this.setSpeed(1),
        ",": () => this.setSpeed(-1), ".": () => this.setSpeed(1),
      };
      (global ? document : this.root).addEventListener("keydown", (event) => {
        if (event.ctrlKey || event.metaKey || event.altKey) return;
        const inForm = event.target.closest && event.target.closest("button, select, input, a, summary");
        if (inForm && (event.key === " " || inForm.tagName === "SELECT")) return;
        const action = actions[event.key] || actions[event.key.toLowerCase()];
        if (!action) return;
        event.preventDefault();
        action(event);
      });
    }
    step(event, direction) { this.seekFrame(this.frame + direction * (event.shiftKey ? 10 : 1)); }
    setSpeed(direction) {
      const at = SPEEDS.indexOf(this.speed) + direction;
      this.speed = SPEEDS[Math.min(Math.max(at, 0), SPEEDS.length - 1)];
      this.speedSelect.value = String(this.speed);
    }
    watch() {
      const fit = () => {
        const width = this.view.clientWidth, height = this.view.clientHeight;
        if (!width || !height) return;
        this.renderer.setPixelRatio(Math.min(devicePixelRatio || 1, 2));
        this.renderer.setSize(width, height, false);
        this.orbit.aspect = width / height;
        this.orbit.updateProjectionMatrix();
        this.draw();
      };
      const dark = matchMedia("(prefers-color-scheme: dark)");
      const theme = () => { this.stage.world.theme(dark.matches); this.dirty = true; };
      dark.addEventListener("change", theme);
      theme();
      new ResizeObserver(() => requestAnimationFrame(fit)).observe(this.view);
      this.visible = true;
      new IntersectionObserver(([entry]) => {
        this.visible = entry.isIntersecting;
        this.dirty = true;
      }).observe(this.view);
    }
  }

  Object.assign(physretarget, { Player, mount: (root, data, options) => new Player(root, data, options) });
})();
