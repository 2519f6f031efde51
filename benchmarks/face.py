"""Facial matching: time per matcher, and the distance and Viterbi kernels beside naive twins.

Run: OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python -m benchmarks.face
stumpy's row appears where it is installed.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.row import Row, best_of, markdown
from physretarget.face.curve import Curve
from physretarget.face.distance import distance_profile
from physretarget.face.formats import read_take
from physretarget.face.hmm import viterbi
from physretarget.face.job import prepare
from physretarget.face.library import Library
from physretarget.face.match import Banks, MatchSettings, match
from physretarget.face.rig import Rig, RigChannel
from physretarget.face.shot import Shot, Take
from physretarget.face.sides import alike, partners
from physretarget.options.facial import METHODS

FPS = 30.0
CHANNELS = tuple(f"c{i:02d}" for i in range(54))
GROUPS = ("brows", "lids", "gaze", "head")
RIG = Rig(
    "bench",
    tuple(RigChannel(c, GROUPS[i % 4], -2.0, 2.0, {c: 1.0}) for i, c in enumerate(CHANNELS)),
)

WAYS = {"default": MatchSettings()} | {
    f"ruhland2017 {m}": MatchSettings(preset="ruhland2017", method=m) for m in METHODS
}


def animation(seconds: float, rng: np.random.Generator, name: str) -> Shot:
    """Eased random poses, a key every 0.2 to 0.8 s, on every channel."""
    curves = {}
    for channel in CHANNELS:
        time_of = np.cumsum(rng.uniform(0.2, 0.8, int(seconds / 0.5)))
        values = rng.uniform(-1, 1, len(time_of)) * (rng.uniform(size=len(time_of)) < 0.7)
        curves[channel] = Curve.through(time_of, values, "auto" if rng.uniform() < 0.5 else "flat")
    return Shot(name, curves, FPS)


def capture(seconds: float, rng: np.random.Generator) -> Take:
    shot = animation(seconds + 2, rng, "take")
    times = np.arange(int(seconds * FPS)) / FPS
    columns = [
        c.evaluate(times + 1) + rng.normal(0, 0.02, len(times)) for c in shot.curves.values()
    ]
    return Take("take", times, CHANNELS, np.stack(columns, axis=1))


def naive_profile(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    n = len(q)
    centred = q - q[0]
    return np.array([np.sum((centred - (p[r : r + n] - p[r])) ** 2) for r in range(len(p) - n + 1)])


def naive_viterbi(cost: np.ndarray, beta: float) -> float:
    n, m = cost.shape
    pace = (m - 1) / (n - 1)
    best = np.full(m, np.inf)
    best[0] = cost[0, 0]
    for i in range(1, n):
        fresh = np.full(m, np.inf)
        for k in range(m):
            for j in range(k + 1):
                fresh[k] = min(fresh[k], best[j] + beta * abs(k - j - pace))
        best = fresh + cost[i]
    return float(best.min())


def _matchers() -> list[Row]:
    rng = np.random.default_rng(0)
    library = Library.of([animation(60, rng, "one minute")])
    take = capture(4, rng)
    rows = []
    for way in WAYS:
        banks = Banks()
        settings = WAYS[way]
        began = time.process_time()
        match(take, library, RIG, settings, banks=banks)
        cold = time.process_time() - began
        spent = best_of(3, lambda s=settings, b=banks: match(take, library, RIG, s, banks=b))
        note = f"first call {cold:.2f} s"
        rows.append(
            Row(
                name=f"{way}: 54 channels x 4 s, 60 s library",
                value=spent,
                unit="s",
                aim=0.5,
                note=note,
            )
        )
    return rows


def _long() -> list[Row]:
    rng = np.random.default_rng(1)
    library = Library.of([animation(60, rng, f"minute {k}") for k in range(60)])
    take = capture(120, rng)
    return [_timed("54 channels x 120 s, 60 min library", way, take, library, RIG)
            for way in WAYS]  # fmt: skip


def _timed(what: str, way: str, take: Take, library: Library, rig: Rig) -> Row:
    settings = replace(WAYS[way], lips=True)
    began = time.process_time()
    match(take, library, rig, settings)
    spent = time.process_time() - began
    return Row(name=f"{way}: {what}", value=spent, unit="s", aim=60)


def _real() -> list[Row]:
    """A real take of two minutes and all hand-made curves, varied until they last an hour."""
    data = Path(os.environ.get("PHYSRETARGET_DATA", "../shared/data"))
    takes = sorted((data / "face").glob("livelink*.csv"))
    if not takes or not (data / "keys").is_dir():
        return []
    rng = np.random.default_rng(2)
    own = Library.build([data / "keys"]).examples
    examples, seconds = list(own), Library(own).seconds
    copies = int(np.ceil(3600.0 / seconds))
    for k in range(1, copies):
        examples += [replace(e, shot=f"{e.shot} #{k}", curve=varied(e.curve, rng)) for e in own]
    library = Library(tuple(examples))
    take = read_take(takes[0], fps=FPS).between(0.0, 120.0)
    take = replace(take, channels=take.channels[:54], values=take.values[:, :54])
    what = f"54 real channels x {take.time[-1]:.0f} s, {library.seconds / 60:.0f} min of real keys"
    return [_timed(f"{what}, varied", m, take, library, Rig.of(take)) for m in WAYS]


def _hour() -> list[Row]:
    """Gigabytes that matching an hour takes, in a process of its own so that its peak is known."""
    data = Path(os.environ.get("PHYSRETARGET_DATA", "../shared/data"))
    if not sorted((data / "face").glob("*.csv")) or not (data / "keys" / "noto").is_dir():
        return []
    code = f"from benchmarks.face import hour; hour({str(data)!r})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    peak, spent, channels = json.loads(done.stdout)
    note = f"54 captured channels, {channels} without lips; {spent:.0f} s"
    return [Row(name="an hour at 60 Hz, peak memory", value=peak, unit="GB", aim=1.5, note=note)]


def hour(data: str, minutes: int = 60) -> None:
    """Match all real takes, there and back again until the time is full; print what it took."""
    takes = [read_take(path, fps=60.0) for path in sorted(Path(data, "face").glob("*.csv"))]
    names = tuple(c for c in takes[0].channels if all(c in t.channels for t in takes))[:54]
    ways = [np.stack([t.channel(c) for c in names], axis=1) for t in takes]
    ways += [way[::-1] for way in ways]
    frames, once = 60 * 60 * minutes, np.concatenate(ways)
    values = np.tile(once, (-(-frames // len(once)), 1))[:frames]
    take = Take("hour", np.arange(frames) / 60.0, names, values)
    library = Library.build([Path(data, "keys", "noto")])
    began = time.process_time()
    result = match(take, library, Rig.of(take))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20  # KiB on Linux
    print(json.dumps([peak, time.process_time() - began, len(result.channels)]))


def varied(curve: Curve, rng: np.random.Generator) -> Curve:
    """The same keys at slightly other spans, values and handle lengths."""
    table = curve.table.copy()
    span = np.diff(table[:, 0]) * rng.uniform(0.8, 1.25, len(table) - 1)
    table[1:, 0] = table[0, 0] + np.cumsum(span)
    table[:, 1] += rng.normal(0.0, 0.1 * np.ptp(table[:, 1]), len(table))
    table[:, 2:] *= rng.uniform(0.8, 1.0, (len(table), 1))
    return Curve.from_table(table)


STRETCHES = {"livelink_rom_4": (20.0, 24.0), "neurosync_slate164": (2.0, 5.0)}  # s


def _sides() -> list[Row]:
    """Keys of one side that the other has on the same frame, where both move alike; and without.

    Without: the same take under names that tell no side.
    """
    data = Path(os.environ.get("PHYSRETARGET_DATA", "../shared/data")) / "face"
    library = Library.of([animation(4, np.random.default_rng(3), "any")])
    rows = []
    for name, span in STRETCHES.items():
        path = data / f"{name}.csv"
        if path.is_file():
            take = read_take(path).between(*span)
            shares = [_shared(take, library, plain) for plain in (False, True)]
            what = f"keys of two sides on one frame, {name}, {span[0]:g} to {span[1]:g} s"
            rows.append(
                Row(
                    name=what, value=100 * shares[0], unit="%", aim=90, higher=True,
                    rival="each side by itself", rival_value=100 * shares[1],
                )
            )  # fmt: skip
    return rows


def _shared(take: Take, library: Library, plain: bool) -> float:
    rig = Rig.of(take)
    wanted = rig.matched()
    named = {c.name: f"c{k:02d}" if plain else c.name for k, c in enumerate(wanted)}
    channels = tuple(replace(c, name=named[c.name]) for c in wanted)
    settings = MatchSettings(learned=False)
    found = match(take, library, Rig("sides", channels), settings).channels
    names = [c.name for c in wanted]
    job = prepare(rig.drive(take), wanted, {})
    least = np.maximum(job.level, settings.fidelity)
    hits = keys = 0
    for left, rights in partners(names):
        flags = [alike(job.smooth[left], job.smooth[r], (least[left], least[r]), take.fps)
                 for r in rights]  # fmt: skip
        best = max(range(len(rights)), key=lambda k: int(flags[k].sum()))
        pair = [found[named[names[r]]].curve.time for r in (left, rights[best])]
        frames = [np.round((t - take.time[0]) * take.fps).astype(int) for t in pair]
        for own, other in (frames, frames[::-1]):
            inner = [f for f in own.tolist() if 0 < f < len(take.time) - 1 and flags[best][f]]
            keys += len(inner)
            hits += len(set(inner) & set(other.tolist()))
    return hits / max(1, keys)


def _kernels() -> list[Row]:
    rng = np.random.default_rng(2)
    p, q = rng.normal(size=7200).cumsum(), rng.normal(size=120).cumsum()
    ours = best_of(5, lambda: distance_profile(p, q))
    naive = best_of(2, lambda: naive_profile(p, q))
    rows = [
        Row(
            name="distances of a 120-frame segment in 7200 frames",
            value=1e3 * ours,
            unit="ms",
            rival="naive windows",
            rival_value=1e3 * naive,
        )
    ]
    try:
        import stumpy
    except ImportError:
        pass
    else:
        stumpy.mass(q, p, normalize=False)
        theirs = best_of(5, lambda: stumpy.mass(q, p, normalize=False))
        rows.append(
            Row(
                name="the same",
                value=1e3 * ours,
                unit="ms",
                rival="stumpy.mass (not centred)",
                rival_value=1e3 * theirs,
            )
        )
    cost = rng.uniform(size=(40, 120))
    fast = best_of(5, lambda: viterbi(cost[None], 0.1))
    slow = best_of(1, lambda: naive_viterbi(cost, 0.1))
    rows.append(
        Row(
            name="Viterbi, 40 points on 120 frames",
            value=1e3 * fast,
            unit="ms",
            rival="naive Python",
            rival_value=1e3 * slow,
        )
    )
    return rows


def run() -> list[Row]:
    """Every row."""
    return [*_matchers(), *_long(), *_real(), *_hour(), *_sides(), *_kernels()]


if __name__ == "__main__":
    print(markdown(run()))
