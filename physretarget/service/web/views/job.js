// One job: how it goes, then the verdict, the findings beside the replay, the report, downloads.

import { alarm, calm, confirm, el, icon, judgement, meter, say, table, verdict } from "../dom.js";
import { API, ended, follow, get, post, query, remove } from "../api.js";
import { frame, opening } from "../frame.js";
import { FORMATS, TILES, counts, exact, measureName, number, quantity, took } from "../words.js";

const FEW = 8; // findings that are shown at once
const ADVICE = {
  input: "The clip or the model could not be used. Check that they belong together, and the options: frame rate, quaternion and joint order.",
  timeout: "The job took longer than this server allows; a shorter clip may pass.",
  memory: "The job needed more memory than this server allows; a shorter clip or a lighter model may pass.",
  crash: "The process that judged it died; the server goes on. Try again, and tell whoever runs the server if it happens again.",
};

export async function jobView({ main, id, params, signal, name }) {
  const path = `${API}/jobs/${encodeURIComponent(id)}`;
  const job = await get(path, { signal });
  name(job.clip.name);
  const view = params.get("view") === "report" ? "report" : "overview";
  const head = el("div"), body = el("div");
  main.append(head, body);
  if (ended(job)) return draw(job);
  const going = progressCard(job, async () => {
    try { going.update(await post(`${path}/cancel`)); } catch (error) { going.trouble(error); }
  });
  head.append(header(job));
  body.append(going.node);
  await follow(id, (seen) => going.update(seen), signal);
  if (!signal.aborted) await draw(await get(path, { signal }), true);

  async function draw(done, news = false) {
    head.replaceChildren(header(done, actions(done, head)));
    body.replaceChildren();
    if (news) say(`${done.clip.name}: ${done.summary ? `${judgement(done.summary)}, ${counts(done.summary)}` : done.status}`);
    if (done.status !== "done") { body.append(unfinished(done)); return; }
    head.append(views(done.id, view));
    if (view === "report") {
      body.append(frame(`${path}/report?format=html`, `Report of ${done.clip.name}`, "tall").box);
      return;
    }
    const report = await get(`${path}/report?format=json`, { signal });
    if (!signal.aborted) body.append(...overview(done, report, path));
  }
}

function header(job, buttons = null) {
  return el("div", { class: "head job-head" },
    el("div", {},
      el("p", { class: "kicker" }, `${job.kind === "retarget" ? "Retargeting" : "Validation"} · ${job.model.name}`),
      el("h1", {}, job.clip.name),
      el("p", { class: "verdict-line" }, el("span", { class: "big" }, verdict(job)),
        job.summary ? el("span", { class: "soft" }, counts(job.summary)) : null)),
    buttons);
}

function actions(job, head) {
  const erase = async () => {
    if (!await confirm("Delete this job?", `${job.clip.name} and its reports go away; uploads stay in the library.`, "Delete")) return;
    try {
      await remove(`${API}/jobs/${job.id}`);
      location.hash = "#/jobs";
    } catch (error) {
      head.append(alarm("It was not deleted.", error.message));
    }
  };
  return el("div", { class: "row actions" },
    job.status === "done" ? el("a", { class: "button", href: `#/compare${query({ left: job.id })}` }, icon("scale"), "Compare") : null,
    el("a", { class: "button", href: `#/new${query({ from: job.id })}` }, icon("again"), "Judge again"),
    el("button", { class: "button quiet", type: "button", "aria-label": "Delete this job", title: "Delete this job", on: { click: erase } }, icon("bin")));
}

function views(id, view) {
  const tab = (name, text) => el("a", { href: `#/jobs/${id}${name === "overview" ? "" : `?view=${name}`}`, "aria-current": view === name ? "page" : null }, text);
  return el("nav", { class: "tabs", "aria-label": "Views of this job" }, tab("overview", "Overview"), tab("report", "Full report"));
}

// ---- while it runs -----------------------------------------------------------------------------

