// What the hand does, asked of the server beside the page: drawing never waits for it, nor it for
// drawing. Only the newest gesture is asked for; while the body is on its way to the hand, again.
"use strict";
const STILL = 2e-3; // rad or m that a pose moves by when it has arrived
let token = "", newest = null, asking = false;

onmessage = ({ data }) => {
  if (data.token !== undefined) { token = data.token; return; }
  if (data.released) { if (newest) newest.held = false; return; }
  // Without a pose of its own a gesture goes on from where the one before has come to.
  const from = data.gesture.qpos || newest.from;
  newest = { ...data, from, follows: !data.gesture.qpos, fresh: true };
  if (!asking) ask();
};

async function ask() {
  asking = true;
  while (newest && (newest.fresh || newest.held)) {
    const now = newest, before = now.from;
    now.fresh = false;
    try {
      const answer = await fetch("/api/drag", { method: "POST", body: JSON.stringify({ ...now.gesture, qpos: before }),
        headers: { "X-Studio-Token": token, "Content-Type": "application/json" } });
      const found = await answer.json();
      if (!answer.ok) throw new Error(found.error || "The request was refused.");
      if (newest === now || newest.follows) newest.from = found.qpos;
      if (Math.max(...found.qpos.map((value, k) => Math.abs(value - before[k]))) < STILL) now.held = false;
      postMessage({ found, name: now.gesture.name, about: now.about });
    } catch (error) {
      postMessage({ error: error.message });
      now.held = false;
    }
  }
  asking = false;
  postMessage({ idle: newest ? newest.about : 0 });
}
