// From a scene's data (see physretarget/replay/payload.py) to three.js objects that can be posed.
"use strict";
(() => {
  const { Color, Group, Mesh, Vector3, Quaternion } = THREE;

  // ---- numbers -------------------------------------------------------------------------------
  function bytes(text) {
    const raw = atob(text), out = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; i++) out[i] = raw.charCodeAt(i);
    return out.buffer;
  }
  function unpack(packed) {
    if (packed.f32 !== undefined) return new Float32Array(bytes(packed.f32));
    if (packed.u8 !== undefined) return new Uint8Array(bytes(packed.u8));
    const steps = new Uint16Array(bytes(packed.u16)), columns = packed.low.length;
    const out = new Float32Array(steps.length);
    for (let i = 0; i < steps.length; i++) {
      const c = i % columns;
      out[i] = packed.low[c] + packed.span[c] * steps[i] / 65535;
    }
    return out;
  }
  function frameTimes(time) {
    const out = new Float64Array(time.frames), all = time.all ? unpack(time.all) : null;
    for (let i = 0; i < out.length; i++) out[i] = time.start + (all ? all[i] : time.step * i);
    return out;
  }

  // ---- geometry ------------------------------------------------------------------------------
  function meshGeometry(mesh) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(unpack(mesh.vertices), 3));
    const faces = mesh.faces.u32 !== undefined
      ? new Uint32Array(bytes(mesh.faces.u32)) : new Uint16Array(bytes(mesh.faces.u16));
    geometry.setIndex(new THREE.BufferAttribute(faces, 1));
    return THREE.toCreasedNormals(geometry, 0.7); // edges sharper than 40 degrees stay edges
  }
  function shapeGeometry(shape, meshes) {
    const [a, b, c] = shape.size;
    switch (shape.kind) {
      case "mesh": return meshes[shape.mesh];
      case "box":
        return new THREE.RoundedBoxGeometry(2 * a, 2 * b, 2 * c, 3, 0.16 * Math.min(a, b, c));
      case "sphere": return new THREE.SphereGeometry(a, 40, 24);
      case "ellipsoid": return new THREE.SphereGeometry(1, 40, 24).scale(a, b, c);
      case "capsule": return new THREE.CapsuleGeometry(a, 2 * b, 12, 32).rotateX(Math.PI / 2);
      default: return new THREE.CylinderGeometry(a, a, 2 * b, 48).rotateX(Math.PI / 2);
    }
  }

  const NEUTRAL = [0.78, 0.8, 0.84];
  function material(shape, figure, tint) {
    const painted = figure.repaint || !shape.declared;
    const rgb = painted && tint ? tint : shape.declared ? shape.rgba.slice(0, 3) : NEUTRAL;
    const color = new Color().setRGB(rgb[0], rgb[1], rgb[2], THREE.SRGBColorSpace);
    const opacity = figure.opacity * shape.rgba[3];
    const glow = Math.min(shape.emission, 1);
    return new THREE.MeshStandardMaterial({
      color, metalness: 0.04, roughness: 0.72 - 0.4 * shape.gloss,
      emissive: color, emissiveIntensity: glow >= 0.9 ? 2.2 : 0.55 * glow,
      side: shape.kind === "mesh" ? THREE.DoubleSide : THREE.FrontSide,
      transparent: opacity < 0.999, opacity, depthWrite: opacity > 0.5,
      // A ghost in the very place of a solid figure stays behind it instead of mottling it.
      polygonOffset: opacity < 0.999, polygonOffsetFactor: 1, polygonOffsetUnits: 1,
    });
  }

  // ---- one figure ----------------------------------------------------------------------------
  class Figure {
    constructor(data, meshes, sampleTimes, accent) {
      this.data = data;
      this.name = data.name;
      this.height = data.height;
      this.accent = accent;
      this.offset = new Vector3(...data.offset);
      this.clock = new physretarget.Clock(sampleTimes);
      this.bodies = data.position.shape[1];
      this.position = unpack(data.position);
      this.rotation = unpack(data.rotation);
      this.com = unpack(data.com);
      this.group = new Group();
      this.body = this.build(meshes, data);
      this.group.add(...this.body);
      this.addLights();
      this.smooth = this.smoothed(0.6);
      this.shown = !data.hidden;
      this.forces = data.forces && {
        label: data.forces.label, origin: unpack(data.forces.origin),
        vector: unpack(data.forces.vector), count: data.forces.origin.shape[1],
      };
      this.contacts = data.contacts && {
        ...data.contacts,
        active: data.contacts.active ? unpack(data.contacts.active) : null,
      };
    }

    build(meshes, look) {
      const groups = Array.from({ length: this.bodies }, () => new Group());
      for (const shape of this.data.shapes) {
        const mesh = new Mesh(shapeGeometry(shape, meshes), material(shape, look, look.tint));
        mesh.position.set(...shape.position);
        const [w, x, y, z] = shape.rotation;
        mesh.quaternion.set(x, y, z, w);
        mesh.castShadow = look.opacity > 0.6 && shape.emission < 0.9;
        mesh.receiveShadow = mesh.castShadow;
        groups[shape.body].add(mesh);
      }
      return groups;
    }

    addLights() {
      for (const light of this.data.lights) {
        const spot = new THREE.SpotLight(new Color(...light.color), 0.6 * this.height, 0, 0.9, 0.7);
        spot.position.set(...light.position);
        spot.target.position.copy(spot.position).add(new Vector3(...light.direction));
        this.body[light.body].add(spot, spot.target);
      }
      if (this.data.lights.length || this.data.opacity < 0.9) return;
      for (const shape of this.data.shapes.filter((s) => s.emission >= 0.9).slice(0, 2)) {
        const color = new Color().setRGB(...shape.rgba.slice(0, 3), THREE.SRGBColorSpace);
        const bulb = new THREE.PointLight(color, 0.5 * this.height ** 2, 6 * this.height);
        bulb.position.set(...shape.position);
        this.body[shape.body].add(bulb);
      }
    }

    /** Pose the given body groups (the figure's own by default) at a time. */
    pose(seconds, groups = this.body) {
      const [k, w] = this.clock.between(seconds);
      const next = Math.min(k + 1, this.clock.frames - 1), n = this.bodies;
      for (let b = 1; b < n; b++) {
        const p = 3 * (k * n + b), q = 3 * (next * n + b), P = this.position, R = this.rotation;
        groups[b].position.set(
          P[p] + w * (P[q] - P[p]), P[p + 1] + w * (P[q + 1] - P[p + 1]),
          P[p + 2] + w * (P[q + 2] - P[p + 2]));
        const r = 4 * (k * n + b), s = 4 * (next * n + b);
        groups[b].quaternion.set(
          R[r + 1] + w * (R[s + 1] - R[r + 1]), R[r + 2] + w * (R[s + 2] - R[r + 2]),
          R[r + 3] + w * (R[s + 3] - R[r + 3]), R[r] + w * (R[s] - R[r])).normalize();
      }
    }

    comAt(seconds, track = this.com, out = new Vector3()) {
      const [k, w] = this.clock.between(seconds);
      const next = Math.min(k + 1, this.clock.frames - 1);
      return out.set(...[0, 1, 2].map(
        (c) => track[3 * k + c] + w * (track[3 * next + c] - track[3 * k + c])));
    }

    /** The path of the centre of mass averaged over +-seconds: what a calm camera follows. */
    smoothed(seconds) {
      const frames = this.clock.frames, out = new Float32Array(this.com.length);
      const rate = this.clock.duration > 0 ? (frames - 1) / this.clock.duration : 1;
      const reach = Math.max(1, Math.round(seconds * rate));
      for (let c = 0; c < 3; c++) {
        const sum = new Float64Array(frames + 1);
        for (let k = 0; k < frames; k++) sum[k + 1] = sum[k] + this.com[3 * k + c];
        for (let k = 0; k < frames; k++) {
          const half = Math.min(reach, k, frames - 1 - k); // symmetric, so the ends do not drift
          out[3 * k + c] = (sum[k + half + 1] - sum[k - half]) / (2 * half + 1);
        }
      }
      return out;
    }

    /** Horizontal extent of the path, m. */
    extent() {
      let reach = 0;
      for (const c of [0, 1]) {
        let low = Infinity, high = -Infinity;
        for (let k = c; k < this.com.length; k += 3) {
          low = Math.min(low, this.com[k]); high = Math.max(high, this.com[k]);
        }
        reach = Math.max(reach, high - low);
      }
      return reach;
    }
  }

  /** Landings reach ten body weights and more: beyond two, an arrow grows with the logarithm. */
  const drawnWeights = (bw) => (bw <= 2 ? bw : 2 + Math.log(bw / 2));

  // ---- things drawn over a figure: contacts, forces, trail, ghosts ---------------------------
  class Overlay {
    constructor(figure, meshes) {
      this.figure = figure;
      this.meshes = meshes;
      this.group = new Group();
      this.dots = this.makeDots();
      this.arrows = this.makeArrows();
      this.trail = this.makeTrail();
      this.ghosts = null;
    }

    makeDots() {
      const contacts = this.figure.contacts;
      if (!contacts) return [];
      const size = 0.013 * this.figure.height;
      return contacts.names.map(() => {
        const dot = new Mesh(new THREE.SphereGeometry(size, 20, 12), new THREE.MeshBasicMaterial(
          { depthTest: false, transparent: true, toneMapped: false }));
        dot.renderOrder = 5;
        this.group.add(dot);
        return dot;
      });
    }

    makeArrows() {
      const forces = this.figure.forces;
      if (!forces) return [];
      const r = 0.011 * this.figure.height;
      const paint = new THREE.MeshStandardMaterial(
        { color: 0x12b5a5, emissive: 0x12b5a5, emissiveIntensity: 0.45, roughness: 0.5 });
      return Array.from({ length: forces.count }, () => {
        const arrow = new Group();
        arrow.shaft = new Mesh(new THREE.CylinderGeometry(r, r, 1, 20).translate(0, 0.5, 0), paint);
        arrow.head = new Mesh(new THREE.ConeGeometry(2.6 * r, 6 * r, 24).translate(0, 3 * r, 0), paint);
        arrow.headLength = 6 * r;
        arrow.add(arrow.shaft, arrow.head);
        this.group.add(arrow);
        return arrow;
      });
    }

    makeTrail() {
      const geometry = new THREE.BufferGeometry();
      geometry.setAttribute("position", new THREE.BufferAttribute(this.figure.com, 3));
      const line = new THREE.Line(geometry, new THREE.LineBasicMaterial(
        { color: this.figure.accent, transparent: true, opacity: 0.9, depthTest: false }));
      line.frustumCulled = false;
      line.renderOrder = 4;
      this.head = new Mesh(new THREE.SphereGeometry(0.02 * this.figure.height, 20, 12),
        new THREE.MeshBasicMaterial({ color: this.figure.accent, depthTest: false, transparent: true }));
      this.head.renderOrder = 5;
      this.group.add(line, this.head);
      return line;
    }

    makeGhosts() {
      const look = { ...this.figure.data, opacity: 0.2, repaint: true, tint: [0.55, 0.62, 0.75] };
      return [-0.5, -0.25, 0.25].map((lag) => {
        const groups = this.figure.build(this.meshes, look);
        this.group.add(...groups);
        return { lag, groups };
      });
    }

    update(seconds, shows) {
      const { figure } = this, [k] = figure.clock.between(seconds);
      this.updateDots(k, shows.contacts);
      this.updateArrows(k, shows.forces);
      this.trail.visible = this.head.visible = shows.trail;
      if (shows.trail) {
        const from = figure.clock.frameAt(seconds - 1.5), to = k;
        this.trail.geometry.setDrawRange(from, to - from + 1);
        figure.comAt(seconds, figure.com, this.head.position);
      }
      if (shows.ghost && !this.ghosts) this.ghosts = this.makeGhosts();
      for (const ghost of this.ghosts || []) {
        const when = seconds + ghost.lag;
        const on = shows.ghost && when >= figure.clock.start && when <= figure.clock.end;
        ghost.groups.forEach((g) => { g.visible = on; });
        if (on) figure.pose(when, ghost.groups);
      }
    }

    updateDots(k, on) {
      const contacts = this.figure.contacts;
      this.dots.forEach((dot, i) => {
        dot.visible = on;
        if (!on) return;
        const body = this.figure.body[contacts.body[i]];
        dot.position.set(...contacts.local[i]).applyQuaternion(body.quaternion).add(body.position);
        const stands = contacts.active && contacts.active[k * contacts.names.length + i];
        dot.material.color.set(stands ? 0x16c784 : 0x8a93a6);
        dot.material.opacity = stands ? 1 : 0.45;
        dot.scale.setScalar(stands ? 1 : 0.7);
      });
    }

    updateArrows(k, on) {
      const forces = this.figure.forces, up = new Vector3(0, 1, 0);
      this.arrows.forEach((arrow, i) => {
        const at = 3 * (k * forces.count + i);
        const pull = new Vector3(...forces.vector.subarray(at, at + 3));
        const size = pull.length();
        arrow.visible = on && size > 0.01;
        if (!arrow.visible) return;
        const length = 0.45 * this.figure.height * drawnWeights(size); // one BW: 0.45 of the height
        arrow.position.set(...forces.origin.subarray(at, at + 3));
        arrow.quaternion.setFromUnitVectors(up, pull.normalize());
        arrow.shaft.scale.y = Math.max(length - arrow.headLength, 1e-4);
        arrow.head.position.y = Math.max(length - arrow.headLength, 0);
        arrow.head.scale.setScalar(Math.min(1, length / arrow.headLength));
      });
    }
  }

  // ---- the world: lights and floor -----------------------------------------------------------
  const FLOOR_VERTEX = `
    varying vec3 world;
    void main() {
      vec4 w = modelMatrix * vec4(position, 1.0);
      world = w.xyz;
      gl_Position = projectionMatrix * viewMatrix * w;
    }`;
  const FLOOR_FRAGMENT = `
    varying vec3 world;
    uniform vec2 centre; uniform float reach; uniform vec3 ink; uniform float strength;
    uniform float fine;
    float lines(vec2 p, float step, float width) {
      vec2 g = p / step, w = fwidth(g) * width;
      vec2 d = abs(fract(g - 0.5) - 0.5);
      vec2 on = 1.0 - smoothstep(w * 0.5, w * 1.5, d);
      on *= clamp(0.35 / max(w, vec2(1e-4)), 0.0, 1.0); // far lines melt instead of shimmering
      return max(on.x, on.y);
    }
    void main() {
      float away = length(world.xy - centre) / reach;
      float fade = pow(clamp(1.0 - away, 0.0, 1.0), 1.6);
      float metre = lines(world.xy, 1.0, 0.9), part = lines(world.xy, fine, 0.6);
      float a = max(metre * 0.45, part * 0.15) * strength * fade;
      gl_FragColor = vec4(ink, a);
    }`;

  class World {
    constructor(renderer) {
      this.scene = new THREE.Scene();
      const pmrem = new THREE.PMREMGenerator(renderer);
      this.scene.environment = pmrem.fromScene(new THREE.RoomEnvironment(), 0.04).texture;
      this.scene.environmentIntensity = 0.42;
      pmrem.dispose();
      this.sky = new THREE.HemisphereLight(0xffffff, 0xb9a791, 0.75);
      this.sky.position.set(0, 0, 1);
      this.key = new THREE.DirectionalLight(0xfff2e0, 2.3);
      this.key.castShadow = true;
      this.key.shadow.mapSize.set(2048, 2048);
      this.key.shadow.radius = 5;
      this.key.shadow.intensity = 0.85;
      this.rim = new THREE.DirectionalLight(0xbcd4ff, 1.1);
      this.shade = new Mesh(new THREE.CircleGeometry(1, 64),
        new THREE.ShadowMaterial({ opacity: 0.3, transparent: true, depthWrite: false }));
      this.shade.receiveShadow = true;
      this.shade.renderOrder = -2;
      this.grid = new Mesh(new THREE.CircleGeometry(1, 64), new THREE.ShaderMaterial({
        vertexShader: FLOOR_VERTEX, fragmentShader: FLOOR_FRAGMENT,
        transparent: true, depthWrite: false,
        uniforms: {
          centre: { value: new THREE.Vector2() }, reach: { value: 1 }, fine: { value: 0.1 },
          ink: { value: new Color(0x56607a) }, strength: { value: 1 },
        },
      }));
      this.grid.renderOrder = -1;
      this.scene.add(this.sky, this.key, this.key.target, this.rim, this.rim.target,
        this.shade, this.grid);
    }

    theme(dark) {
      this.grid.material.uniforms.ink.value.set(dark ? 0xa9b8d6 : 0x5b6478);
      this.grid.material.uniforms.strength.value = dark ? 0.75 : 1;
      this.shade.material.opacity = dark ? 0.55 : 0.3;
      this.sky.intensity = dark ? 0.5 : 0.75;
      this.scene.environmentIntensity = dark ? 0.34 : 0.42;
    }

    /** Gather lights and floor round a place, for a subject of a size (m). */
    around(x, y, size) {
      this.key.target.position.set(x, y, 0.3 * size);
      this.key.position.set(x + 1.5 * size, y + 1.1 * size, 3.1 * size);
      this.rim.target.position.copy(this.key.target.position);
      this.rim.position.set(x - 2 * size, y - 1.6 * size, 1.4 * size);
      const camera = this.key.shadow.camera, reach = 1.7 * size;
      if (Math.abs(camera.right - reach) > 1e-6) {
        Object.assign(camera, { left: -reach, right: reach, top: reach, bottom: -reach,
          near: 0.2 * size, far: 7 * size });
        camera.updateProjectionMatrix();
        this.key.shadow.normalBias = 0.004 * size;
      }
      const floor = 9 * size;
      for (const plane of [this.shade, this.grid]) {
        plane.position.set(x, y, 0);
        plane.scale.set(floor, floor, 1);
      }
      const uniforms = this.grid.material.uniforms;
      uniforms.centre.value.set(x, y);
      uniforms.reach.value = floor;
      uniforms.fine.value = size < 1.3 ? 0.1 : 0.25;
    }
  }

  // ---- everything together -------------------------------------------------------------------
  const ACCENTS = [0xe4572e, 0x2e86de, 0x8e5bd0, 0x1aa179, 0xd99a00, 0xc2377e];

  class Stage {
    constructor(data, renderer) {
      this.data = data;
      this.times = frameTimes(data.time);
      this.clock = new physretarget.Clock(this.times);
      const keep = data.keep ? unpack(data.keep) : null;
      const samples = keep ? Float64Array.from(keep, (f) => this.times[f]) : this.times;
      this.world = new World(renderer);
      const meshes = data.meshes.map(meshGeometry);
      this.figures = data.figures.map(
        (f, i) => new Figure(f, meshes, samples, ACCENTS[i % ACCENTS.length]));
      this.overlays = this.figures.map((f) => new Overlay(f, meshes));
      this.figures.forEach((f, i) => this.world.scene.add(f.group, this.overlays[i].group));
      this.world.grid.visible = data.floor;
    }

    /** Move everything to a time; `spread` puts figures at their own places. */
    update(seconds, shows, spread) {
      this.figures.forEach((figure, i) => {
        figure.group.visible = this.overlays[i].group.visible = figure.shown;
        const place = spread ? figure.offset : new Vector3();
        figure.group.position.copy(place);
        this.overlays[i].group.position.copy(place);
        if (!figure.shown) return;
        figure.pose(seconds);
        this.overlays[i].update(seconds, shows);
      });
    }

    /** Show one figure alone (split views, film strips). */
    solo(index) {
      this.figures.forEach((figure, i) => {
        figure.group.visible = this.overlays[i].group.visible = i === index;
      });
    }
  }

  /** A renderer with the house's look, or null where the browser has no WebGL. */
  function makeRenderer(canvas) {
    try {
      const renderer = new THREE.WebGLRenderer(
        { canvas, alpha: true, antialias: true, preserveDrawingBuffer: true });
      renderer.toneMapping = THREE.NeutralToneMapping;
      renderer.toneMappingExposure = 0.95;
      renderer.shadowMap.enabled = true;
      renderer.shadowMap.type = THREE.PCFShadowMap;
      renderer.setClearColor(0, 0);
      return renderer;
    } catch (error) {
      return null;
    }
  }

  Object.assign(physretarget, { Stage, makeRenderer, unpack, frameTimes });
})();
