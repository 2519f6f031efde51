"""How sure a mapper may be of itself: its predicted variance against what it missed.

A Gaussian process knows where its key poses are, not how wrong its kernel is. Groups of
neighbouring key poses are therefore left out in turn, mapped by the rest, and compared with what
was posed: one factor on the variance, and how it is shared among the coordinates. Neighbours go
together, for a performance leaves the key poses by more than the distance between two of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget.mapping.kernels import squared_distances
from physretarget.mapping.protocol import Array

HOLES = 8
"""Groups of neighbours that are left out in turn."""
FEWEST = 10
"""Key poses below which nothing can be said: the variance stays as predicted."""
LEVEL, SIGMAS = 0.95, 1.959964
"""The factor is such that so many of the left-out coordinates lie within so many σ."""
LEAST_SHARE = 0.01
"""Of the mean variance, for coordinates that no key pose moves."""

Predict = Callable[[NDArray[np.bool_], Array], tuple[Array, Array]]
"""(key poses to keep (N,), normal frames (T, DY)) → normal mean (T, DZ), variance (T,)."""


@dataclass(frozen=True)
class Calibration:
    """``factor`` on predicted variances; ``share`` (DZ,) of each coordinate, one in the mean."""

    factor: float
    share: Array

    @classmethod
    def none(cls, width: int) -> Calibration:
        """As predicted, the same for all coordinates."""
        return cls(1.0, np.ones(width))


def calibrate(predict: Predict, keys_y: Array, keys_z: Array) -> Calibration:
    """Compare ``predict`` with normal key poses (N, DY), (N, DZ) that it must not use."""
    count, width = keys_z.shape
    if count < FEWEST:
        return Calibration.none(width)
    miss, variance = np.zeros_like(keys_z), np.ones(count)
    for hole in holes(keys_y):
        keep = np.ones(count, dtype=bool)
        keep[hole] = False
        mean, variance[hole] = predict(keep, keys_y[hole])
        miss[hole] = mean - keys_z[hole]
    ratio = miss**2 / variance[:, None]
    share = ratio.mean(axis=0)
    share = np.maximum(share, max(LEAST_SHARE * float(share.mean()), 1e-12))
    share /= share.mean()
    factor = float(np.quantile(ratio / share, LEVEL)) / SIGMAS**2
    return Calibration(max(factor, 1e-6), share)


def holes(keys: Array) -> list[NDArray[np.int64]]:
    """Disjoint groups of neighbouring key poses (N, DY), the outermost first."""
    squared = squared_distances(keys, keys)
    size = -(-len(keys) // HOLES)
    left = np.ones(len(keys), dtype=bool)
    found = []
    for first in np.argsort(-np.sum((keys - keys.mean(axis=0)) ** 2, axis=1), kind="stable"):
        if left[first]:
            near = np.argsort(squared[first], kind="stable")
            found.append(near[left[near]][:size])
            left[found[-1]] = False
    return found
