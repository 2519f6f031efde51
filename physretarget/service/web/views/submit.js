// Submit: a clip or a capture, a character, options; each error beside what it is about.

import { alarm, el, fresh, icon, say } from "../dom.js";
import { API, get, idempotencyKey, query, upload } from "../api.js";
import { dropZone } from "../drop.js";
import { EXAMPLES, exampleFile } from "../examples.js";
import { optionsOf, readOptions, words, written } from "../options.js";
import { ago, bytes, plural } from "../words.js";

const CLIPS = ".npz,.npy,.csv,.pkl,.txt", CAPTURES = ".bvh,.amc,.c3d,.trc,.json,.txt";
const HEADLESS = /\.(csv|npy)$/i; // formats that carry no frame rate
const BUILT_IN = new Set(["lamp", "penguin", "squirrel"]);
// Which part of the form an error of the API is about.
const PLACES = { clip: "clip", clip_id: "clip", capture: "clip", capture_id: "clip", skeleton: "skeleton",
  model: "model", model_file: "model", character: "model", keyposes: "keyposes" };
const uploaded = new WeakMap(); // files that have arrived, so that a second try need not send them
let waiting = []; // files dropped on another page

/** Keep files that were dropped elsewhere for the form. */
export function take(files) { waiting = files; }

export async function submitView({ main, params, signal, name }) {
  const [models, clips, before] = await Promise.all([
    get(`${API}/models${query({ limit: 200 })}`, { signal }),
    get(`${API}/clips${query({ limit: 100 })}`, { signal }),
    params.get("from") ? get(`${API}/jobs/${encodeURIComponent(params.get("from"))}`, { signal }) : null,
  ]);
  if (before && !clips.items.some((clip) => clip.sha256 === before.clip.sha256)) { // an old one, then
    const { items } = await get(`${API}/clips${query({ q: before.clip.name, limit: 200 })}`, { signal });
    clips.items.unshift(...items.filter((clip) => clip.sha256 === before.clip.sha256).slice(0, 1));
  }
  const kind = before?.kind ?? (params.get("kind") === "retarget" ? "retarget" : "validate");
  const options = await optionsOf(kind, signal);
  const form = build({ kind, options, models: models.items, clips: clips.items, before, params });
  name(before ? "Judge again" : kind === "validate" ? "Submit a clip" : "Submit a capture");
  main.append(el("h1", {}, before ? `Judge again: ${before.clip.name}` : "Submit"), tabs(kind), form.node);
  if (waiting.length) {
    form.take(waiting);
    waiting = [];
  }
}

function tabs(kind) {
  const tab = (value, title, text) => el("a", { href: `#/new?kind=${value}`, "aria-current": kind === value ? "page" : null },
    el("b", {}, title), " ", el("span", {}, text));
  return el("nav", { class: "tabs wide", "aria-label": "What to submit" },
    tab("validate", "Judge a clip", "Is this motion physically possible?"),
    tab("retarget", "Retarget a capture", "Let a character act out a human’s motion"));
}

