// The shell: routes by hash, the server's health, the question for a token, files dropped anywhere.

import { $, alarm, el, fresh, say } from "./dom.js";
import { ApiError, ROOT, get, onUnauthorized, renew, token } from "./api.js";
import { plural } from "./words.js";
import { compareView } from "./views/compare.js";
import { jobView } from "./views/job.js";
import { jobsView } from "./views/jobs.js";
import { libraryView } from "./views/library.js";
import { submitView, take } from "./views/submit.js";

const ROUTES = [
  [/^\/jobs$/, jobsView, "Jobs"],
  [/^\/jobs\/([0-9a-z]{1,64})$/, jobView, "Job"],
  [/^\/new$/, submitView, "Submit"],
  [/^\/compare$/, compareView, "Compare"],
  [/^\/library$/, libraryView, "Library"],
];
const HEALTH_MS = 5_000, COUNTED_MS = 1_200; // the server counts its jobs once a second
let leaving = new AbortController(), first = true;

// ---- routes ------------------------------------------------------------------------------------

function route() {
  const [path, search = ""] = location.hash.replace(/^#/, "").split("?");
  const place = path || "/jobs";
  for (const [pattern, view, title] of ROUTES) {
    const found = pattern.exec(place);
    if (found) return { view, title, id: found[1] ?? null, params: new URLSearchParams(search) };
  }
  return { view: nowhere, title: "Not found", id: null, params: new URLSearchParams() };
}

function nowhere({ main }) {
  main.replaceChildren(el("h1", {}, "There is nothing here"),
    el("p", { class: "soft" }, "The address is none of this page’s. ", el("a", { href: "#/jobs" }, "To the jobs")));
}

async function show() {
  leaving.abort();
  leaving = new AbortController();
  const { signal } = leaving, { view, title, id, params } = route(), main = $("main");
  for (const link of document.querySelectorAll("#nav a")) {
    const here = (location.hash || "#/jobs").startsWith(link.getAttribute("href"));
    if (here) link.setAttribute("aria-current", "page"); else link.removeAttribute("aria-current");
  }
  name(title);
  const page = el("div", { class: "page" });
  main.replaceChildren(page);
  if (!first) { scrollTo(0, 0); main.focus({ preventScroll: true }); }
  first = false;
  try {
    await view({ main: page, id, params, signal, name });
  } catch (error) {
    if (!signal.aborted) page.replaceChildren(failure(error));
  }
}

/** Title of the window, told to screen readers too. */
function name(title) {
  document.title = `${title} · physretarget`;
  say(title);
}

function failure(error) {
  if (!(error instanceof ApiError)) console.error(error);
  const again = el("button", { class: "button", type: "button", on: { click: show } }, "Try again");
  const [title, text] = error instanceof ApiError ? {
    0: ["The server is out of reach.", "Is it still running?"],
    401: ["A token is needed.", "This server answers only to those who have one."],
    403: ["Not allowed.", error.message],
    404: ["There is no such thing.", "It may have been deleted."],
  }[error.status] ?? ["That did not work.", error.message] : ["The page has a fault.", String(error.message)];
  return alarm(title, text, el("p", {}, again, " ", el("a", { class: "button", href: "#/jobs" }, "To the jobs")));
}

// ---- token -------------------------------------------------------------------------------------

function askToken() {
  const wrong = token.get() !== null;
  token.forget();
  return new Promise((resolve) => {
    const head = fresh("token"), field = fresh("token"), hint = fresh("token");
    const input = el("input", {
      id: field, type: "password", required: true, autocomplete: "off", spellcheck: "false",
      "aria-describedby": hint, "aria-invalid": wrong ? "true" : null,
    });
    const dialog = el("dialog", { "aria-labelledby": head, class: "ask" },
      el("form", { method: "dialog" },
        el("h2", { id: head }, "A token, please"),
        wrong ? el("p", { class: "bad", role: "alert" }, "The server does not know that token.") : null,
        el("label", { for: field }, "Token"), input,
        el("p", { class: "hint", id: hint }, "Whoever runs the server makes one with ",
          el("code", {}, "physretarget token create"), ". It is kept in this tab only, and forgotten when the tab is closed."),
        el("div", { class: "row end" },
          el("button", { class: "button", value: "cancel", type: "submit", formnovalidate: true }, "Not now"),
          el("button", { class: "button main", value: "ok", type: "submit" }, "Use this token"))));
    // Enter presses a form's first button: make that the second one.
    input.addEventListener("keydown", (event) => {
      if (event.key !== "Enter") return;
      event.preventDefault();
      dialog.querySelector(".main").click();
    });
    dialog.addEventListener("close", () => {
      const given = input.value.trim(), ok = dialog.returnValue === "ok" && /^[!-~]+$/.test(given);
      if (ok) token.set(given);
      dialog.remove();
      tokenButton(true);
      resolve(ok);
    });
    document.body.append(dialog);
    dialog.showModal();
    input.focus();
  });
}

function tokenButton(needed) {
  const button = $("token-button"), mine = token.get();
  button.hidden = !needed && !mine;
  button.textContent = mine ? "Forget token" : "Enter token";
  button.onclick = async () => {
    if (mine) { token.forget(); tokenButton(true); await show(); } else if (await renew()) await show();
  };
}

// ---- health ------------------------------------------------------------------------------------

async function health() {
  const badge = $("health"), words = badge.lastElementChild;
  try {
    const told = await get(`${ROOT}health`);
    const { queued, running } = told.queue, busy = running + queued;
    badge.dataset.state = told.status === "ok" ? (busy ? "busy" : "ok") : "degraded";
    const text = told.status !== "ok" ? "degraded" : busy ? `${running} running, ${queued} waiting` : "ready";
    if (words.textContent !== text) words.textContent = text;
    badge.title = `${plural(told.workers, "worker")}; jobs run ${told.sandbox?.landlock ? "confined by the kernel" : "in processes with limits"}`;
    $("version").textContent = `physretarget ${told.version}`;
    tokenButton(told.tokens === true);
  } catch {
    badge.dataset.state = "away";
    words.textContent = "out of reach";
  }
}

// ---- files dropped anywhere --------------------------------------------------------------------

function dropping() {
  const veil = $("veil"), holds = (event) => event.dataTransfer?.types.includes("Files");
  let depth = 0;
  const settle = () => { veil.hidden = depth <= 0 || location.hash.startsWith("#/new"); };
  addEventListener("dragenter", (event) => { if (holds(event)) { depth++; settle(); } });
  addEventListener("dragleave", (event) => { if (holds(event)) { depth = Math.max(0, depth - 1); settle(); } });
  addEventListener("dragover", (event) => holds(event) && event.preventDefault());
  addEventListener("drop", (event) => {
    depth = 0;
    settle();
    if (!holds(event)) return;
    event.preventDefault();
    if (event.target.closest?.(".drop")) return; // it has its own place
    take([...event.dataTransfer.files]);
    if (location.hash.startsWith("#/new")) show(); else location.hash = "#/new";
  });
}

onUnauthorized(askToken);
$("skip").addEventListener("click", (event) => { event.preventDefault(); $("main").focus(); });
addEventListener("hashchange", show);
dropping();
tokenButton(false);
show();
health();
setInterval(() => document.hidden || health(), HEALTH_MS);
document.addEventListener("visibilitychange", () => document.hidden || health());
addEventListener("physretarget:submitted", () => setTimeout(health, COUNTED_MS));
