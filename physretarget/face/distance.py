"""Matching by distance (Ruhland et al. 2017, "First Approach"): windows against an example.

Both sides are centred on their first sample, so that an offset does not count:
``d(r) = sum_i (q_i - (p_{r+i} - p_r))^2``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import fftconvolve

Array = NDArray[np.float64]


def distance_profile(capture: Array, segment: Array) -> Array:
    """(M - n + 1,) distances of a segment (n,) to every window of the capture (M,).

    One correlation and cumulative sums; empty when the segment is the longer one.

    Args:
        capture: (M,) values.
        segment: (n,) values, n ≤ M.

    Returns:
        (M - n + 1,) z-normalised distances.
    """
    n, m = len(segment), len(capture)
    if n == 0 or n > m:
        return np.empty(0)
    p = capture - capture.mean()  # keeps the cancellation below small
    q = segment - segment[0]
    sums = np.concatenate([[0.0], np.cumsum(p)])
    squares = np.concatenate([[0.0], np.cumsum(p * p)])
    first = p[: m - n + 1]
    window_sum = sums[n:] - sums[:-n]
    window_squares = squares[n:] - squares[:-n] - 2.0 * first * window_sum + n * first * first
    cross = _correlate(p, q) - first * q.sum()
    distances: Array = np.maximum(window_squares - 2.0 * cross + float(q @ q), 0.0)
    return distances


def _correlate(p: Array, q: Array) -> Array:
    if len(p) * len(q) < 200_000:  # below, the direct sum is faster
        return np.correlate(p, q, mode="valid")
    return np.asarray(fftconvolve(p, q[::-1], mode="valid"), dtype=np.float64)
