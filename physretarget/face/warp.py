"""A curve kept within its channel's range."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


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
