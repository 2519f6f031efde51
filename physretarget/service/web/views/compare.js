// Two finished jobs side by side: what got better or worse, what is new or gone, both on one clock.

import { calm, el, fresh, icon, say, table } from "../dom.js";
import { API, get, query } from "../api.js";
import { frame } from "../frame.js";
import { ago, counts, measureName, optionsTold, pair } from "../words.js";

const BETTER = { lower: "lower", higher: "higher", one: "near 1", none: "not judged" };
const SENTENCE = {
  worse: "Something got worse on the right:", better: "The right one is better:", fixed: "The right one is mended:",
  same: "No difference that matters:",
};

export async function compareView({ main, params, signal, name }) {
  const left = params.get("left") ?? "", right = params.get("right") ?? "";
  const { items } = await get(`${API}/jobs${query({ status: "done", limit: 200 })}`, { signal });
  const known = new Map(items.map((job) => [job.id, job]));
  for (const id of [left, right]) {
    if (id && !known.has(id)) known.set(id, await get(`${API}/jobs/${encodeURIComponent(id)}`, { signal }));
  }
  main.append(el("h1", {}, "Compare"));
  if (known.size < 2) {
    main.append(calm(el("p", {}, "Two finished jobs are needed, and there ", known.size ? "is one. " : "are none. ",
      el("a", { href: "#/new" }, "Submit a clip"), ".")));
    return;
  }
  main.append(picker(known, left, right));
  if (!left || !right) {
    main.append(calm(el("p", {}, "Choose two jobs: what is left of the other is what it is measured against.")));
    return;
  }
  name(`${known.get(left).clip.name} and ${known.get(right).clip.name}`);
  const told = await get(`${API}/compare${query({ left, right })}`, { signal });
  if (signal.aborted) return;
  say(`${SENTENCE[told.verdict] ?? told.verdict} ${told.reason}`);
  main.append(...result(told, known, left, right));
}

function picker(known, left, right) {
  const go = (to) => { location.hash = `#/compare${query(to)}`; };
  const side = (label, chosen, other, place) => {
    const id = fresh("side");
    return el("div", { class: "field" }, el("label", { for: id }, label),
      el("select", { id, on: { change: (event) => go({ left, right, [place]: event.target.value }) } },
        el("option", { value: "" }, "choose a job"),
        [...known.values()].map((job) => el("option", { value: job.id, selected: job.id === chosen, disabled: job.id === other },
          [job.clip.name, ...optionsTold(job.options), job.model.name, job.summary ? counts(job.summary) : job.status, ago(job.created)].join(" · ")))));
  };
  return el("div", { class: "picker" }, side("Left: before", left, right, "left"),
    el("button", { class: "button swap", type: "button", "aria-label": "Swap left and right", title: "Swap left and right",
      on: { click: () => go({ left: right, right: left }) } }, icon("swap")),
    side("Right: now", right, left, "right"));
}

function result(told, known, left, right) {
  const better = told.measures.filter((m) => m.change === "better").length;
  const worse = told.measures.filter((m) => m.change === "worse").length;
  const fixed = told.findings.filter((f) => f.change === "fixed").length, appeared = told.findings.filter((f) => f.change === "new").length;
  const tile = (value, text, kind) => el("div", { class: `tile ${value ? kind : ""}` }, el("dt", {}, text), el("dd", {}, el("span", { class: "value" }, value)));
  const same = known.get(left).model.name !== known.get(right).model.name
    ? el("p", { class: "hint" }, "The two were judged with different models: compare the measures with care.") : null;
  return [
    el("p", { class: "verdict-line" }, el("span", { class: "big" }, el("span", { class: `chip ${told.verdict}` }, told.verdict)),
      el("span", {}, SENTENCE[told.verdict] ?? "", " ", el("span", { class: "soft" }, told.reason))), same ?? "",
    el("dl", { class: "tiles four" }, tile(better, "measures better", "good"), tile(worse, "measures worse", "poor"),
      tile(fixed, "kinds of findings gone", "good"), tile(appeared, "kinds of findings new", "poor")),
    el("section", {}, el("h2", {}, "Both on one clock"),
      frame(`${API}/compare/replay${query({ left, right })}`, "3D replay of both clips", "wide").box),
    el("div", { class: "pair uneven" }, measures(told.measures), findings(told.findings)),
  ];
}

function measures(list) {
  const id = fresh("only"), place = el("div");
  const only = el("input", { type: "checkbox", id, checked: true, on: { change: draw } });
  const changed = list.filter((m) => m.change);
  function draw() {
    const rows = (only.checked ? changed : list).map((m) => {
      const [left, right, unit] = pair(m.left, m.right, m.unit);
      return el("tr", { class: m.change ?? "" }, el("th", { scope: "row" }, measureName(m.name), el("small", {}, `better is ${BETTER[m.better] ?? m.better}`)),
        el("td", { class: "num" }, left), el("td", { class: "num" }, right), el("td", {}, unit),
        el("td", {}, m.change ? el("span", { class: `chip ${m.change}` }, m.change === "better" ? "✓ " : "✗ ", m.change) : ""));
    });
    place.replaceChildren(rows.length ? table("Measures of both", ["Measure", { text: "Left", num: true }, { text: "Right", num: true }, "Unit", ""], rows, "measures")
      : calm(el("p", {}, "No measure left its tolerance.")));
  }
  draw();
  return el("section", {}, el("div", { class: "row between" }, el("h2", {}, "Measures"),
    el("label", { class: "check", for: id }, only, "only what changed")), place);
}

function findings(list) {
  const order = { new: 0, fixed: 1, both: 2 };
  const rows = [...list].sort((a, b) => order[a.change] - order[b.change]).map((f) => el("tr", {},
    el("th", { scope: "row", class: "code" }, f.code), el("td", { class: "num" }, f.left), el("td", { class: "num" }, f.right),
    el("td", {}, f.change === "both" ? el("span", { class: "soft" }, "both") : el("span", { class: `chip ${f.change === "new" ? "worse" : "better"}` }, f.change))));
  return el("section", {}, el("h2", {}, "Findings"),
    rows.length ? table("Findings of both", ["Code", { text: "Left", num: true }, { text: "Right", num: true }, ""], rows)
      : calm(el("p", {}, "None on either side.")));
}
