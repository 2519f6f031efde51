"""Very many windows against very many templates by Viterbi at once (see hmm.py for the model).

The template is sampled at the capture's own rate and stretched to the window, so the even pace is
one frame per point; it begins on the window's first frame and ends on its last. A path is written
by how many frames each point is off the even alignment: that is 0 at both ends, falls by at most
one per point (time does not run backward), and every change of it costs ``haste`` per frame.

A path that strays by d frames pays at least 2 d haste, so a band is wide enough as soon as its
best path is cheaper than straying beyond it; ``lower_bound`` tells which pairs cannot be cheaper
than one that is known already.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array32 = NDArray[np.float32]
Feature = tuple[Array32, Array32, Array32]
"""Windows (R, m), shapes (S, m) and gains (R, 1) or (R, S): compared are windows, gain * shapes."""
_BAND = 1
_CHUNK = 4096  # pairs solved at once: what fits a processor's cache


@dataclass(frozen=True, eq=False)
class Pairs:
    """Which window meets which shape: rows (P,) and columns (P,) of the features."""

    features: list[Feature]
    weight: Array32
    rows: NDArray[np.intp]
    columns: NDArray[np.intp]

    def part(self, which: NDArray[np.intp]) -> Pairs:
        """Some of them."""
        return Pairs(self.features, self.weight, self.rows[which], self.columns[which])


def aligned(pairs: Pairs, haste: float, limit: Array32, *, widen: bool = True) -> Array32:
    """(P,) cost per frame of the cheapest path; exact wherever it is below limit (P,).

    Elsewhere it may be that of another path, which is never less. Windows have 3 frames or more.
    widen: follow paths however far they stray from the even pace, not by one frame at most.
    """
    m = pairs.weight.shape[1]
    if m < 3:
        raise ValueError("windows of less than three frames have one alignment only")
    cost = np.empty(len(pairs.rows), dtype=np.float32)
    todo = np.arange(len(cost))
    band = min(_BAND, m - 2)
    while len(todo):
        step = max(1, _CHUNK * 3 // (2 * band + 1))
        for first in range(0, len(todo), step):
            some = todo[first : first + step]
            cost[some] = _banded(pairs.part(some), haste, band)
        if band == m - 2 or not widen:
            break
        wider = np.float32(2.0 * haste * (band + 1) / m)  # what straying further costs at least
        todo = todo[(cost[todo] > wider) & (limit[todo] > wider)]
        band = min(2 * band, m - 2)
    return cost


def _banded(pairs: Pairs, haste: float, band: int) -> Array32:
    """(P,) cheapest paths that are never further than band frames off the even alignment."""
    weight = np.ascontiguousarray(pairs.weight[pairs.rows].T)
    m, count = weight.shape
    sides = []
    for target, shapes, gain in pairs.features:
        factor = gain[pairs.rows, 0 if gain.shape[1] == 1 else pairs.columns]
        chain = np.multiply(shapes[pairs.columns].T, factor, order="C")
        frames = np.full((m + 2 * band, count), np.float32(1e9))  # frames outside cost too much
        frames[band : band + m] = target[pairs.rows].T
        sides.append((chain, frames))
    pace = np.float32(haste)
    width = 2 * band + 1
    best = np.full((width, count), np.inf, dtype=np.float32)
    best[band] = 0.0
    emission, part = np.empty((2, width, count), dtype=np.float32)
    for i in range(m):
        if i:
            before = best.copy()
            for d in range(1, width):
                np.minimum(best[d], best[d - 1] + pace, out=best[d])
            np.minimum(best[:-1], before[1:] + pace, out=best[:-1])
        emission[:] = 0.0
        for chain, frames in sides:
            np.subtract(frames[i : i + width], chain[i], out=part)
            part *= part
            emission += part
        emission *= weight[i]
        best += emission
    result: Array32 = best[band] / np.float32(m)
    return result


@dataclass(frozen=True, eq=False)
class Slack:
    """By how much warping can move a capture's features: the key to bounds from below.

    moved (D, C, M + 1): running sums over frames of weight times the largest squared distance
    between a frame's features and those of a frame at most d = 1 … D frames away.
    """

    moved: NDArray[np.float64]

    @classmethod
    def of(cls, features: list[Array32], weight: Array32, reach: int = 2) -> Slack:
        """Features and weights (C, M) of whole channels."""
        channels, frames = weight.shape
        furthest = np.zeros((channels, frames))
        sums = np.zeros((reach, channels, frames + 1))
        for d in range(1, reach + 1):
            if d < frames:
                apart = np.zeros((channels, frames - d))
                for one in features:
                    apart += (one[:, d:] - one[:, :-d]) ** 2
                np.maximum(furthest[:, d:], apart, out=furthest[:, d:])
                np.maximum(furthest[:, :-d], apart, out=furthest[:, :-d])
            np.cumsum(furthest * weight, axis=1, out=sums[d - 1, :, 1:])
        return cls(sums)

    def windows(self, n: int) -> NDArray[np.float64]:
        """(D, C, M - n) root mean square per frame over windows of n + 1 frames."""
        inner = self.moved[:, :, n:-1] - self.moved[:, :, 1:-n]  # both ends stay where they are
        total: NDArray[np.float64] = np.sqrt(np.maximum(inner, 0.0) / (n + 1))
        return total


def lower_bound(
    even: Array32, slack: Array32, haste: float, m: int, *, wide: bool = True
) -> Array32:
    """What the cheapest path costs at least, given the cost of the even alignment (both per frame).

    slack (D, …) broadcasts against even. A path that strays by at most d frames changes the
    distance of the features by at most slack[d - 1] (triangle inequality) and, to stray at all,
    pays 2 d haste; one that strays further than D frames, where paths may (wide), 2 (D + 1) haste.
    """
    far = np.sqrt(even) * np.float32(1.0 - 1e-5)  # rounding must not lift the bound
    further = 2.0 * haste * (len(slack) + 1) / m if wide else np.inf
    bound = np.minimum(even, np.float32(further))
    for d, room in enumerate(slack, 1):
        left = np.maximum(far - room, 0.0)
        np.minimum(bound, left * left + np.float32(2.0 * haste * d / m), out=bound)
    return bound