function build({ kind, options, models, clips, before, params }) {
  const judging = kind === "validate", key = { now: idempotencyKey() };
  const form = el("form", { class: "submit", novalidate: true });
  const clip = clipPart(judging, clips, before, params, (files) => guess(form, files, summary));
  const skeleton = judging ? null : dropZone({ name: "skeleton", label: "Skeleton (ASF)", hint: "only for AMC captures", accept: ".asf" });
  const model = modelPart(judging, models, before, params, () => summary());
  const poses = judging ? null : dropZone({ name: "keyposes", label: "Key poses (TOML)", hint: "the built-in characters have their own", accept: ".toml", multiple: true });
  const button = el("button", { class: "button main big", type: "submit" }, judging ? "Judge it" : "Retarget it");
  const facts = el("dl"), sending = el("div", { class: "sending" }), wrong = el("div");

  const section = (place, number, title, ...inside) => el("section", { class: "card part", "data-place": place },
    el("h2", {}, el("i", { "aria-hidden": "true" }, number), title), inside, el("div", { class: "wrong" }));
  const start = before?.options ?? {};
  const usual = options.filter((option) => !option.advanced), advanced = options.filter((option) => option.advanced);
  form.append(
    el("div", { class: "parts" },
      section("clip", "1", judging ? "The clip" : "The capture", clip.node,
        skeleton && el("div", { "data-place": "skeleton" }, skeleton.zone, el("div", { class: "wrong" }))),
      section("model", "2", judging ? "The model" : "The character", model.node,
        poses && el("div", { "data-place": "keyposes" }, poses.zone, el("div", { class: "wrong" }))),
      section("options", "3", "Options",
        el("p", { class: "soft" }, "All can be left as they are."),
        el("div", { class: "fields" }, usual.map((option) => fieldOf(option, start))),
        el("details", { open: advanced.some((option) => option.name in start) },
          el("summary", {}, "More options"),
          el("div", { class: "fields" }, advanced.map((option) => fieldOf(option, start)))))),
    el("aside", { class: "card go", "aria-label": "Submit" }, facts, wrong, sending, button,
      el("p", { class: "hint" }, "Uploads stay in the ", el("a", { href: "#/library" }, "library"), ", so that they can be judged again.")));

  function summary() {
    const rows = [[judging ? "Clip" : "Capture", clip.told()], [judging ? "Model" : "Character", model.told()],
      ...options.map((option) => [option.label, form.elements[`option-${option.name}`]?.value.trim()]).filter(([, text]) => text)];
    facts.replaceChildren(...rows.flatMap(([name, value]) => [el("dt", {}, name), el("dd", { class: value ? null : "missing" }, value || "not chosen yet")]));
  }

  async function submit() {
    calmDown(form, wrong);
    const missing = !clip.told() ? ["clip", judging ? "Choose a clip first." : "Choose a capture first."]
      : !model.told() ? ["model", "Choose a model first."]
        : !judging && !BUILT_IN.has(model.id()) && !poses.files.length ? ["keyposes", "A character that is not built in needs key poses."]
          : null;
    if (missing) return complain(form, wrong, ...missing);
    const odd = [...form.elements].find((field) => field.name?.startsWith("option-") && !field.checkValidity());
    if (odd) return complain(form, wrong, odd.name.replace("option-", "options."), odd.validationMessage);
    button.disabled = true;
    try {
      const body = new FormData(), role = judging ? "clip" : "capture";
      body.append("kind", kind);
      body.append("options", JSON.stringify(readOptions(options, form)));
      // A capture that is read with a skeleton comes with it; the library takes files that stand alone.
      if (skeleton?.files.length && clip.file()) body.append(role, clip.file());
      else body.append(`${role}_id`, clip.id() ?? await send("clips", clip.file(), role, "clip", sending));
      body.append(judging ? "model" : "character", model.id() ?? await send("models", model.file(), "model", "model", sending));
      if (skeleton?.files.length) body.append("skeleton", skeleton.files[0]);
      for (const file of poses?.files ?? []) body.append("keyposes", file);
      sending.replaceChildren(el("p", {}, "Submitting…"));
      const job = await upload(`${API}/jobs`, body, { idempotency: key.now });
      dispatchEvent(new Event("physretarget:submitted"));
      if (form.isConnected) location.hash = `#/jobs/${job.id}`;
    } catch (error) {
      if (error.status !== 0) key.now = idempotencyKey(); // another try is another job
      complain(form, wrong, error.place ?? PLACES[error.field] ?? error.field, error.message);
    } finally {
      button.disabled = false;
      sending.replaceChildren();
    }
  }
  form.addEventListener("submit", (event) => { event.preventDefault(); submit(); });
  form.addEventListener("input", () => { key.now = idempotencyKey(); summary(); });
  summary();
  return { node: form, take: (files) => clip.take(files) };
}

