"""Cubic Béziers in time and value: evaluated, solved for time, and slopes that keys are given."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def bezier(points: Array, u: Array) -> Array:
    """Bernstein form: (n, 4) control values at (n,) parameters; exact at both ends."""
    v = 1.0 - u
    return (
        v * v * v * points[:, 0]
        + 3.0 * v * v * u * points[:, 1]
        + 3.0 * v * u * u * points[:, 2]
        + u * u * u * points[:, 3]
    )


def solve_time(x: ArrayLike, x1: ArrayLike, x2: ArrayLike) -> Array:
    """Parameter u with Bézier time ``x(u) = x``, time control points 0, x1, x2, 1.

    The answer is unique where x(u) is monotone, as x1, x2 within [0, 1] always are. Newton
    steps inside a shrinking bracket: one that leaves it is replaced by halving, so that flat
    stretches (x1 = 1, x2 = 0) cannot throw it off.
    """
    target, a, b = np.broadcast_arrays(*(np.asarray(v, np.float64) for v in (x, x1, x2)))
    u = target.copy()
    low, high = np.zeros_like(u), np.ones_like(u)
    for _ in range(64):
        v = 1.0 - u
        error = 3.0 * v * v * u * a + 3.0 * v * u * u * b + u**3 - target
        if float(np.max(np.abs(error), initial=0.0)) < 1e-14:
            break
        low = np.where(error < 0, u, low)
        high = np.where(error > 0, u, high)
        slope = 3.0 * (v * v * a + 2.0 * v * u * (b - a) + u * u * (1.0 - b))
        step = error / np.where(slope > 1e-12, slope, np.inf)
        guess = u - step
        bad = (slope <= 1e-12) | (guess <= low) | (guess >= high)
        moved = np.where(error == 0, u, np.where(bad, 0.5 * (low + high), guess))
        if np.array_equal(moved, u):
            break
        u = moved
    return u


def spline_slopes(time: Array, value: Array) -> Array:
    """Catmull-Rom on uneven times: slope from the left to the right neighbour; secant at ends."""
    if len(time) == 1:
        return np.zeros(1)
    slopes = np.empty(len(time))
    slopes[1:-1] = (value[2:] - value[:-2]) / (time[2:] - time[:-2])
    slopes[0] = (value[1] - value[0]) / (time[1] - time[0])
    slopes[-1] = (value[-1] - value[-2]) / (time[-1] - time[-2])
    return slopes


def auto_slopes(time: Array, value: Array) -> Array:
    """Spline slopes, flat at extrema and at the ends, limited to 3 times the flatter secant.

    The limit is the monotonicity bound of Fritsch and Carlson (1980): no overshoot between keys.
    """
    slopes = spline_slopes(time, value)
    slopes[0] = slopes[-1] = 0.0
    if len(time) < 3:
        return slopes
    secant = np.diff(value) / np.diff(time)
    flatter = np.minimum(np.abs(secant[:-1]), np.abs(secant[1:]))
    inner = np.sign(slopes[1:-1]) * np.minimum(np.abs(slopes[1:-1]), 3.0 * flatter)
    slopes[1:-1] = np.where(secant[:-1] * secant[1:] > 0, inner, 0.0)
    return slopes
