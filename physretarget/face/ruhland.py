"""Ruhland, Prasad and McDonnell (2017) as written: segments of past curves claim their places.

The dictionary is every curve, halved again and again; the longest segment looks for its place
first, as it is and, after Keogh, with its middle stretched between the places of its first and
last quarter; the best place below the threshold is claimed, and so on. Three measures decide which
place is best: distance, SAX, or a hidden Markov model solved by Viterbi. What nobody claims is
deleted and becomes one span.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from physretarget.face.curve import Curve
from physretarget.face.places import by_alignment, by_distance, by_words, plain_place
from physretarget.face.segments import EXACT, Claim, Entry, PaperSettings

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def claims(
    values: Array,
    entries: Sequence[Entry],
    unit: float,
    settings: PaperSettings,
    taken: Sequence[int] = (),
) -> list[Claim]:
    """Greedy placement on one channel (M,), in order of time; claims share end frames at most.

    What the capture is to within ``EXACT`` comes first ("a distance of zero describes identical
    segments"), or a longer segment that fits by stretching would take its place.

    taken: frames of locked keys, which no segment covers.
    """
    free = np.ones(len(values), dtype=np.bool_)
    free[list(taken)] = False
    placed: list[Claim] = []

    def claim(found: Claim) -> None:
        placed.append(found)
        free[found.first + 1 : found.last] = False

    for exact in _identical(values, entries, free, unit):
        claim(exact)
    spread = max(float(values.std()), 1e-9)
    for entry in entries if settings.threshold > EXACT else ():
        while free[1:-1].any():
            found = _best(values, entry, free, unit, spread, settings)
            if found is None:
                break
            claim(found)
    return sorted(placed, key=lambda c: c.first)


def _identical(
    values: Array, entries: Sequence[Entry], free: Flags, unit: float
) -> Iterator[Claim]:
    """Places where a segment is the capture; of one length the closest first. Rests are not."""
    for _, group in groupby(entries, key=lambda e: e.last):
        members = [e for e in group if np.ptp(e.samples) > 10 * EXACT * unit]
        while True:
            options = [c for e in members if (c := plain_place(values, e, free, unit)) is not None]
            best = min(options, key=lambda c: c.error, default=None)
            if best is None or best.error > EXACT:
                break
            yield best


def _best(
    values: Array, entry: Entry, free: Flags, unit: float, spread: float, settings: PaperSettings
) -> Claim | None:
    find = {"distance": by_distance, "sax": by_words, "hmm": by_alignment}[settings.method]
    found = find(values, entry, free, unit, spread, settings)
    return found if found is not None and found.error <= settings.threshold else None


def warp(claim: Claim, values: Array, slope: Array, unit: float) -> Array:
    """The claim's keys with end values and end slopes of the capture (the paper's "Curve Warping").

    The cubic Hermite of the end errors is added to values and slopes. A segment that is the capture
    itself has none, and stays as its animator made it.

    Args:
        claim: keys in frames.
        values: (M,) capture without noise.
        slope: (M,) its slope per frame.
        unit: what the channel moves.
    """
    if claim.error < EXACT:
        return claim.table
    table = claim.table.copy()
    curve = Curve.from_table(table)
    ends = np.array([claim.first, claim.last], dtype=np.float64)
    width = ends[1] - ends[0]
    missing = values[[claim.first, claim.last]] - curve.evaluate(ends)
    out, into = table[0, 4:6], table[-1, 2:4]
    own = np.array([v[1] / v[0] if abs(v[0]) > 1e-9 else 0.0 for v in (out, into)])
    bend = (slope[[claim.first, claim.last]] - own) * width
    u = np.clip((table[:, 0] - ends[0]) / width, 0.0, 1.0)
    a, b = missing
    value = a * (1 - 3 * u**2 + 2 * u**3) + b * (3 * u**2 - 2 * u**3)
    value += bend[0] * (u - 2 * u**2 + u**3) + bend[1] * (u**3 - u**2)
    rate = (b - a) * (6 * u - 6 * u**2) + bend[0] * (1 - 4 * u + 3 * u**2)
    rate = (rate + bend[1] * (3 * u**2 - 2 * u)) / width
    table[:, 1] += value
    table[:, 3] += rate * table[:, 2]
    table[:, 5] += rate * table[:, 4]
    return table
