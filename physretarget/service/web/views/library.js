// What jobs take: models and clips that are kept; upload and delete.

import { alarm, calm, confirm, el, fresh, icon, say } from "../dom.js";
import { API, get, query, remove, upload } from "../api.js";
import { dropZone } from "../drop.js";
import { ago, bytes, exact, number, plural } from "../words.js";
import { picture } from "./submit.js";

export async function libraryView({ main, signal }) {
  const models = el("ul", { class: "models", "aria-label": "Models" }), clips = el("div"), trouble = el("div");
  const add = el("button", { class: "button main", type: "button", on: { click: async () => {
    const made = await uploadDialog();
    if (made) { say(`${made.name} is registered`); await load(); }
  } } }, icon("plus"), "Upload a model");
  main.append(el("div", { class: "head" }, el("h1", {}, "Library"), add), trouble,
    el("h2", {}, "Models"), el("p", { class: "soft" }, "A model is a MuJoCo XML file, or a zip with it and its meshes. It is looked at before it is accepted: what reaches outside its folder or takes too much is refused."),
    models, el("h2", {}, "Clips"), clips);

  async function erase(path, what, text) {
    if (!await confirm(`Delete ${what}?`, text, "Delete")) return;
    try {
      await remove(path);
      say(`${what} is deleted`);
      trouble.replaceChildren();
    } catch (error) {
      trouble.replaceChildren(alarm("It was not deleted.", error.message));
    }
    await load().catch((error) => { if (!signal.aborted) throw error; });
  }
  async function load() {
    const [allModels, allClips] = await Promise.all([
      get(`${API}/models${query({ limit: 200 })}`, { signal }), get(`${API}/clips${query({ limit: 200 })}`, { signal }),
    ]);
    models.replaceChildren(...allModels.items.map((model) => modelCard(model, erase)));
    clips.replaceChildren(allClips.items.length
      ? el("ul", { class: "clips", "aria-label": "Clips" }, allClips.items.map((clip) => clipRow(clip, erase)))
      : calm(el("p", {}, "Clips that you submit are kept here. ", el("a", { href: "#/new" }, "Submit one"))));
  }
  await load();
}

function modelCard(model, erase) {
  const clash = model.findings.length;
  return el("li", { class: "card model" }, picture(model),
    el("div", {},
      el("h3", {}, model.name, model.builtin ? el("span", { class: "chip same" }, "built in") : null),
      el("p", { class: "soft" }, `${number(model.mass_kg)} kg · ${plural(model.bodies, "body").replace("bodys", "bodies")} · ${plural(model.joints, "joint")}`),
      clash ? el("details", {}, el("summary", {}, plural(clash, "finding"), " about the model itself"),
        el("ul", { class: "notes" }, model.findings.map((f) => el("li", {}, el("span", { class: `dot ${f.severity}` }), el("b", { class: "code" }, f.code), ` ${f.message}`))))
        : el("p", { class: "fine" }, icon("check"), "nothing to complain about"),
      el("p", { class: "row" },
        el("a", { class: "button small", href: `#/new${query({ model: model.id })}`, "aria-label": `Judge a clip with ${model.name}` }, "Judge with it"),
        el("a", { class: "button small", href: `#/jobs${query({ model: model.id })}`, "aria-label": `Jobs of ${model.name}` }, "Its jobs"),
        model.builtin ? null : el("button", { class: "button small quiet", type: "button", "aria-label": `Delete ${model.name}`, title: "Delete",
          on: { click: () => erase(`${API}/models/${model.id}`, model.name, "Jobs that used it keep their reports.") } }, icon("bin")))));
}

function clipRow(clip, erase) {
  return el("li", {}, el("span", { class: "name" }, clip.name),
    el("span", { class: "soft" }, bytes(clip.bytes), " · ", el("time", { datetime: clip.created, title: exact(clip.created) }, ago(clip.created))),
    el("span", { class: "row" },
      el("a", { class: "button small", href: `#/new${query({ clip: clip.id })}`, "aria-label": `Judge ${clip.name}` }, "Judge"),
      el("button", { class: "button small quiet", type: "button", "aria-label": `Delete ${clip.name}`, title: "Delete",
        on: { click: () => erase(`${API}/clips/${clip.id}`, clip.name, "Jobs that used it keep their reports.") } }, icon("bin"))));
}

/** Ask for a model's files; resolves to the model, or null. */
function uploadDialog() {
  return new Promise((resolve) => {
    const head = fresh("upload"), nameId = fresh("name"), mainId = fresh("main");
    const zone = dropZone({ name: "model", label: "Drop a model here, or choose one", hint: "MuJoCo XML, or a zip with it and its meshes", accept: ".xml,.zip",
      changed: ([file]) => { entry.hidden = !file || !/\.zip$/i.test(file.name); } });
    const name = el("input", { id: nameId, maxlength: 200, autocomplete: "off", placeholder: "the file’s name" });
    const inside = el("input", { id: mainId, maxlength: 400, autocomplete: "off", placeholder: "found by itself if there is one" });
    const entry = el("div", { class: "field", hidden: true }, el("label", { for: mainId }, "Main file in the zip"), inside);
    const wrong = el("div"), bar = el("progress", { max: 1, value: 0, hidden: true, "aria-label": "Upload" });
    const send = el("button", { class: "button main", type: "submit" }, "Upload");
    const form = el("form", {},
      el("h2", { id: head }, "Upload a model"), zone.zone,
      el("div", { class: "field" }, el("label", { for: nameId }, "Name"), name), entry, wrong, bar,
      el("div", { class: "row end" }, el("button", { class: "button", type: "button", on: { click: () => dialog.close() } }, "Cancel"), send));
    const dialog = el("dialog", { "aria-labelledby": head }, form);
    let made = null;
    form.addEventListener("submit", async (event) => {
      event.preventDefault();
      if (!zone.files.length) { wrong.replaceChildren(alarm("Choose a file first.", "")); zone.input.focus(); return; }
      const body = new FormData();
      body.append("file", zone.files[0]);
      if (name.value.trim()) body.append("name", name.value.trim());
      if (!entry.hidden && inside.value.trim()) body.append("main", inside.value.trim());
      send.disabled = true;
      bar.hidden = false;
      wrong.replaceChildren();
      try {
        made = await upload(`${API}/models`, body, { progress: (share) => { bar.value = share; } });
        dialog.close();
      } catch (error) {
        wrong.replaceChildren(alarm("It was refused.", error.message));
      } finally {
        send.disabled = false;
        bar.hidden = true;
      }
    });
    dialog.addEventListener("close", () => { dialog.remove(); resolve(made); });
    document.body.append(dialog);
    dialog.showModal();
  });
}