function progressCard(job, cancel) {
  const bar = meter(job.progress, `Progress of ${job.clip.name}`);
  const share = el("b", { class: "share" }), stage = el("span"), note = el("p", { class: "hint" }), wrong = el("div");
  const stop = el("button", { class: "button", type: "button", on: { click: async () => { stop.disabled = true; await cancel(); } } }, "Cancel");
  let told = "";
  const update = (seen) => {
    if (!seen) { note.textContent = "The server is out of reach; the job goes on without this page."; return; }
    bar.value = seen.progress;
    share.textContent = `${Math.round(100 * seen.progress)} %`;
    stage.textContent = seen.status === "queued" ? "waiting for a free worker" : seen.stage || "running";
    note.textContent = seen.attempts > 1 ? `Attempt ${seen.attempts}: the worker before was interrupted.` : "This page can be closed: the job goes on, and stays in the list.";
    if (stage.textContent !== told) { told = stage.textContent; say(`${told}, ${share.textContent}`); }
  };
  update(job);
  return {
    update,
    trouble: (error) => { stop.disabled = false; wrong.replaceChildren(alarm("It was not cancelled.", error.message)); },
    node: el("section", { class: "card progress", "aria-label": "Progress" },
      el("div", { class: "row between" }, el("p", {}, share, " ", stage), stop), bar, note, wrong),
  };
}

function unfinished(job) {
  if (job.status === "cancelled") return calm(el("p", {}, "Cancelled before it was finished: there is no result."));
  return el("section", { class: "card failed-job" },
    el("h2", {}, "This could not be judged"),
    el("p", { class: "bad mono" }, job.error?.message ?? "No reason was given."),
    el("p", { class: "soft" }, ADVICE[job.error?.code] ?? "The log of the server tells more."),
    el("p", {}, el("a", { class: "button main", href: `#/new${query({ from: job.id })}` }, icon("again"), "Change options and judge again")));
}

// ---- the verdict -------------------------------------------------------------------------------

function overview(job, report, path) {
  const replay = frame(`${path}/replay`, `3D replay of ${job.clip.name}`);
  const seek = (seconds) => {
    replay.seek(seconds);
    const box = replay.box.getBoundingClientRect();
    if (box.bottom < 120 || box.top > innerHeight - 120) replay.box.scrollIntoView({ block: "center" });
    say(`Replay at ${number(seconds)} s`);
  };
  const { clip, measures } = report;
  return [
    el("div", { class: "bench" },
      el("section", { class: "stand", "aria-label": "Replay" }, replay.box),
      el("div", { class: "sheet" }, tiles(measures), findings(report.findings, seek))),
    el("div", { class: "pair uneven" },
      el("section", {}, el("h2", {}, "Measures"), measureTable(measures, clip.fps, seek)),
      el("div", { class: "beside" }, downloads(job, path), facts(job, report), coverage(report.coverage))),
  ];
}

function tiles(measures) {
  return el("dl", { class: "tiles" }, TILES.filter((name) => typeof measures[name]?.value === "number").map((name) => {
    const small = Math.abs(measures[name].value) < 1e-5; // a zero with rounding noise
    const [value, unit] = quantity(small ? 0 : measures[name].value, measures[name].unit);
    return el("div", { class: "tile" }, el("dt", {}, measureName(name)),
      el("dd", {}, el("span", { class: "value" }, value), unit ? ` ${unit}` : ""));
  }));
}

/** Errors first, then whatever is furthest beyond its limit. */
export function worstFirst(list) {
  const beyond = ({ value, limit }) => {
    if (typeof value !== "number" || typeof limit !== "number") return 0;
    const ratio = Math.abs(value) / Math.max(Math.abs(limit), 1e-9);
    return ratio >= 1 ? ratio : 1 / Math.max(ratio, 1e-9);
  };
  const rank = (finding) => (finding.severity === "error" ? 0 : 1);
  return [...list].sort((a, b) => rank(a) - rank(b) || beyond(b) - beyond(a));
}

