// All jobs: search, filter, follow, cancel, choose two to compare; and what to do with none.

import { alarm, calm, el, icon, meter, say, verdict } from "../dom.js";
import { API, WEB, ended, get, post, query } from "../api.js";
import { KINDS, STATUSES, ago, counts, exact, optionsTold } from "../words.js";
import { tryExample } from "../examples.js";

const BUSY_MS = 1000, IDLE_MS = 4000, TYPING_MS = 250;
const FILTERS = ["q", "status", "kind", "model"];

export async function jobsView({ main, params, signal }) {
  const filters = Object.fromEntries(FILTERS.map((name) => [name, params.get(name) ?? ""]));
  const chosen = new Set(), rows = new Map();
  let pages = 1, timer = 0, turn = 0;

  const list = el("ul", { class: "jobs", "aria-label": "Jobs" });
  const tray = el("div", { class: "tray", hidden: true });
  const more = el("button", { class: "button", type: "button", hidden: true, on: { click: () => { pages++; load(); } } }, "Show more");
  const trouble = el("div");
  const none = el("div");

  const typed = (name) => (event) => {
    filters[name] = event.target.value;
    pages = 1;
    history.replaceState(null, "", `#/jobs${query(filters)}`);
    clearTimeout(timer);
    timer = setTimeout(load, name === "q" ? TYPING_MS : 0);
  };
  const select = (name, label, options) => {
    const node = el("select", { "aria-label": label, on: { change: typed(name) } },
      options.map(([value, text]) => el("option", { value, selected: filters[name] === value }, text)));
    return node;
  };
  const search = el("input", {
    type: "search", placeholder: "Search clips and models", "aria-label": "Search clips and models",
    maxlength: 200, value: filters.q, on: { input: typed("q") },
  });
  const bar = el("div", { class: "filters", role: "search" }, search,
    select("status", "Status", [["", "Any status"], ...Object.entries(STATUSES)]),
    select("kind", "Kind", [["", "Judged and retargeted"], ["validate", "Judged"], ["retarget", "Retargeted"]]));
  if (filters.model) {
    bar.append(el("a", { class: "chip", href: "#/jobs", title: "Show jobs of every model" }, "of one model ×"));
  }
  main.append(
    el("div", { class: "head" }, el("h1", {}, "Jobs"),
      el("a", { class: "button main", href: "#/new" }, icon("plus"), "Submit")),
    bar, trouble, list, none, more, tray);

  function choose(id, on) {
    if (on) chosen.add(id); else chosen.delete(id);
    const [left, right] = chosen;
    tray.hidden = chosen.size === 0;
    tray.replaceChildren(
      el("span", { role: "status" }, chosen.size < 2 ? "One chosen; choose another to compare" :
        chosen.size === 2 ? "Two chosen" : `${chosen.size} chosen; two can be compared`),
      chosen.size === 2
        ? el("a", { class: "button main", href: `#/compare${query({ left, right })}` }, icon("scale"), "Compare them")
        : null,
      el("button", { class: "button", type: "button", on: { click: clear } }, "Clear"));
  }
  function clear() {
    for (const id of [...chosen]) {
      choose(id, false);
      const box = rows.get(id)?.node.querySelector("input");
      if (box) box.checked = false;
    }
    search.focus();
  }

  async function cancel(job) {
    try {
      await post(`${API}/jobs/${job.id}/cancel`);
      say(`${job.clip.name} is being cancelled`);
    } catch (error) {
      trouble.replaceChildren(alarm("It was not cancelled.", error.message));
    }
    load();
  }

  function row(job) {
    const text = JSON.stringify(job);
    const known = rows.get(job.id);
    if (known?.text === text) {
      known.node.querySelector("time").textContent = ago(job.created);
      return known.node;
    }
    const node = known?.node ?? el("li", { class: "job" });
    const focused = node.contains(document.activeElement) ? document.activeElement.className : null;
    node.replaceChildren(...parts(job, chosen, choose, cancel));
    if (focused) (node.querySelector(`.${focused.split(" ")[0]}`) ?? node.querySelector("a")).focus();
    rows.set(job.id, { text, node });
    return node;
  }

  async function load() {
    const mine = ++turn;
    clearTimeout(timer);
    try {
      const items = [];
      let cursor = "";
      for (let page = 0; page < pages; page++) {
        const part = await get(`${API}/jobs${query({ ...filters, limit: 50, cursor })}`, { signal });
        items.push(...part.items);
        cursor = part.next;
        if (!cursor) break;
      }
      if (mine !== turn || signal.aborted) return;
      trouble.replaceChildren();
      draw(items, cursor);
      timer = setTimeout(load, items.some((job) => !ended(job)) ? BUSY_MS : IDLE_MS);
    } catch (error) {
      if (mine !== turn || signal.aborted) return;
      if (rows.size === 0 && error.status !== 0 && error.status !== 429 && error.status < 500) throw error;
      trouble.replaceChildren(alarm("The list is not up to date.", error.message));
      timer = setTimeout(load, IDLE_MS);
    }
  }

  function draw(items, next) {
    const wanted = items.map(row);
    const same = wanted.length === list.children.length && wanted.every((node, i) => list.children[i] === node);
    if (!same) {
      const focus = document.activeElement;
      list.replaceChildren(...wanted);
      if (focus !== document.activeElement && wanted.some((node) => node.contains(focus))) focus.focus();
    }
    more.hidden = !next;
    const filtered = FILTERS.some((name) => filters[name]);
    bar.hidden = !filtered && items.length === 0;
    list.hidden = items.length === 0;
    if (items.length) none.replaceChildren();
    else if (!none.firstChild || filtered) {
      none.replaceChildren(filtered
        ? calm(el("p", {}, "No job is like that. ", el("a", { href: "#/jobs", on: { click: () => pages = 1 } }, "Show all")))
        : welcome(signal));
    }
  }

  signal.addEventListener("abort", () => clearTimeout(timer));
  await load();
}