/** Upload to a collection, once; the new thing's id. */
async function send(collection, file, what, place, sending) {
  if (uploaded.has(file)) return uploaded.get(file);
  const bar = el("progress", { max: 1, value: 0, "aria-label": `Upload of ${file.name}` }), body = new FormData();
  sending.replaceChildren(el("p", {}, `Sending the ${what}, ${bytes(file.size)}`), bar);
  say(`Sending the ${what}`);
  body.append("file", file);
  try {
    const { id } = await upload(`${API}/${collection}`, body, { progress: (share) => { bar.value = share; } });
    uploaded.set(file, id);
    return id;
  } catch (error) {
    error.place = place;
    throw error;
  }
}

// ---- parts of the form -------------------------------------------------------------------------

function clipPart(judging, clips, before, params, changed) {
  const zone = dropZone({
    name: judging ? "clip" : "capture", accept: judging ? CLIPS : CAPTURES,
    label: judging ? "Drop a clip here, or choose one" : "Drop a capture here, or choose one",
    hint: judging ? "npz, npy, csv or pkl" : "bvh, amc, c3d, trc or DeepMimic json",
    changed: (files) => { if (files.length && known) known.value = ""; changed(files); },
  });
  const wanted = params.get("clip") ?? (before && clips.find((c) => c.sha256 === before.clip.sha256)?.id) ?? "";
  const id = fresh("known");
  const known = clips.length ? el("select", { id, on: { change: () => { if (known.value) zone.set([]); changed([]); } } },
    el("option", { value: "" }, "none"),
    clips.map((c) => el("option", { value: c.id, selected: c.id === wanted }, `${c.name} · ${bytes(c.bytes)} · ${ago(c.created)}`))) : null;
  const gone = before && !wanted ? el("p", { class: "bad" }, "Its file is no longer in the library; choose it again.") : null;
  const example = (one) => el("button", { type: "button", class: "link", on: {
    click: async (event) => {
      zone.set([await exampleFile(one.file)]);
      const lamp = event.target.form.querySelector(`input[name=model][value=${one.model}]`);
      if (lamp) { lamp.checked = true; lamp.dispatchEvent(new Event("input", { bubbles: true })); }
    } } }, one.title);
  return {
    node: el("div", {}, gone, zone.zone,
      known && el("div", { class: "field inline" }, el("label", { for: id }, "or one sent before"), known),
      judging ? el("p", { class: "hint" }, "No clip at hand? Let a lamp act: ", EXAMPLES.flatMap((one, i) => [i ? ", " : "", example(one)]), ".") : null),
    take: (files) => zone.set(files),
    id: () => zone.files.length ? null : known?.value || null,
    file: () => zone.files[0],
    told: () => zone.files[0]?.name ?? (known?.value ? known.selectedOptions[0].textContent.split(" · ")[0] : ""),
  };
}

function modelPart(judging, models, before, params, changed) {
  const wanted = params.get("model") ?? before?.model.id ?? (judging ? "" : "lamp");
  const zone = dropZone({ name: "model", label: "Drop a model here, or choose one", hint: "MuJoCo XML, or a zip with it and its meshes", accept: ".xml,.zip",
    changed: (files) => { if (files.length) own.checked = true; changed(); } });
  const own = el("input", { type: "radio", name: "model", value: "", class: "sr-radio" });
  const cards = models.map((model) => el("label", { class: "choice" },
    el("input", { type: "radio", name: "model", value: model.id, class: "sr-radio", checked: model.id === wanted }),
    picture(model),
    el("span", {}, el("b", {}, model.name), " ", el("small", {}, `${Number(model.mass_kg.toPrecision(2))} kg · ${plural(model.joints, "joint")}`))));
  const upload = el("label", { class: "choice" }, own, el("span", { class: "thumb" }, icon("up")),
    el("span", {}, el("b", {}, "Upload"), " ", el("small", {}, "xml or zip")));
  const group = el("div", { class: "choices", role: "radiogroup", "aria-label": judging ? "Model" : "Character" }, cards, upload);
  const filter = models.length > 8 ? el("input", { type: "search", placeholder: "Find a model", "aria-label": "Find a model", on: {
    input: (event) => cards.forEach((card, i) => { card.hidden = !models[i].name.toLowerCase().includes(event.target.value.toLowerCase()); }) } }) : null;
  const place = el("div", { class: "own" }, zone.zone);
  const settle = () => { place.hidden = !own.checked; changed(); };
  group.addEventListener("change", settle);
  group.addEventListener("input", settle);
  if (params.get("model") === "upload") own.checked = true;
  place.hidden = !own.checked;
  const chosen = () => group.querySelector("input:checked");
  return {
    node: el("div", {}, filter, group, place),
    id: () => chosen()?.value || null,
    file: () => zone.files[0],
    told: () => { const now = chosen(); return !now ? "" : now.value ? models.find((m) => m.id === now.value)?.name ?? "" : zone.files[0]?.name ?? ""; },
  };
}