function findings(list, seek) {
  const sorted = worstFirst(list), box = el("ol", { class: "findings", "aria-label": "Findings, the worst first" });
  const one = (f) => {
    const [value, unit] = quantity(f.value, f.unit), limit = typeof f.limit === "number" ? quantity(f.limit, f.unit).join(" ").trim() : null;
    const unsaid = (text, shown = text) => (text && !f.message.includes(text) ? [shown] : []); // no number twice
    const rest = [...unsaid(f.body), ...unsaid(typeof f.value === "number" && value.replace(/^[-−]/, ""), `${value} ${unit}`.trim()),
      ...(limit ? unsaid("limit", `limit ${limit}`) : [])];
    const when = typeof f.time_s === "number"
      ? el("button", { type: "button", class: "at", "aria-label": `Show ${f.code} in the replay at ${number(f.time_s)} s`, on: { click: () => seek(f.time_s) } }, icon("play"), `${number(f.time_s)} s`)
      : el("span", { class: "at whole" }, "whole clip");
    return el("li", { class: f.severity },
      el("p", {}, el("span", { class: `dot ${f.severity}` }), el("b", { class: "code" }, f.code), el("span", { class: "soft" }, ` ${f.severity} · ${f.rule}`), when),
      el("p", {}, f.message), rest.length ? el("p", { class: "soft small" }, rest.join(" · ")) : null);
  };
  const shown = sorted.slice(0, FEW).map(one);
  box.append(...shown);
  const all = sorted.length > FEW ? el("button", { type: "button", class: "button", on: { click: () => {
    const rest = sorted.slice(FEW).map(one);
    box.append(...rest);
    all.remove();
    rest[0].querySelector("button")?.focus();
  } } }, `Show all ${sorted.length}`) : null;
  return el("section", { class: "found" }, el("h2", {}, "Findings"),
    list.length ? [el("p", { class: "soft" }, "The worst first. A time moves the replay there."), box, all]
      : calm(el("p", {}, "No findings: every rule that could be checked is satisfied.")));
}

function measureTable(measures, fps, seek) {
  const rows = Object.entries(measures).map(([name, { value, unit, frame: at }]) => {
    const [text, sign] = quantity(value, unit);
    return el("tr", {}, el("th", { scope: "row" }, measureName(name), el("small", { class: "code" }, name)),
      el("td", { class: "num" }, text), el("td", {}, sign),
      el("td", { class: "num" }, typeof at === "number" ? el("button", { type: "button", class: "link", "aria-label": `Show frame ${at} in the replay`, on: { click: () => seek(at / fps) } }, at) : ""));
  });
  return table("Measures", ["Measure", { text: "Value", num: true }, "Unit", { text: "Worst frame", num: true }], rows, "measures");
}

function downloads(job, path) {
  const stem = job.clip.name.replace(/\.[^.]*$/, "") || "report";
  const item = (link, hint) => el("li", {}, link, el("small", {}, hint));
  return el("section", { class: "card" }, el("h2", {}, "Take it along"), el("ul", { class: "downloads" },
    FORMATS.map(([format, title, ending, hint]) => item(opening(`${path}/report?format=${format}`, `${stem}.${ending}`, {}, icon("down"), title), hint)),
    item(opening(`${path}/replay`, `${stem}.replay.html`, {}, icon("down"), "Replay"), "one page that plays without a network"),
    job.kind === "retarget" ? item(opening(`${path}/clip`, `${stem}.npz`, {}, icon("down"), "Clip"), "the character’s motion, npz") : null));
}

function facts(job, report) {
  const { clip, model, settings } = report;
  const pairs = [
    ["Clip", `${clip.frames} frames, ${number(clip.duration_s)} s at ${number(clip.fps)} fps`],
    ["Model", `${job.model.name}, ${number(model.mass_kg)} kg`],
    ["Profile", settings.profile],
    ...Object.entries(job.options).filter(([name]) => name !== "profile").map(([name, value]) => [name.replace("_", " "), typeof value === "object" ? JSON.stringify(value) : String(value)]),
    ["Low-pass", settings.lowpass_hz ? `${number(settings.lowpass_hz)} Hz` : "none"],
    [job.kind === "retarget" ? "Submitted" : "Judged", `${exact(job.created)}, took ${took(job)}`],
    ["SHA-256", clip.sha256.slice(0, 16)],
  ].filter(([name], i, list) => list.findIndex(([other]) => other.toLowerCase() === name.toLowerCase()) === i && !(name === "lowpass"));
  const notes = [...(clip.notes ?? []), ...(model.notes ?? [])];
  return el("section", { class: "card" }, el("h2", {}, "What was judged"),
    el("dl", { class: "facts" }, pairs.flatMap(([name, value]) => [el("dt", {}, name), el("dd", {}, value)])),
    notes.length ? el("ul", { class: "notes" }, notes.map((note) => el("li", {}, note))) : null);
}

function coverage(rules) {
  const open = rules.filter((rule) => rule.status !== "checked");
  return el("section", { class: "card" }, el("h2", {}, "Coverage"),
    el("p", { class: "soft" }, `${rules.length - open.length} of ${rules.length} rules could be checked. What could not be judged never counts as passed.`),
    open.length ? el("details", {}, el("summary", {}, "Not covered, and why"),
      el("ul", { class: "notes" }, open.map((rule) => el("li", {}, el("b", { class: "code" }, rule.code), ` ${rule.reason}`)))) : null);
}
