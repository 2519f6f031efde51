// The options of a job as fields; which there are, and what they may be, is the server's to say.

import { API, get } from "./api.js";

let known = null;

/** Options by kind of job, asked for once. */
export async function optionsOf(kind, signal) {
  known ??= await get(`${API}/options`, { signal });
  return known[kind];
}

/** The words to choose from, the default first; null where anything may be written. */
export function words(option) {
  const plain = option.default || "none";
  if (option.kind === "flag") return [["", "no"], ["true", "yes"]];
  if (!option.choices.length || option.or_metres || option.many || option.kind === "table") return null;
  return [["", option.choices.includes(plain) ? `${plain} (default)` : plain],
    ...option.choices.filter((word) => word !== plain).map((word) => [word, word])];
}

/** What was entered, as the API takes it; what was left alone is left out. */
export function readOptions(options, form) {
  const given = {};
  for (const option of options) {
    const text = form.elements[`option-${option.name}`]?.value.trim() ?? "";
    if (text) given[option.name] = value(option, text);
  }
  return given;
}

function value(option, text) {
  const parts = text.split(/[\s,;]+/).filter(Boolean);
  if (option.kind === "flag") return true;
  if (option.kind === "number" || option.kind === "whole") return Number(text);
  if (option.kind === "table") return table(option, parts);
  return option.many ? parts : text;
}

/** CODE=value or CODE.NAME=value, as on the command line. */
function table(option, parts) {
  const made = {};
  for (const part of parts) {
    const [path, text = ""] = part.split("="), [code, name] = path.split(".");
    const content = option.choices.length || !text ? text : Number(text);
    if (option.depth === 1) made[path] = content;
    else (made[code] ??= {})[name ?? ""] = content;
  }
  return made;
}

/** An option's value as text, to be changed and read again. */
export function written(option, value) {
  if (option.kind !== "table") return [value ?? ""].flat().join(", ");
  return Object.entries(value ?? {}).flatMap(([code, inner]) => option.depth === 1 ? `${code}=${inner}`
    : Object.entries(inner).map(([name, number]) => `${code}.${name}=${number}`)).join(", ");
}
