// The clips that come with the page, for those who have none at hand.

import { API, WEB, idempotencyKey, request, upload } from "./api.js";

export const EXAMPLES = [
  { file: "lamp-jump.npz", model: "lamp", title: "a jump" },
  { file: "lamp-look.npz", model: "lamp", title: "a look around" },
  { file: "lamp-look-careless.npz", model: "lamp", title: "the same look, careless" },
];

/** The example as a file, as if it had been chosen. */
export async function exampleFile(name) {
  const content = await (await request(`${WEB}/examples/${name}`)).blob();
  return new File([content], name);
}

/** Submit an example as it is; the id of its job. */
export async function tryExample({ file, model } = EXAMPLES[0]) {
  const clip = new FormData(), form = new FormData();
  clip.append("file", await exampleFile(file));
  const { id } = await upload(`${API}/clips`, clip);
  form.append("kind", "validate");
  form.append("clip_id", id);
  form.append("model", model);
  return (await upload(`${API}/jobs`, form, { idempotency: idempotencyKey() })).id;
}
