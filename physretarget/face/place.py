"""Which segments go where: the paper's greedy placement and an optimal one.

The optimal placement is a shortest path through the frames: an edge from frame i to frame j is a
segment laid over [i, j]; its price is its misfit plus a price per key. It finds the cheapest cover
of the take, where the greedy one claims the longest acceptable match first.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Placed:
    """Template number ``template`` (-1: none) over frames first to last; kind of its table."""

    first: int
    last: int
    template: int
    phrase: bool = False
    fitted: bool = False


def lengths(frames: int, fps: float, longest: float) -> NDArray[np.intp]:
    """Window lengths (in intervals) that are tried: every one up to a second, then by 4 %."""
    top = min(frames - 1, max(2, round(longest * fps)))
    dense = list(range(min(2, top), min(top, max(8, round(fps))) + 1))
    while dense[-1] < top:
        dense.append(min(top, max(dense[-1] + 1, round(dense[-1] * 1.04))))
    return np.array(dense, dtype=np.intp)


@dataclass(frozen=True, eq=False)
class Reached:
    """The cheapest chain to every frame, taken up where an earlier stretch of frames ended.

    best (C, m): price of the cheapest chain from the take's first frame to each of the m frames of
    a stretch. taken (C, m): number of the length of its last window.
    """

    best: Array
    taken: NDArray[np.int16]

    @classmethod
    def through(
        cls, cost: NDArray[np.float32], spans: NDArray[np.intp], before: Array | None = None
    ) -> Reached:
        """For prices as shortest_path's; before (C, k): best of the stretch's first k frames.

        None: the stretch begins the take. Windows that begin ahead of the stretch are not known:
        k must exceed the longest length.
        """
        channels, frames, _ = cost.shape
        start = np.zeros((channels, 1)) if before is None else before
        known = start.shape[1]
        best = np.full((channels, frames), np.inf)
        best[:, :known] = start
        taken = np.zeros((channels, frames), dtype=np.int16)
        for j in range(known, frames):
            usable = int(np.searchsorted(spans, j, side="right"))
            if not usable:
                continue
            total = best[:, j - spans[:usable]] + cost[:, j, :usable]
            pick = np.argmin(total, axis=1)
            taken[:, j] = pick
            best[:, j] = np.take_along_axis(total, pick[:, None], axis=1)[:, 0]
        return cls(best, taken)


def trace(taken: NDArray[np.int16], spans: NDArray[np.intp]) -> list[list[tuple[int, int]]]:
    """Per channel the edges (end frame, l) to the last frame, in order of time."""
    paths = []
    for row in taken:
        edges = []
        j = len(row) - 1
        while j > 0:
            edges.append((j, int(row[j])))
            j -= int(spans[row[j]])
        paths.append(edges[::-1])
    return paths


def shortest_path(
    cost: NDArray[np.float32], spans: NDArray[np.intp]
) -> list[list[tuple[int, int]]]:
    """Cheapest chains from the first to the last frame, for all channels at once.

    Args:
        cost: (C, M, L) price of the edge that ends at frame j with length spans[l].
        spans: (L,) ascending lengths.

    Returns:
        Per channel the edges (end frame, l) in order of time.
    """
    return trace(Reached.through(cost, spans).taken, spans)


def cheapest_through(cost: NDArray[np.float32], spans: NDArray[np.intp]) -> NDArray[np.float32]:
    """(C, M, L) price of the cheapest chain that holds the edge, for prices as shortest_path's."""
    channels, frames, _ = cost.shape
    ahead = np.full((channels, frames), np.inf, dtype=np.float32)
    behind = ahead.copy()
    ahead[:, 0] = behind[:, -1] = 0.0
    for j in range(1, frames):
        usable = int(np.searchsorted(spans, j, side="right"))
        if not usable:
            continue
        ahead[:, j] = (ahead[:, j - spans[:usable]] + cost[:, j, :usable]).min(axis=1)
        i = frames - 1 - j
        ends = i + spans[:usable]
        behind[:, i] = (behind[:, ends] + cost[:, ends, np.arange(usable)]).min(axis=1)
    through = cost + behind[:, :, None]
    for index, n in enumerate(spans):
        through[:, n:, index] += ahead[:, : frames - n]
        through[:, :n, index] = np.inf
    return through


def cut_shares(
    cost: NDArray[np.float32],
    spans: NDArray[np.intp],
    temperature: float,
    before: Array | None = None,
) -> tuple[Array, Array]:
    """Per frame the share of all chains with a cut there, and the logarithm of their sum up to it.

    Of chains weighted by their price over ``temperature``: the sum over what shortest_path takes
    the best of, by the forward and backward recursions of hidden Markov models.

    before (C, k): that logarithm for the first k frames, where a stretch of a take is asked for (as
    in ``Reached.through``); shares are then of the chains with a cut at the stretch's last frame.
    """
    channels, frames, _ = cost.shape
    scale = np.float32(temperature)
    ahead = np.full((channels, frames), -np.inf)
    behind = np.full((channels, frames), -np.inf)
    start = np.zeros((channels, 1)) if before is None else before
    known = start.shape[1]
    ahead[:, :known] = start
    behind[:, -1] = 0.0
    for j in range(1, frames):
        usable = int(np.searchsorted(spans, j, side="right"))
        if j >= known:
            gain = -cost[:, j, :usable] / scale
            ahead[:, j] = _log_sum(ahead[:, j - spans[:usable]] + gain)
        i = frames - 1 - j
        ends = i + spans[:usable]
        gain = -cost[:, ends, np.arange(usable)] / scale
        behind[:, i] = _log_sum(behind[:, ends] + gain)
    return np.exp(np.minimum(ahead + behind - ahead[:, -1:], 0.0)), ahead


def near(cuts: Array, reach: int) -> Array:
    """(C, M) shares summed over ``reach`` frames to both sides."""
    frames = cuts.shape[1]
    padded = np.pad(cuts, ((0, 0), (reach, reach)))
    total = np.sum([padded[:, k : k + frames] for k in range(2 * reach + 1)], axis=0)
    return np.asarray(np.minimum(total, 1.0), dtype=np.float64)


def _log_sum(rows: Array) -> Array:
    if not rows.shape[1]:
        return np.full(len(rows), -np.inf)
    top = rows.max(axis=1)
    safe = np.where(np.isfinite(top), top, 0.0)
    with np.errstate(divide="ignore"):
        total: Array = np.log(np.exp(rows - safe[:, None]).sum(axis=1)) + safe
    return total
