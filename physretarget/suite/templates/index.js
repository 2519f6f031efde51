// The list of clips: search, filter, sort; what is shown stands in the address, to be shared.
"use strict";
(() => {
  const { rows, verdicts } = JSON.parse(document.getElementById("page-data").textContent);
  const [VERDICT, CLIP, PAGE, CASE, OWNER, TAGS, ERRORS, WARNINGS, REASON, BLOCKING, MEASURES] = Array(11).keys();
  const STEP = 150; // rows put into the page at a time
  const rank = Object.fromEntries(verdicts.map((v, i) => [v, i]));
  const texts = rows.map((r) => [r[CLIP], r[OWNER], r[TAGS].join(" "), r[REASON], r[VERDICT]].join(" ").toLowerCase());
  const byId = (id) => document.getElementById(id);
  const body = byId("rows"), fields = ["search", "case", "owner", "tag", "state"];
  const chips = [...document.querySelectorAll("[data-verdict]")];
  const heads = [...document.querySelectorAll("th[data-sort]")];
  let sort = "0", down = false, found = [], drawn = 0;

  const value = (row, key) => {
    if (key === "0") return (row[BLOCKING] ? 0 : 10) + rank[row[VERDICT]];
    if (key[0] === "m") return row[MEASURES][Number(key.slice(1))];
    return row[Number(key)];
  };
  function compare(a, b) {
    const x = value(rows[a], sort), y = value(rows[b], sort);
    if (x == null || y == null) return (x == null) - (y == null) || a - b; // unknown always last
    const order = typeof x === "string" ? x.localeCompare(y, undefined, { numeric: true }) : x - y;
    return (down ? -order : order) || a - b;
  }
  const pressed = () => chips.filter((c) => c.getAttribute("aria-pressed") === "true").map((c) => c.dataset.verdict);

  function choose() {
    const words = byId("search").value.toLowerCase().split(/\s+/).filter(Boolean);
    const [, inCase, owner, tag, state] = fields.map((id) => byId(id).value);
    const wanted = new Set(pressed());
    found = [...rows.keys()].filter((i) => {
      const row = rows[i];
      return (!wanted.size || wanted.has(row[VERDICT])) && (!inCase || row[CASE] === inCase)
        && (!owner || row[OWNER] === owner) && (!tag || row[TAGS].includes(tag))
        && (!state || (state === "pass" ? row[ERRORS] === 0 : row[ERRORS] !== 0))
        && words.every((word) => texts[i].includes(word));
    });
    found.sort(compare);
    body.replaceChildren();
    drawn = 0;
    draw();
    byId("shown").textContent = found.length === rows.length ? `all ${rows.length} clips` : `${found.length} of ${rows.length} clips`;
    byId("none").hidden = found.length > 0;
    remember();
  }
  function el(tag, attributes, ...children) {
    const node = document.createElement(tag);
    for (const [name, text] of Object.entries(attributes)) node.setAttribute(name, text);
    node.append(...children);
    return node;
  }
  const short = (v) => v == null ? "–" : v === 0 ? "0" : Math.abs(v) >= 0.01 ? String(+v.toPrecision(3)) : v.toExponential(1);
  function rowOf(row) {
    const name = row[CLIP].slice(row[CLIP].indexOf("/") + 1);
    const about = [row[CASE], ...row[TAGS]].join(" · ");
    return el("tr", { class: row[VERDICT] },
      el("td", {}, el("span", { class: `chip ${row[VERDICT]}` }, row[VERDICT])),
      el("td", { class: "name" }, el("a", { href: row[PAGE] }, name), el("small", {}, about),
        ...(row[VERDICT] === "same" ? [] : [el("small", { class: "why" }, row[REASON])])),
      el("td", { "data-label": "owner" }, row[OWNER]),
      el("td", { class: "num", "data-label": "errors" }, row[ERRORS] == null ? "–" : String(row[ERRORS])),
      el("td", { class: "num", "data-label": "warnings" }, row[WARNINGS] == null ? "–" : String(row[WARNINGS])),
      ...row[MEASURES].map((v, i) => el("td", { class: "num", "data-label": heads[5 + i].textContent.trim() }, short(v))));
  }
  function draw() {
    const part = found.slice(drawn, drawn + STEP);
    body.append(...part.map((i) => rowOf(rows[i])));
    drawn += part.length;
  }

  // ---- the address ---------------------------------------------------------------------------
  function remember() {
    const state = new URLSearchParams();
    for (const id of fields) if (byId(id).value) state.set(id, byId(id).value);
    if (pressed().length) state.set("verdict", pressed().join(","));
    if (sort !== "0" || down) state.set("sort", (down ? "-" : "") + sort);
    const text = state.toString();
    history.replaceState(null, "", text ? `#${text}` : location.pathname + location.search);
  }
  function recall() {
    const state = new URLSearchParams(location.hash.slice(1));
    for (const id of fields) byId(id).value = state.get(id) || "";
    const wanted = (state.get("verdict") || "").split(",");
    for (const chip of chips) chip.setAttribute("aria-pressed", String(wanted.includes(chip.dataset.verdict)));
    const told = state.get("sort") || "0";
    [sort, down] = [told.replace(/^-/, ""), told[0] === "-"];
    showSort();
    choose();
  }
  function showSort() {
    for (const head of heads) {
      if (head.dataset.sort === sort) head.setAttribute("aria-sort", down ? "descending" : "ascending");
      else head.removeAttribute("aria-sort");
    }
  }

  for (const id of fields) byId(id).addEventListener("input", choose);
  for (const chip of chips) {
    chip.addEventListener("click", () => {
      chip.setAttribute("aria-pressed", String(chip.getAttribute("aria-pressed") !== "true"));
      choose();
    });
  }
  for (const head of heads) {
    head.addEventListener("click", () => {
      // Numbers are asked for to see the largest, words to read them in order.
      const numeric = head.classList.contains("num");
      [sort, down] = sort === head.dataset.sort ? [sort, !down] : [head.dataset.sort, numeric];
      showSort();
      choose();
    });
  }
  new IntersectionObserver((seen) => { if (seen.some((s) => s.isIntersecting) && drawn < found.length) draw(); },
    { rootMargin: "800px" }).observe(byId("more"));
  addEventListener("hashchange", recall);
  recall();
})();