/** A built-in character's picture; of any other its initial. */
export function picture(model) {
  if (model.builtin) return el("img", { class: "thumb", src: `/web/pictures/${model.id}.jpg`, alt: "", width: 88, height: 88 });
  return el("span", { class: "thumb", "aria-hidden": "true" }, model.name.slice(0, 1).toUpperCase());
}

function fieldOf(option, start) {
  const id = fresh(option.name), hint = fresh("hint"), value = written(option, start[option.name]);
  const common = { id, name: `option-${option.name}`, "aria-describedby": hint }, choice = words(option);
  const number = option.kind === "number" || option.kind === "whole";
  const input = choice
    ? el("select", common, choice.map(([word, text]) => el("option", { value: word, selected: word === value }, text)))
    : el("input", { ...common, type: number ? "number" : "text", min: option.least ?? option.above, max: option.most,
      step: number ? (option.kind === "whole" ? 1 : "any") : null, placeholder: option.default || option.metavar, value,
      inputmode: number ? "decimal" : null, autocomplete: "off", spellcheck: "false" });
  const hints = choice || !option.choices.length ? option.help : `${option.help} (${option.choices.join(", ")})`;
  return el("div", { class: "field", "data-place": `options.${option.name}` }, el("label", { for: id }, option.label), input,
    el("p", { class: "hint", id: hint }, hints), el("div", { class: "wrong" }));
}

/** A rate for files that have none, told as the guess it is. */
function guess(form, files, summary) {
  const rate = form.elements["option-fps"], hint = rate?.parentElement.querySelector(".hint");
  if (rate && files.length) {
    const headless = HEADLESS.test(files[0].name);
    if (headless && !rate.value) { rate.value = "30"; rate.dataset.guess = "yes"; }
    if (!headless && rate.dataset.guess) { rate.value = ""; delete rate.dataset.guess; }
    if (headless && rate.dataset.guess) hint.textContent = "This file carries no frame rate: 30 is a guess, change it if it is another.";
  }
  summary();
}

// ---- what is wrong -----------------------------------------------------------------------------

function calmDown(form, wrong) {
  form.querySelectorAll(".wrong").forEach((node) => node.replaceChildren());
  form.querySelectorAll("[aria-invalid]").forEach((node) => node.removeAttribute("aria-invalid"));
  wrong.replaceChildren();
}

function complain(form, wrong, place, message) {
  const part = place ? [...form.querySelectorAll("[data-place]")].find((node) => node.dataset.place === place)
    ?? (String(place).startsWith("options") ? form.querySelector("[data-place=options]") : null) : null;
  if (!part) { wrong.replaceChildren(alarm("It was not submitted.", message)); return; }
  const id = fresh("wrong"), fold = part.closest("details");
  if (fold) fold.open = true;
  const note = el("p", { class: "bad", role: "alert", id }, message);
  [...part.children].findLast((node) => node.classList.contains("wrong")).replaceChildren(note);
  const field = part.querySelector(".own:not([hidden]) input, input:not([type=radio]), select, input:checked, input");
  field.setAttribute("aria-invalid", "true");
  field.setAttribute("aria-describedby", `${field.getAttribute("aria-describedby") ?? ""} ${id}`.trim());
  field.focus();
  part.scrollIntoView({ block: "nearest" });
}
