// A place for a file: drop it, or press it to choose; a real file input does the work.

import { el, fresh, icon } from "./dom.js";
import { bytes } from "./words.js";

/** `files` is what was chosen; `set(files)` chooses, `changed` is told. */
export function dropZone({ label, hint, accept, multiple = false, changed = () => {}, name }) {
  const id = fresh(name), about = fresh("hint"), state = { files: [] };
  const input = el("input", { type: "file", id, name, accept, multiple, "aria-describedby": about });
  const title = el("b", {}, label), detail = el("span", { id: about }, hint);
  const clear = el("button", { type: "button", class: "button small clear", hidden: true, "aria-label": `Remove the ${name}`,
    on: { click: () => { set([]); input.focus(); } } }, "Remove");
  const zone = el("div", { class: "drop" }, input, el("label", { for: id }, icon("up"), title, detail), clear);

  function set(files) {
    state.files = multiple ? files : files.slice(0, 1);
    const [one] = state.files;
    zone.classList.toggle("full", Boolean(one));
    title.textContent = one ? (state.files.length > 1 ? `${state.files.length} files` : one.name) : label;
    detail.textContent = one ? `${bytes(state.files.reduce((sum, f) => sum + f.size, 0))} · press to choose another` : hint;
    clear.hidden = !one;
    if (!one) input.value = "";
    changed(state.files);
  }
  input.addEventListener("change", () => input.files.length && set([...input.files]));
  zone.addEventListener("dragover", (event) => { event.preventDefault(); zone.classList.add("over"); });
  zone.addEventListener("dragleave", () => zone.classList.remove("over"));
  zone.addEventListener("drop", (event) => {
    event.preventDefault();
    zone.classList.remove("over");
    if (event.dataTransfer.files.length) set([...event.dataTransfer.files]);
  });
  return { zone, input, set, get files() { return state.files; } };
}
