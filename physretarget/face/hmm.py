"""Matching by alignment: a hidden Markov model solved by Viterbi (the paper's third approach).

The example's N points are the chain, the capture's M frames the states. The paper's feature
vector and constants are lost from its text; reconstructed here: features are value, slope and
curvature, each over its spread; the emission cost is their Euclidean distance; moving from frame
j to frame k >= j costs ``beta |k - j - lam|`` with lam = (M - 1)/(N - 1), so that the alignment is
monotone and smooth; the first point sits on the first frame.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_WEIGHTS = np.array([1.0, 2.0, 4.0])


def features(rows: Array, spread: float) -> Array:
    """(..., n, 3): value, slope and curvature per frame, each over the channel's own deviation."""
    slope = np.gradient(rows, axis=-1)
    found: Array = np.stack([rows, slope, np.gradient(slope, axis=-1)], axis=-1)
    scaled: Array = found * _WEIGHTS / spread
    return scaled


def emission(example: Array, capture: Array) -> Array:
    """(..., N, M) distances between feature vectors (..., N, 3) and (..., M, 3)."""
    distances: Array = np.linalg.norm(example[..., :, None, :] - capture[..., None, :, :], axis=-1)
    return distances


def viterbi(
    cost: Array, beta: float, lam: float | None = None, *, free_end: bool = True
) -> tuple[Array, NDArray[np.intp]]:
    """Cheapest monotone assignment of chain points to frames, for a batch at once.

    Args:
        cost: (B, N, M) emission costs.
        beta: price of one frame's deviation from the even pace.
        lam: the even pace in frames per point; (M - 1)/(N - 1) by default.
        free_end: the last point may sit on any frame, else on the last.

    Returns:
        (B,) total costs and (B, N) frames. O(N M) per problem: with an absolute-value cost the
        best predecessor further than lam back comes from a running minimum, and the few nearer
        ones are looked at one by one.
    """
    batch, n, m = cost.shape
    pace = (m - 1) / max(n - 1, 1) if lam is None else lam
    frames = np.arange(m)
    best = np.full((batch, m), np.inf)
    best[:, 0] = cost[:, 0, 0]
    back = np.zeros((batch, n, m), dtype=np.intp)
    for i in range(1, n):
        arrive, back[:, i] = _step(best, beta, pace, frames)
        best = arrive + cost[:, i]
    last = np.argmin(best, axis=1) if free_end else np.full(batch, m - 1)
    rows = np.arange(batch)
    path = np.empty((batch, n), dtype=np.intp)
    path[:, -1] = last
    for i in range(n - 1, 0, -1):
        path[:, i - 1] = back[rows, i, path[:, i]]
    return best[rows, last], path


def _step(
    best: Array, beta: float, pace: float, frames: NDArray[np.intp]
) -> tuple[Array, NDArray[np.intp]]:
    """min over j <= k of best[j] + beta |k - j - pace|, and the j that attains it."""
    m = len(frames)
    shift = int(np.ceil(pace))
    arrive = np.full(best.shape, np.inf)
    source = np.broadcast_to(frames, best.shape).copy()
    if shift < m:  # at least the even pace back: the cost falls linearly with j
        slanted = best - beta * frames
        lowest = np.minimum.accumulate(slanted, axis=1)
        is_new = np.ones(best.shape, dtype=bool)
        is_new[:, 1:] = slanted[:, 1:] < lowest[:, :-1]
        where = np.maximum.accumulate(np.where(is_new, frames, 0), axis=1)[:, : m - shift]
        far = frames[shift:] - where - pace
        arrive[:, shift:] = np.take_along_axis(best, where, axis=1) + beta * far
        source[:, shift:] = where
    for step in range(min(shift, m)):  # nearer than the even pace
        near = best[:, : m - step] + beta * (pace - step)
        better = near < arrive[:, step:]
        arrive[:, step:] = np.where(better, near, arrive[:, step:])
        source[:, step:] = np.where(better, frames[: m - step], source[:, step:])
    return arrive, source
