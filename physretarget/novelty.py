"""Acting that no key pose shows: a mapper gives a pose for it too, and that pose is a guess.

A frame is as far from the key poses as its feature points are from those of the nearest one,
root mean square in metres, on the reference actor. A mapper passes through frames that are far
for a moment between two key poses; only what lasts is told.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget.kinematics import runs
from physretarget.mapping.kernels import squared_distances

__all__ = ["Novelty", "novelty"]

Array = NDArray[np.float64]

USUAL = 0.95
"""Share of the key poses whose nearest neighbours say what is near."""
SAME_ACTING, OTHER_POSTURE = 0.3, 0.5
"""Near and far whatever the key poses, m: people of 30 captures who walk, run, bow and wave are
0.1 to 0.27 m from key poses of others who do so, a deep squat is 0.5 m from standing."""
LASTING = 0.3
"""Seconds; within captures that key poses were taken from, a quarter of a second is the longest
that is farther from all of them."""
BLOCK = 4096
"""Frames compared at once: the table of all frames of a long capture would be large."""


@dataclass(frozen=True, kw_only=True)
class Novelty:
    """Which frames of a capture lie far from every key pose for longer than :data:`LASTING`.

    ``distance`` (T,) m to the nearest key pose, ``limit`` m beyond which that is far. ``spans``
    are the lasting ones, first and last frame of each; ``nearest`` names the key pose nearest to
    the farthest frame of them, ``step`` is the time between frames, s.
    """

    distance: Array
    limit: float
    spans: tuple[tuple[int, int], ...]
    nearest: str
    step: float

    @property
    def frames(self) -> int:
        """How many frames the spans hold."""
        return sum(last - first + 1 for first, last in self.spans)

    @property
    def worst(self) -> tuple[int, int] | None:
        """The span with the farthest frame."""
        return max(
            self.spans, key=lambda s: float(self.distance[s[0] : s[1] + 1].max()), default=None
        )

    @property
    def warning(self) -> str | None:
        """What to tell whoever wanted the clip; None where all is like some key pose."""
        if self.worst is None:
            return None
        first, last = self.worst
        share = self.frames / len(self.distance)
        away = float(self.distance[first : last + 1].max())
        return (
            f"{self.frames} of {len(self.distance)} frames ({share:.0%}) lie far from every key "
            f"pose, most of all from {first * self.step:.2f} to {last * self.step:.2f} s "
            f"({away:.2f} m off '{self.nearest}', the nearest; beyond {self.limit:.2f} m is far): "
            "the character's pose is a guess there. 'physretarget keyposes suggest' tells which "
            "frames to pose."
        )

    def summary(self) -> dict[str, object]:
        """The same in numbers, for a file."""
        return {
            "limit_m": round(self.limit, 4),
            "farthest_m": round(float(self.distance.max()), 4),
            "frames": self.frames,
            "spans_s": [[round(f * self.step, 4), round(t * self.step, 4)] for f, t in self.spans],
        }


def novelty(y: Array, posed: Array, names: Sequence[str], *, fps: float) -> Novelty:
    """Compare frames with key poses.

    Args:
        y: (T, DY) the actor's features, T > 0.
        posed: (N, DY) those of the key poses, N > 0, with their ``names``.
        fps: frames per second of ``y``.
    """
    distance, nearest = _to_nearest(y, posed)
    limit = _limit(posed)
    spans = tuple(
        (first, last)
        for first, last in runs(distance > limit)
        if (last + 1 - first) / fps > LASTING
    )
    inside = np.zeros(len(y), dtype=bool)
    for first, last in spans:
        inside[first : last + 1] = True
    farthest = int(np.argmax(np.where(inside, distance, -1.0)))
    return Novelty(
        distance=distance, limit=limit, spans=spans, nearest=names[nearest[farthest]], step=1 / fps
    )


def _limit(posed: Array) -> float:
    """As far from each other as key poses are, within what bodies allow."""
    if len(posed) < 2:
        return SAME_ACTING
    apart = _rms(squared_distances(posed, posed), posed.shape[1])
    np.fill_diagonal(apart, np.inf)
    usual = float(np.quantile(apart.min(axis=1), USUAL))
    return min(max(usual, SAME_ACTING), OTHER_POSTURE)


def _to_nearest(y: Array, posed: Array) -> tuple[Array, NDArray[np.intp]]:
    """Distance to the nearest key pose (T,), m, and which one it is (T,)."""
    distance, nearest = np.empty(len(y)), np.empty(len(y), dtype=np.intp)
    for first in range(0, len(y), BLOCK):
        rows = slice(first, first + BLOCK)
        squared = squared_distances(y[rows], posed)
        nearest[rows] = squared.argmin(axis=1)
        distance[rows] = _rms(squared.min(axis=1), y.shape[1])
    return distance, nearest


def _rms(squared: Array, width: int) -> Array:
    """Per point of three coordinates."""
    result: Array = np.sqrt(np.maximum(squared, 0.0) / (width / 3))
    return result