function parts(job, chosen, choose, cancel) {
  const done = job.status === "done", name = job.clip.name;
  const box = el("input", {
    type: "checkbox", class: "choose", checked: chosen.has(job.id), disabled: !done,
    "aria-label": `Choose ${name} to compare`,
    on: { change: (event) => choose(job.id, event.target.checked) },
  });
  const told = job.error ? job.error.message : job.summary ? counts(job.summary) : done ? "" : job.stage;
  return [
    el("label", { class: "pick" }, box),
    el("div", { class: "what" },
      el("a", { class: "name", href: `#/jobs/${job.id}` }, name),
      el("small", {}, [`${KINDS[job.kind] ?? job.kind} with ${job.model.name}`, ...optionsTold(job.options)].join(" · "))),
    el("div", { class: "verdict" }, verdict(job),
      ended(job) ? el("span", { class: `told${job.error ? " bad" : ""}` }, told) : [
        el("span", { class: "going" }, meter(job.progress, `Progress of ${name}`), el("small", {}, told)),
        el("button", { class: "stop button small", type: "button", "aria-label": `Cancel ${name}`, on: { click: () => cancel(job) } }, "Cancel"),
      ]),
    el("time", { datetime: job.created, title: exact(job.created) }, ago(job.created)),
  ];
}

function welcome(signal) {
  const trouble = el("div");
  const start = el("button", { class: "button main", type: "button", on: {
    click: async () => {
      start.disabled = true;
      try {
        location.hash = `#/jobs/${await tryExample()}`;
      } catch (error) {
        if (!signal.aborted) trouble.replaceChildren(alarm("The example could not be submitted.", error.message));
        start.disabled = false;
      }
    },
  } }, icon("play"), "Try the example");
  const step = (title, text) => el("li", {}, el("b", {}, title), " ", el("span", {}, text));
  return el("section", { class: "welcome" },
    el("img", { src: `${WEB}/pictures/lamp-large.jpg`, alt: "", width: 400, height: 400 }),
    el("div", {},
      el("h2", {}, "Is that motion possible?"),
      el("p", { class: "soft" }, "Send an animation clip and its character. Physics says which forces the motion " +
        "would take, where feet slide, sink or float, and in which frame it is worst."),
      el("ol", { class: "steps" },
        step("Choose a clip", "npz, npy, csv or pkl; or a capture that a character shall act out"),
        step("Choose a character", "one of three built in, or your MuJoCo model"),
        step("Read the verdict", "findings, measures, and the motion in 3D")),
      el("p", { class: "row" }, start, el("a", { class: "button", href: "#/new" }, icon("up"), "Submit your own")),
      el("p", { class: "hint" }, "The example is a desk lamp that jumps; it takes a few seconds."),
      trouble));
}
