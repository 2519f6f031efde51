"""Feet that stand farther apart than the legs reach let go: the one behind leaves earlier.

A character that walks as fast as its actor, for its size, but on much shorter legs cannot keep
both feet where they stand for as long as the actor does. Frames at either end of a stance in
which its points are missed are given to the flights around it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from physretarget.contact.foot import Foot
from physretarget.contact.settings import ContactSettings
from physretarget.contact.stances import Footing
from physretarget.kinematics import runs

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


def within_reach(
    foot: Foot,
    points: Floats,
    under: Floats,
    place: Floats,
    time: Floats,
    settings: ContactSettings,
    *,
    late: bool,
) -> list[Footing]:
    """The stances of a foot, each cut down to its longest piece in which it is where it shall be.

    ``points`` (T, n, 3) where the foot's points came to be, ``under`` (T, m, 3) the rest of its
    underside; ``place`` (T, 3) x, y and heading of the motion, of which a shortened stance takes
    the mean anew. A stance of which less than ``shortest_stance`` s would be left is dropped.
    ``late``: only the ends of stances count.
    """
    miss = np.linalg.norm(points - foot.track.target, axis=-1)
    held = np.where(foot.track.planted, miss, 0.0).max(axis=1) < settings.missed
    sunk = (foot.track.undersides(foot.sole) - under)[..., 2].max(axis=1, initial=0.0)
    held &= sunk < settings.rolled
    if late:
        for footing in foot.footings:
            held[footing.first : (footing.first + footing.last + 1) // 2] = True
    kept: list[Footing] = []
    for footing in foot.footings:
        part = slice(footing.first, footing.last + 1)
        if held[part].all():
            kept.append(footing)
            continue
        pieces = runs(held[part])
        first, last = max(pieces, key=lambda p: p[1] - p[0], default=(0, -1))
        first, last = first + footing.first, last + footing.first
        if last < first or time[last] - time[first] < settings.shortest_stance:
            continue
        mean = place[first : last + 1].mean(axis=0)
        kept.append(replace(footing, first=first, last=last, place=mean, hop=True))
    return kept
