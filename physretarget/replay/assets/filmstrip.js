// Small pictures of figures at a few times: rows are figures, columns are times.
"use strict";
(() => {
  /**
   * @param root element to fill
   * @param data the scene's data
   * @param options rows: [{figure, label, note, still}], times: [s], onpick(time)
   */
  physretarget.filmstrip = function filmstrip(root, data, { rows, times, onpick }) {
    const size = { width: 190, height: 176 }, ratio = Math.min(devicePixelRatio || 1, 2);
    const table = document.createElement("div");
    table.className = "fs-table";
    table.style.setProperty("--columns", times.length);
    const cells = [];
    table.append(cellOf("fs-corner", ""));
    times.forEach((time) => table.append(cellOf("fs-time", `${time.toFixed(2)} s`)));
    rows.forEach((row) => {
      const head = cellOf("fs-label", row.label);
      if (row.note) head.append(Object.assign(document.createElement("small"), { textContent: row.note }));
      table.append(head);
      times.forEach((time, column) => {
        const cell = document.createElement("button");
        cell.type = "button";
        cell.className = "fs-cell";
        cell.title = `${row.label} at ${time.toFixed(2)} s`;
        const canvas = document.createElement("canvas");
        canvas.width = size.width * ratio;
        canvas.height = size.height * ratio;
        canvas.setAttribute("aria-label", cell.title);
        if (row.still) { // painted beforehand, seen until the canvas is drawn over it
          cell.style.background = `url(${row.still}) ${(100 * column) / Math.max(times.length - 1, 1)}% 0 / ${100 * times.length}% 100%`;
        }
        cell.append(canvas);
        cell.addEventListener("click", () => onpick && onpick(time));
        table.append(cell);
        cells.push({ row, time, canvas });
      });
    });
    root.replaceChildren(table);

    const sheet = document.createElement("canvas");
    const renderer = physretarget.makeRenderer(sheet);
    if (!renderer) {
      // What was painted beforehand stays; without it there is nothing to see.
      if (!rows.some((row) => row.still)) {
        root.textContent = "This browser offers no WebGL, so the film strip cannot be drawn.";
      }
      return;
    }
    const stage = new physretarget.Stage(data, renderer);
    const camera = new THREE.PerspectiveCamera(28, 1, 0.01, 100);
    camera.up.set(0, 0, 1);
    const dark = matchMedia("(prefers-color-scheme: dark)");
    stage.world.theme(dark.matches);
    renderer.setPixelRatio(ratio);
    renderer.setSize(size.width, size.height, false);
    const shows = { forces: false, contacts: false, trail: false, ghost: false };

    function cellOf(name, text) {
      return Object.assign(document.createElement("div"), { className: name, textContent: text });
    }
    /** How far the centre of mass is above its mean: jumps stay in the picture. */
    function rise(figure, time) {
      let sum = 0;
      for (let k = 2; k < figure.com.length; k += 3) sum += figure.com[k];
      return figure.comAt(time).z - sum / (figure.com.length / 3);
    }
    function draw({ row, time, canvas }) {
      const figure = stage.figures[row.figure];
      figure.shown = true;
      stage.update(time, shows, false);
      stage.solo(row.figure);
      const at = figure.comAt(time, figure.smooth), s = figure.height;
      stage.world.around(at.x, at.y, s);
      const up = rise(figure, time), back = s + 0.7 * Math.max(up, 0);
      camera.position.set(at.x + 1.95 * back, at.y - 1.45 * back, 1.05 * back);
      camera.near = 0.02 * s; camera.far = 100 * s;
      camera.aspect = size.width / size.height;
      camera.lookAt(at.x, at.y, 0.49 * s + 0.6 * up);
      camera.updateProjectionMatrix();
      renderer.render(stage.world.scene, camera);
      const pen = canvas.getContext("2d");
      pen.clearRect(0, 0, canvas.width, canvas.height);
      pen.drawImage(sheet, 0, 0);
      canvas.parentElement.style.background = ""; // the still has done its work
    }
    let next = 0;
    function some() {
      for (let i = 0; i < times.length && next < cells.length; i++) draw(cells[next++]);
      if (next < cells.length) requestAnimationFrame(some);
      else { renderer.dispose(); renderer.forceContextLoss(); } // pictures stay, the GPU is freed
    }
    // Drawn only when about to be seen: a report may be long.
    const watch = new IntersectionObserver(([entry]) => {
      if (!entry.isIntersecting) return;
      watch.disconnect();
      requestAnimationFrame(some);
    }, { rootMargin: "600px" });
    watch.observe(root);
    window.addEventListener("beforeprint", () => { while (next < cells.length) draw(cells[next++]); });
  };
})();
