"""Where a stance is cut because the motion turns more than one heading can stand for.

A planted body has one heading. As long as the motion's own heading stays near it, what the
body carries can make up the difference: a swivel, or the hips. Beyond that the body has to be
lifted and set down anew: a turn of half a circle is two or three stances with small hops
between them, best where the actor itself steps.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physretarget.contact.settings import ContactSettings

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

EXCESS = 10.0
"""One radian beyond the limit costs as much as this many cuts."""
SPREAD = 0.5
"""Headings as far from their stance's as the limit cost as much as half a cut."""


def cuts(
    heading: Floats, time: Floats, limit: float, steps: Floats, settings: ContactSettings
) -> Ints:
    """Frames at which a stance is cut, in order; each is the first of a new piece.

    ``heading`` (F,) rad, continuous, and ``time`` (F,) s over the stance; ``limit`` rad, how
    far it may be from the mean of its piece; ``steps`` (n,) times at which the actor lifts or
    sets down a foot, where cuts are cheaper. As few cuts as keep the limit, and among those
    the ones whose pieces turn least: a shortest path over all places for cuts.
    """
    none = np.zeros(0, dtype=np.int64)
    if len(time) < 3 or time[-1] - time[0] < 2.0 * settings.min_piece:
        return none
    if np.abs(heading - heading.mean()).max() <= limit:
        return none
    step = (time[-1] - time[0]) / (len(time) - 1)
    grid = np.arange(0, len(time), max(round(settings.cut_grid / step), 1))
    grid = np.append(grid[grid < len(time) - 1], len(time) - 1)
    price = np.ones(len(grid))
    if len(steps):
        near = np.abs(time[grid][:, None] - steps).min(axis=1)
        price -= 0.4 * np.exp(-((near / 0.1) ** 2))
    return grid[_shortest(heading[grid], time[grid], limit, price, settings.min_piece)]


def _shortest(
    heading: Floats, time: Floats, limit: float, price: Floats, shortest: float
) -> list[int]:
    """Indices of the cuts on the cheapest path from the first index to the last."""
    count, whole = len(time), max(float(time[-1] - time[0]), 1e-9)
    sums = np.concatenate([[0.0], np.cumsum(heading)])
    squares = np.concatenate([[0.0], np.cumsum(heading * heading)])
    total = np.full(count, np.inf)
    total[0] = 0.0
    came_from = np.zeros(count, dtype=np.int64)
    for end in range(1, count):
        starts = np.arange(np.searchsorted(time, time[end] - shortest + 1e-9, side="right"))
        if not len(starts):
            continue
        size = end - starts + 1
        mean = (sums[end + 1] - sums[starts]) / size
        spread = np.maximum((squares[end + 1] - squares[starts]) / size - mean * mean, 0.0)
        piece = heading[end::-1]
        highest = np.maximum.accumulate(piece)[::-1][starts]
        lowest = np.minimum.accumulate(piece)[::-1][starts]
        beyond = np.maximum(np.maximum(highest - mean, mean - lowest) - limit, 0.0)
        share = (time[end] - time[starts]) / whole
        way = total[starts] + EXCESS * beyond + SPREAD * share * spread / limit**2
        came_from[end] = int(np.argmin(way))
        total[end] = way[came_from[end]] + price[end]
    path: list[int] = []
    at = int(came_from[-1])
    while at > 0:
        path.append(at)
        at = int(came_from[at])
    return path[::-1]
