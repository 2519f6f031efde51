"""The strongest test that needs no pairing: are an unseen animator's keys found again?

Shots are held out of the library, with every copy of their curves in other shots; their curves
become pseudo-captures (noise, time jitter); each is matched and compared with the keys that the
animator set, side by side with plain reducers at the same number of keys.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget.face.curve import Curve
from physretarget.face.library import Example, Library
from physretarget.face.match import Banks, MatchSettings, match
from physretarget.face.measure import key_f1, pseudo_capture
from physretarget.face.reduce import decimate, schneider
from physretarget.face.rig import Rig, RigChannel
from physretarget.face.shot import Take

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Recovery:
    """Means over curves: F1 of keys, error to the clean curve (of its range), keys per curve."""

    name: str
    curves: int
    f1: float
    precision: float
    recall: float
    error: float
    keys: float


def signature(example: Example) -> tuple[object, ...]:
    """The same for copies of a curve: key times (to 1/60 s) and normalised values."""
    table = example.curve.table
    times = np.round((table[:, 0] - table[0, 0]) * 60).astype(int)
    extent = max(float(np.ptp(table[:, 1])), 1e-9)
    values = np.round((table[:, 1] - table[0, 1]) / extent, 2) + 0.0
    return (tuple(times.tolist()), tuple(values.tolist()))


def hold_out(
    library: Library, shots: Sequence[str], *, least_keys: int = 4, least_seconds: float = 0.5
) -> tuple[Library, tuple[Example, ...]]:
    """The library without these shots and without copies of their curves; and those curves, once.

    Curves with held (stepped) keys, too few keys or too short are not asked for.
    """
    outside = set(shots)
    taboo = {signature(e) for e in library.examples if e.shot in outside}
    rest = library.without(lambda e: e.shot in outside or signature(e) in taboo)
    asked: dict[tuple[object, ...], Example] = {}
    for example in library.examples:
        keys = example.curve.keys
        smooth = not any(k.out_type.startswith("stepped") for k in keys[:-1])
        long = example.curve.end - example.curve.start >= least_seconds
        if example.shot in outside and len(keys) >= least_keys and smooth and long:
            asked.setdefault(signature(example), example)
    return rest, tuple(asked.values())


def recover(
    library: Library,
    examples: Sequence[Example],
    settings: MatchSettings,
    *,
    fps: float = 60.0,
    noise: float = 0.01,
    jitter: float = 1.0,
    tolerance: float = 1.0,
    seed: int = 0,
) -> tuple[Recovery, Recovery, Recovery]:
    """Matcher, decimation and Schneider's fit at the matcher's number of keys, curve by curve."""
    banks: Banks = {}
    rows: dict[str, list[list[float]]] = {settings.method: [], "decimate": [], "schneider": []}
    rng = np.random.default_rng(seed)
    for example in examples:
        clean, noisy = pseudo_capture(example.curve, fps, rng, noise=noise, jitter=jitter)
        true = (example.curve.time - example.curve.start) * fps
        take = Take(example.channel, np.arange(len(noisy)) / fps, ("x",), noisy[:, None])
        low, high = float(noisy.min()), float(noisy.max())
        channel = RigChannel("x", "other", low, high, {"x": 1.0})
        result = match(take, library, Rig("one", (channel,)), settings, banks=banks)
        curve = result.channels["x"].curve
        count = len(curve.keys)
        found = {
            settings.method: curve,
            "decimate": decimate(noisy, fps, keys=count),
            "schneider": schneider(noisy, fps, keys=count),
        }
        for name, output in found.items():
            rows[name].append(_scores(output, true, clean, take.time, fps, tolerance))
    first, second, third = (_mean(name, row) for name, row in rows.items())
    return first, second, third


def _scores(
    curve: Curve, true: Array, clean: Array, time: Array, fps: float, tolerance: float
) -> list[float]:
    f1, precision, recall = key_f1(curve.time * fps, true, tolerance)
    deviation = float(np.sqrt(np.mean((curve.evaluate(time) - clean) ** 2)))
    return [f1, precision, recall, deviation / max(float(np.ptp(clean)), 1e-12), len(curve.keys)]


def _mean(name: str, rows: list[list[float]]) -> Recovery:
    table = np.array(rows) if rows else np.full((1, 5), np.nan)
    return Recovery(name, len(rows), *(float(v) for v in table.mean(axis=0)))
