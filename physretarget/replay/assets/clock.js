// The clock of the browser's player: twin of physretarget/replay/clock.py, no page needed.
"use strict";
var physretarget = globalThis.physretarget || (globalThis.physretarget = {});

physretarget.Clock = class Clock {
  /** @param {ArrayLike<number>} time frame times in s, strictly increasing */
  constructor(time) {
    this.time = time;
    this.frames = time.length;
    this.start = time[0];
    this.end = time[time.length - 1];
    this.duration = this.end - this.start;
  }

  /** The frame on screen at a time: the last one that has begun, clamped to the clip. */
  frameAt(seconds) {
    let low = 0, high = this.frames; // first frame later than the time
    const when = seconds + 1e-9;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.time[middle] <= when) low = middle + 1; else high = middle;
    }
    return Math.max(low - 1, 0);
  }

  /** [frame, fraction of the way to the next one in [0, 1)]. */
  between(seconds) {
    const frame = this.frameAt(seconds);
    if (frame >= this.frames - 1 || seconds <= this.time[frame]) return [frame, 0];
    return [frame, (seconds - this.time[frame]) / (this.time[frame + 1] - this.time[frame])];
  }

  /** Time after `elapsed` s of wall clock at a speed; wraps round or stops at the ends. */
  advance(seconds, elapsed, { speed, loop }) {
    const moved = seconds + elapsed * speed;
    if (this.start <= moved && moved <= this.end) return moved;
    if (loop && this.duration > 0) {
      const past = (moved - this.start) % this.duration;
      return this.start + (past < 0 ? past + this.duration : past);
    }
    return Math.min(Math.max(moved, this.start), this.end);
  }
};
