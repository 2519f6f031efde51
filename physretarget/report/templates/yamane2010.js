// The reproduction's page: one replay that changes its performance, and film strips.
"use strict";
(() => {
  const data = JSON.parse(document.getElementById("page-data").textContent);
  const root = document.getElementById("player");
  const buttons = [...document.querySelectorAll("[data-hero]")];
  let player = null;

  /** A fresh element for each performance: the old one's picture and loop end with it. */
  function show(index) {
    const frame = document.createElement("div");
    frame.className = "frame";
    if (player) {
      player.pause();
      if (player.renderer) { player.renderer.dispose(); player.renderer.forceContextLoss(); }
    }
    root.replaceChildren(frame);
    player = physretarget.mount(frame, data.heroes[index], { autoplay: false });
    globalThis.player = player;
    buttons.forEach((b, k) => b.setAttribute("aria-pressed", k === index ? "true" : "false"));
  }
  buttons.forEach((button, k) => button.addEventListener("click", () => show(k)));
  show(0);

  function draw(place) {
    const { scene, rows } = data.strips[Number(place.dataset.strip)];
    const times = Array.from(physretarget.frameTimes(scene.time));
    physretarget.filmstrip(place, scene, { rows, times });
    place.querySelectorAll(".fs-cell").forEach((cell) => { cell.disabled = true; });
    if (place.dataset.numbered === undefined) return;
    // Takes differ in length: the columns are parts of each, not seconds.
    const name = (k) => `${Math.round((100 * (k + 0.5)) / times.length)} %`;
    place.querySelectorAll(".fs-time").forEach((head, k) => { head.textContent = name(k); });
    place.querySelectorAll(".fs-cell").forEach((cell, i) => {
      cell.title = `${rows[Math.floor(i / times.length)].label} at ${name(i % times.length)}`;
      cell.firstChild.setAttribute("aria-label", cell.title);
    });
  }
  // A browser keeps some sixteen WebGL pictures at once: a strip starts as it comes into sight.
  const watch = new IntersectionObserver((entries) => entries.forEach((entry) => {
    if (!entry.isIntersecting) return;
    watch.unobserve(entry.target);
    draw(entry.target);
  }), { rootMargin: "300px" });
  document.querySelectorAll("[data-strip]").forEach((place) => watch.observe(place));
})();
