"""Where a stance is cut because the motion turns or goes farther than one place can stand for.

A planted body has one heading. As long as the motion's own heading stays near it, what the
body carries can make up the difference: a swivel, or the hips. Beyond that the body has to be
lifted and set down anew: a turn of half a circle is two or three stances with small hops
between them, best where the actor itself steps. A foot on a leg is also set down anew where the
motion has it beyond the leg's reach for longer than a step takes.
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

ALONE = 0.5
"""A cut while all other feet are up costs as much as this many more."""
OUT_OF_REACH = 2.5
"""Out of reach for as long as the shortest piece lasts costs as much as this many cuts."""


def cuts(
    heading: Floats,
    time: Floats,
    limit: float,
    steps: Floats,
    settings: ContactSettings,
    *,
    off: Floats | None = None,
    up: Floats | None = None,
) -> Ints:
    """Frames at which a stance is cut, in order; each is the first of a new piece.

    ``heading`` (F,) rad, continuous, and ``time`` (F,) s over the stance; ``limit`` rad, how
    far it may be from the mean of its piece; ``steps`` (n,) times at which the actor lifts or
    sets down a foot, where cuts are cheaper; ``off`` (F, 2) where the motion has the foot, over its
    reach, nothing if None; ``up`` (F,) the share of the other feet that do not stand: feet that
    are set down anew take turns. As few cuts as keep the limit, and among those the ones whose
    pieces turn least: a shortest path over all places for cuts.
    """
    none = np.zeros(0, dtype=np.int64)
    if len(time) < 3 or time[-1] - time[0] < 2.0 * settings.min_piece:
        return none
    off = np.zeros((len(time), 2)) if off is None else off
    within = np.linalg.norm(off - off.mean(axis=0), axis=1).max() <= 1.0
    if within and np.abs(heading - heading.mean()).max() <= limit:
        return none
    step = (time[-1] - time[0]) / (len(time) - 1)
    grid = np.arange(0, len(time), max(round(settings.cut_grid / step), 1))
    grid = np.append(grid[grid < len(time) - 1], len(time) - 1)
    price = np.ones(len(grid))
    if len(steps):
        near = np.abs(time[grid][:, None] - steps).min(axis=1)
        price -= 0.4 * np.exp(-((near / 0.1) ** 2))
    if up is not None:
        price += ALONE * up[grid]
    return grid[_shortest(heading[grid], off[grid], time[grid], limit, price, settings.min_piece)]


def _shortest(
    heading: Floats, off: Floats, time: Floats, limit: float, price: Floats, shortest: float
) -> list[int]:
    """Indices of the cuts on the cheapest path from the first index to the last."""
    count, whole = len(time), max(float(time[-1] - time[0]), 1e-9)
    sums = np.concatenate([[0.0], np.cumsum(heading)])
    squares = np.concatenate([[0.0], np.cumsum(heading * heading)])
    places = np.concatenate([np.zeros((1, 2)), np.cumsum(off, axis=0)])
    distances = np.concatenate([[0.0], np.cumsum(np.sum(off * off, axis=1))])
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
        centre = (places[end + 1] - places[starts]) / size[:, None]
        variance = (distances[end + 1] - distances[starts]) / size - np.sum(centre**2, axis=1)
        # Of an even sweep ±D over the place, whose variance is D²/3, the share 1 - 1/D is out of
        # reach.
        sweep = np.sqrt(3.0 * np.maximum(variance, 0.0))
        lost = (
            (1.0 - 1.0 / np.maximum(sweep, 1.0))
            * (time[end] - time[starts])
            / shortest
            * OUT_OF_REACH
        )
        share = (time[end] - time[starts]) / whole
        way = total[starts] + EXCESS * beyond + SPREAD * share * spread / limit**2 + lost
        came_from[end] = int(np.argmin(way))
        total[end] = way[came_from[end]] + price[end]
    path: list[int] = []
    at = int(came_from[-1])
    while at > 0:
        path.append(at)
        at = int(came_from[at])
    return path[::-1]
