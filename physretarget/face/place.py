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
    channels, frames, _ = cost.shape
    best = np.full((channels, frames), np.inf)
    best[:, 0] = 0.0
    taken = np.zeros((channels, frames), dtype=np.intp)
    for j in range(1, frames):
        usable = int(np.searchsorted(spans, j, side="right"))
        if not usable:
            continue
        total = best[:, j - spans[:usable]] + cost[:, j, :usable]
        taken[:, j] = np.argmin(total, axis=1)
        best[:, j] = np.take_along_axis(total, taken[:, j : j + 1], axis=1)[:, 0]
    paths = []
    for c in range(channels):
        edges = []
        j = frames - 1
        while j > 0:
            edges.append((j, int(taken[c, j])))
            j -= int(spans[taken[c, j]])
        paths.append(edges[::-1])
    return paths


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


def cut_confidence(
    cost: NDArray[np.float32], spans: NDArray[np.intp], temperature: float, reach: int = 1
) -> Array:
    """(C, M) share of all chains, each weighed by exp(-price / temperature), with a cut near.

    A cut is near if within ``reach`` frames: the sum over chains of what shortest_path takes the
    best of, by the forward and backward recursions of hidden Markov models.
    """
    channels, frames, _ = cost.shape
    gain = -cost / np.float32(temperature)
    ahead = np.full((channels, frames), -np.inf)
    behind = np.full((channels, frames), -np.inf)
    ahead[:, 0] = behind[:, -1] = 0.0
    for j in range(1, frames):
        usable = int(np.searchsorted(spans, j, side="right"))
        ahead[:, j] = _log_sum(ahead[:, j - spans[:usable]] + gain[:, j, :usable])
        i = frames - 1 - j
        ends = i + spans[:usable]
        behind[:, i] = _log_sum(behind[:, ends] + gain[:, ends, np.arange(usable)])
    cuts = np.exp(np.minimum(ahead + behind - ahead[:, -1:], 0.0))
    padded = np.pad(cuts, ((0, 0), (reach, reach)))
    near = np.sum([padded[:, k : k + frames] for k in range(2 * reach + 1)], axis=0)
    return np.asarray(np.minimum(near, 1.0), dtype=np.float64)


def _log_sum(rows: Array) -> Array:
    if not rows.shape[1]:
        return np.full(len(rows), -np.inf)
    top = rows.max(axis=1)
    safe = np.where(np.isfinite(top), top, 0.0)
    with np.errstate(divide="ignore"):
        total: Array = np.log(np.exp(rows - safe[:, None]).sum(axis=1)) + safe
    return total
