// One figure on its own stage, with a camera that one can turn and handles that one can drag.
"use strict";
(() => {
  const { Vector3, Mesh } = THREE;
  const BARE = { contacts: false, forces: false, trail: false, ghost: false };
  const NEAR = 16; // pixels within which a handle is meant

  class View {
    constructor(canvas, payload) {
      this.canvas = canvas;
      this.handle = [];
      this.renderer = physretarget.makeRenderer(canvas);
      if (!this.renderer) throw new Error("This browser has no WebGL; the studio needs it.");
      this.stage = new physretarget.Stage(payload, this.renderer);
      this.camera = new THREE.PerspectiveCamera(32, 1, 0.01, 100);
      this.camera.up.set(0, 0, 1);
      this.controls = new THREE.OrbitControls(this.camera, canvas);
      this.controls.addEventListener("change", () => this.draw());
      this.size = this.figure.height;
      this.bare();
      this.stage.world.theme(matchMedia("(prefers-color-scheme: dark)").matches);
      this.look(0, 0);
      new ResizeObserver(() => this.resize()).observe(canvas);
      this.resize();
    }

    get figure() { return this.stage.figures[0]; }

    look(x, y) {
      const s = this.size, at = new Vector3(x, y, 0.5 * s);
      const before = this.controls.target.clone();
      if (before.lengthSq() === 0) this.camera.position.set(x + 2.6 * s, y - 1.5 * s, 1.3 * s);
      else this.camera.position.add(at.clone().sub(before));
      this.controls.target.copy(at);
      this.stage.world.around(x, y, s);
      this.controls.update();
    }

    bare() { this.stage.update(0, BARE, false); }

    /** Another scene in the same place: a take instead of a pose. */
    show(payload) {
      this.stage = new physretarget.Stage(payload, this.renderer);
      this.stage.world.theme(matchMedia("(prefers-color-scheme: dark)").matches);
      this.bare();
      this.look(0, 0);
    }

    at(seconds) {
      this.stage.update(seconds, BARE, false);
      const com = this.figure.comAt(seconds, this.figure.smooth);
      this.look(com.x, com.y);
      this.draw();
    }

    /** Pose the figure's bodies as the server says. */
    pose(position, rotation) {
      this.figure.body.forEach((group, b) => {
        if (!b) return;
        group.position.fromArray(position, 3 * b);
        const [w, x, y, z] = rotation.slice(4 * b, 4 * b + 4);
        group.quaternion.set(x, y, z, w);
      });
      this.placeHandles();
      this.draw();
    }

    tint(bodies) {
      this.figure.body.forEach((group, b) => group.traverse((part) => {
        if (!part.material || !part.material.emissive) return;
        part.userData.calm ??= { color: part.material.emissive.clone(), much: part.material.emissiveIntensity };
        const hot = bodies.includes(b);
        part.material.emissive.set(hot ? 0xff2020 : part.userData.calm.color);
        part.material.emissiveIntensity = hot ? 0.7 : part.userData.calm.much;
      }));
    }

    // ---- handles -----------------------------------------------------------------------------
    handles(list) {
      const size = 0.014 * this.size;
      for (const h of this.handle) this.stage.world.scene.remove(h.dot);
      this.handle = list.map((data) => {
        const dot = new Mesh(new THREE.SphereGeometry(data.tie ? size : 0.75 * size, 16, 10),
          new THREE.MeshBasicMaterial({ color: data.tie ? 0x16c784 : 0x2e86de, depthTest: false,
            transparent: true, opacity: 0.75, toneMapped: false }));
        dot.renderOrder = 6;
        this.stage.world.scene.add(dot);
        return { ...data, dot };
      });
      this.placeHandles();
    }

    placeHandles() {
      for (const h of this.handle) {
        const body = this.figure.body[h.body];
        h.dot.position.set(...h.local).applyQuaternion(body.quaternion).add(body.position);
      }
    }

    showHandles(on) { for (const h of this.handle) h.dot.visible = on; this.draw(); }

    paintHandles(planted, active) {
      for (const h of this.handle) {
        const color = h === active ? 0xe4572e : !h.tie ? 0x2e86de : planted.includes(h.tie) ? 0x16c784 : 0x8a93a6;
        h.dot.material.color.set(color);
      }
    }

    pixel(place) {
      const p = place.clone().project(this.camera), r = this.canvas.getBoundingClientRect();
      return [r.left + (p.x + 1) / 2 * r.width, r.top + (1 - p.y) / 2 * r.height];
    }

    pick(x, y) {
      let best = null, least = NEAR;
      for (const h of this.handle) {
        if (!h.dot.visible) continue;
        const [u, v] = this.pixel(h.dot.position), away = Math.hypot(u - x, v - y);
        if (away < least) { least = away; best = h; }
      }
      return best;
    }

    /** The direction from the camera through a pixel. */
    ray(x, y) {
      const r = this.canvas.getBoundingClientRect();
      return new Vector3((x - r.left) / r.width * 2 - 1, 1 - (y - r.top) / r.height * 2, 0.5)
        .unproject(this.camera).sub(this.camera.position).normalize();
    }

    /** Where a pixel lies in the plane through a place that faces the camera. */
    under(x, y, place) {
      const ray = this.ray(x, y);
      const normal = this.camera.getWorldDirection(new Vector3());
      const far = place.clone().sub(this.camera.position).dot(normal) / ray.dot(normal);
      return this.camera.position.clone().addScaledVector(ray, far);
    }

    resize() {
      const { clientWidth: w, clientHeight: h } = this.canvas;
      if (!w || !h) return;
      this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
      this.renderer.setSize(w, h, false);
      this.camera.aspect = w / h;
      this.camera.fov = w < h ? 42 : 32;
      this.camera.updateProjectionMatrix();
      this.draw();
    }

    draw() {
      if (this.waiting) return;
      this.waiting = true;
      requestAnimationFrame(() => {
        this.waiting = false;
        this.renderer.render(this.stage.world.scene, this.camera);
      });
    }
  }

  physretarget.View = View;
})();
