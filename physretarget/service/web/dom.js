// Elements out of plain data. Text is always text: nothing from the server is ever parsed as HTML.

import { STATUSES } from "./words.js";

const SVG = "http://www.w3.org/2000/svg";
const ICONS = {
  up: "M12 16V5M7 10l5-5 5 5M5 19h14",
  down: "M12 4v11M7 10.500l5 5 5-5M5 19.500h14",
  check: "M5 12.500l4.5 4.500L19 7.5",
  cross: "M6.5 6.500l11 11M17.5 6.500l-11 11",
  again: "M19 12a7 7 0 1 1-2.2-5.100M19 4v4h-4",
  scale: "M12 5v14M7 19h10M5 8h14M5 8l-2.5 6h5zM19 8l-2.5 6h5z",
  play: "M8 5.500v13l10.5-6.500z",
  bin: "M5 7h14M10 7V5h4v2M7 7l.8 12h8.400L17 7",
  swap: "M4 9h15l-4-4M20 15H5l4 4",
  plus: "M12 5v14M5 12h14",
};

/** An element: properties of `on` become listeners, the others attributes. */
export function el(tag, properties = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name === "on") for (const [event, act] of Object.entries(value)) node.addEventListener(event, act);
    else if (name === "value") node.value = value;
    else if (value === true) node.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) node.setAttribute(name, value);
  }
  node.append(...children.flat().filter((child) => child !== null && child !== undefined && child !== false));
  return node;
}

/** A line icon; decoration, so hidden from screen readers. */
export function icon(name) {
  const svg = document.createElementNS(SVG, "svg"), path = document.createElementNS(SVG, "path");
  svg.setAttribute("viewBox", "0 0 24 24");
  svg.setAttribute("class", "icon");
  svg.setAttribute("aria-hidden", "true");
  path.setAttribute("d", ICONS[name]);
  svg.append(path);
  return svg;
}

export const $ = (id) => document.getElementById(id);

let ids = 0;
/** An id that no other element of the page has. */
export const fresh = (stem) => `${stem}-${++ids}`;

/** Tell a screen reader, without moving anybody. */
export function say(text) {
  if ($("live").textContent !== text) $("live").textContent = text;
}

/** The verdict of a finished job; jobs of earlier versions say only whether they passed. */
export function judgement(summary) {
  if (!summary.passed && !summary.errors && summary.verdict) return summary.verdict;
  return summary.passed ? "passed" : "failed";
}

/** A pill that tells a job's status, or of a finished one whether it passed. */
export function verdict(job) {
  if (job.status !== "done") return el("span", { class: `chip ${job.status}` }, STATUSES[job.status] ?? job.status);
  if (!job.summary) return el("span", { class: "chip done" }, "done");
  const told = judgement(job.summary);
  const looks = { passed: ["passed", "check"], failed: ["unfit", "cross"], "not judged": ["open", "cross"] };
  const [style, sign] = looks[told];
  return el("span", { class: `chip ${style}`, title: job.summary.reason || null },
    told === "not judged" ? "?" : icon(sign), told);
}

/** A progress bar with its name. */
export function meter(share, label) {
  return el("progress", { max: 1, value: share, "aria-label": label });
}

/** A calm box for when there is nothing, or for what to do next. */
export const calm = (...children) => el("div", { class: "calm" }, children);

/** A box for something that went wrong; read out at once. */
export function alarm(title, text, ...more) {
  return el("div", { class: "alarm", role: "alert" }, el("p", {}, el("b", {}, title), " ", text), more);
}

/** A table in a box that scrolls by itself when it is too wide, reachable by keyboard. */
export function table(label, heads, rows, classes = "") {
  const cell = (head) => el("th", { scope: "col", class: head.num ? "num" : null }, head.text ?? head);
  return el("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": label },
    el("table", { class: classes }, el("thead", {}, el("tr", {}, heads.map(cell))), el("tbody", {}, rows)));
}

/** Ask before something is lost; resolves to true or false. Escape is no. */
export function confirm(title, text, action) {
  return new Promise((resolve) => {
    const head = fresh("confirm");
    const dialog = el("dialog", { "aria-labelledby": head },
      el("form", { method: "dialog" },
        el("h2", { id: head }, title), el("p", { class: "soft" }, text),
        el("div", { class: "row end" },
          el("button", { value: "no", class: "button" }, "Keep"),
          el("button", { value: "yes", class: "button danger" }, action))));
    dialog.addEventListener("close", () => { dialog.remove(); resolve(dialog.returnValue === "yes"); });
    document.body.append(dialog);
    dialog.showModal();
  });
}
