"""From placed templates to one curve: shared keys at the joins, C1, within the range.

The paper's joins take value and slope from the capture. Capture slopes are noisy, so by default
the keys' values and the joins' slopes are solved for together: least squares against all frames,
key times and tangent lengths as the templates have them, slopes drawn toward the templates'.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from physretarget.face.curve import solve_time

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Draft:
    """Keys before fitting; times in frames, values in units of the channel's range.

    table (K, 6) as Curve.table. join (K,): one slope on both sides, solved for. held (K,): an
    animator's locked key, kept as it is. slope, spread (K,): the templates' slope at joins and how
    far from it the solution may stray.
    """

    table: Array
    join: NDArray[np.bool_]
    held: NDArray[np.bool_]
    slope: Array
    spread: Array


def fit(draft: Draft, values: Array, noise: float, weight: Array | None = None) -> Array:
    """Key table (K, 6) whose curve is closest to values (M,) on frames 0 to M-1.

    noise: expected deviation of a frame, in units of the range; smaller follows the capture more.
    weight: (M,) how much each frame counts; all alike by default.
    """
    table = draft.table.copy()
    frames = np.arange(len(values), dtype=np.float64)
    basis, left = _basis(table, frames)
    count = len(table)
    # Unknowns are interleaved value, slope, value, slope, …: only neighbours meet, 4 diagonals.
    columns = np.stack([2 * left, 2 * left + 1, 2 * left + 2, 2 * left + 3], axis=1)
    out_dx, in_dx = table[left, 4], table[left + 1, 2]
    weights = np.stack(
        [
            basis[:, 0] + basis[:, 1],
            np.where(draft.join[left], basis[:, 1] * out_dx, 0.0),
            basis[:, 2] + basis[:, 3],
            np.where(draft.join[left + 1], basis[:, 2] * in_dx, 0.0),
        ],
        axis=1,
    )
    fixed = np.where(draft.join[left], 0.0, basis[:, 1] * table[left, 5])
    fixed += np.where(draft.join[left + 1], 0.0, basis[:, 2] * table[left + 1, 3])
    rest = values - fixed
    counts = np.ones(len(values)) if weight is None else weight
    heavy = weights * counts[:, None]
    band = np.zeros((4, 2 * count))
    right = np.zeros(2 * count)
    for a in range(4):
        np.add.at(right, columns[:, a], heavy[:, a] * rest)
        for b in range(a, 4):
            np.add.at(band[3 - (b - a)], columns[:, b], heavy[:, a] * weights[:, b])
    _priors(draft, band, right, noise)
    solved = solveh_banded(band, right).reshape(count, 2)
    table[:, 1] = np.where(draft.held, table[:, 1], solved[:, 0])
    joined = draft.join & ~draft.held
    table[joined, 3] = table[joined, 2] * solved[joined, 1]
    table[joined, 5] = table[joined, 4] * solved[joined, 1]
    return table


def _priors(draft: Draft, band: Array, right: Array, noise: float) -> None:
    value_pull = np.where(draft.held, 1e12, 1e-4)
    band[3, ::2] += value_pull
    right[::2] += value_pull * draft.table[:, 1]
    slope_pull = np.where(draft.join, (noise / draft.spread) ** 2, 1.0)
    band[3, 1::2] += slope_pull
    right[1::2] += slope_pull * np.where(draft.join, draft.slope, 0.0)


def _basis(table: Array, frames: Array) -> tuple[Array, NDArray[np.intp]]:
    """(M, 4) Bernstein weights of every frame in its span, and that span's left key."""
    left = np.clip(np.searchsorted(table[:, 0], frames, side="right") - 1, 0, len(table) - 2)
    width = table[left + 1, 0] - table[left, 0]
    x = np.clip((frames - table[left, 0]) / width, 0.0, 1.0)
    x1 = np.clip(table[left, 4] / width, 0.0, 1.0)
    x2 = np.clip(1.0 + table[left + 1, 2] / width, 0.0, 1.0)
    u = solve_time(x, x1, x2)
    v = 1.0 - u
    return np.stack([v**3, 3 * v * v * u, 3 * v * u * u, u**3], axis=1), left


def within_range(
    table: Array, join: NDArray[np.bool_], held: NDArray[np.bool_], lower: float, upper: float
) -> Array:
    """Key table whose whole curve lies within [lower, upper], slopes at joins still shared.

    A Bézier lies within the hull of its control points: values are cut off at the bounds and
    tangents shortened in height until their ends are inside. Locked keys are left alone.
    """
    result = table.copy()
    result[:, 1] = np.where(held, result[:, 1], np.clip(result[:, 1], lower, upper))
    value = result[:, 1]
    for k in np.flatnonzero(~held):
        factors = []
        for column in (3, 5):
            height = result[k, column]
            room = upper - value[k] if height > 0 else value[k] - lower
            factors.append(1.0 if abs(height) <= room else room / abs(height))
        if join[k]:
            factors = [min(factors)] * 2
        result[k, 3] *= factors[0]
        result[k, 5] *= factors[1]
    return result
