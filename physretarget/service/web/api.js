// The API as functions: one error class, the token, uploads with progress, a job's events.

/** Where the service is, below whatever path a proxy gives it: this file is at web/api.js there. */
export const ROOT = new URL("..", import.meta.url).pathname;
export const WEB = `${ROOT}web`;
export const API = `${ROOT}api/v1`;
const KEY = "physretarget-token";
let asking = null; // the open question for a token, shared by all that wait for it
let ask = async () => false;

export class ApiError extends Error {
  constructor(status, { code = "error", message = "The server gave no reason.", field = null } = {}) {
    super(message);
    Object.assign(this, { status, code, field });
  }
}

/** How to ask a person for a token: resolves to true if there is a new one. */
export function onUnauthorized(question) { ask = question; }

export const token = {
  get: () => sessionStorage.getItem(KEY),
  set: (text) => sessionStorage.setItem(KEY, text),
  forget: () => sessionStorage.removeItem(KEY),
};

function headers(more = {}) {
  const mine = token.get();
  return mine ? { ...more, Authorization: `Bearer ${mine}` } : more;
}

async function problem(response) {
  let told = {};
  try { told = (await response.json()).error ?? {}; } catch { /* not ours, then: a proxy's page, say */ }
  if (!told.message) told.message = `The server answered ${response.status}.`;
  if (response.status === 429) told.message += ` Try again in ${response.headers.get("Retry-After") ?? "a few"} s.`;
  return new ApiError(response.status, told);
}

/** Ask for a token once, however many requests wait for it. */
export function renew() {
  asking ??= ask().finally(() => { asking = null; });
  return asking;
}

/** fetch with the token; asks for one on 401 and tries again. */
export async function request(path, options = {}) {
  for (;;) {
    const used = token.get();
    let response;
    try {
      response = await fetch(path, { ...options, headers: headers(options.headers), credentials: "omit" });
    } catch (error) {
      if (error.name === "AbortError") throw error;
      throw new ApiError(0, { code: "offline", message: "The server cannot be reached." });
    }
    if (response.ok) return response;
    if (response.status === 401 && (token.get() !== used || await renew())) continue;
    throw await problem(response);
  }
}

export const get = async (path, options) => (await request(path, options)).json();
export const post = async (path, body, options) => (await request(path, { method: "POST", body, ...options })).json();
export const remove = (path) => request(path, { method: "DELETE" });

/** Query text out of an object; empty values are left out. */
export function query(values) {
  const kept = Object.entries(values).filter(([, value]) => value !== "" && value !== null && value !== undefined);
  const text = new URLSearchParams(kept).toString();
  return text ? `?${text}` : "";
}

/** POST a form and tell the share that has been sent; fetch cannot. */
export async function upload(path, form, { progress = () => {}, idempotency = null } = {}) {
  for (;;) {
    const used = token.get();
    const sent = await send(path, form, progress, idempotency);
    if (sent.status >= 200 && sent.status < 300) return sent.body;
    if (sent.status === 401 && (token.get() !== used || await renew())) continue;
    throw new ApiError(sent.status, sent.body?.error ?? { message: `The server answered ${sent.status}.` });
  }
}
function send(path, form, progress, idempotency) {
  return new Promise((resolve, reject) => {
    const lost = () => reject(new ApiError(0, { code: "offline", message: "The connection broke while sending." }));
    const wire = new XMLHttpRequest();
    wire.open("POST", path);
    for (const [name, value] of Object.entries(headers())) wire.setRequestHeader(name, value);
    if (idempotency) wire.setRequestHeader("Idempotency-Key", idempotency);
    wire.upload.addEventListener("progress", (event) => event.lengthComputable && progress(event.loaded / event.total));
    wire.addEventListener("load", () => {
      let body = null;
      try { body = JSON.parse(wire.responseText); } catch { /* told by the status alone */ }
      resolve({ status: wire.status, body });
    });
    wire.addEventListener("error", lost);
    wire.addEventListener("abort", lost);
    wire.send(form);
  });
}

/** A random key, so that a form sent twice makes one job. */
export function idempotencyKey() {
  return Array.from(crypto.getRandomValues(new Uint8Array(16)), (b) => b.toString(16).padStart(2, "0")).join("");
}

/** A URL for a frame or a download, which cannot send the token. */
export async function openable(path) {
  if (!token.get()) return path;
  const made = await post(`${API}/tickets`, JSON.stringify({ path: `/${path.slice(ROOT.length)}` }), { headers: { "Content-Type": "application/json" } });
  return made.url;
}

const ENDED = new Set(["done", "failed", "cancelled"]);
export const ended = (job) => ENDED.has(job.status);
const pause = (milliseconds, signal) => new Promise((resolve) => {
  const timer = setTimeout(resolve, milliseconds);
  signal.addEventListener("abort", () => { clearTimeout(timer); resolve(); }, { once: true });
});

/**
 * Follow a job until it ends. Server-sent events by fetch, since EventSource can send no token;
 * where the stream breaks or is refused, the job is asked for until a stream holds again.
 */
export async function follow(id, tell, signal) {
  let last = "";
  for (let tries = 0; !signal.aborted; tries++) {
    try {
      for await (const { event, data, id: seen } of events(`${API}/jobs/${id}/events`, last, signal)) {
        last = seen || last;
        tries = 0;
        if (event) tell(data);
        if (ended(data)) return;
      }
    } catch (error) {
      if (signal.aborted) return;
      if (error.status === 404 || error.status === 401 || error.status === 403) throw error;
    }
    try {
      const job = await get(`${API}/jobs/${id}`, { signal });
      tell(job);
      if (ended(job)) return;
    } catch (error) {
      if (signal.aborted) return;
      if (error.status && error.status !== 429 && error.status < 500) throw error;
      tell(null); // out of reach for now
    }
    await pause(Math.min(800 * 1.5 ** tries, 8000), signal);
  }
}

async function* events(path, last, signal) {
  const response = await request(path, { signal, headers: last ? { "Last-Event-ID": last } : {} });
  const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
  let rest = "";
  for (;;) {
    const { value, done } = await reader.read();
    if (done) return;
    rest += value;
    const blocks = rest.split(/\r?\n\r?\n/);
    rest = blocks.pop();
    for (const block of blocks) {
      const fields = {};
      for (const line of block.split(/\r?\n/)) {
        const cut = line.indexOf(":");
        if (cut > 0) fields[line.slice(0, cut)] = (fields[line.slice(0, cut)] ?? "") + line.slice(cut + 1).trimStart();
      }
      if (fields.data) yield { ...fields, data: JSON.parse(fields.data) };
    }
  }
}
