"""Mappers on key poses that they have not seen, and on whole captures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget.mapping import Mapper
from physretarget.mapping.threads import one_thread

Array = NDArray[np.float64]
Learn = Callable[[Array, Array], Mapper]
LEVELS = {50: 0.67449, 80: 1.28155, 95: 1.95996}
"""Percent of a normal law → its half width in standard deviations."""


@dataclass(frozen=True, eq=False)
class Unseen:
    """Each key pose as mapped by a mapper that learned all groups but its own.

    ``mean`` (N, DZ) m, ``variance`` (N, DZ) m² of each coordinate, NaN where none is known.
    """

    mean: Array
    variance: Array
    truth: Array

    @property
    def error(self) -> float:
        """RMS distance of the markers from where the animator had them, m."""
        return marker_rms(self.mean - self.truth)

    def inside(self, sigmas: float) -> float | None:
        """Share of coordinates within so many predicted standard deviations."""
        known = np.isfinite(self.variance).all(axis=1)
        if not known.any():
            return None
        miss = np.abs(self.mean - self.truth)[known]
        return float(np.mean(miss <= sigmas * np.sqrt(self.variance[known])))


def unseen(learn: Learn, y: Array, z: Array, groups: Sequence[object]) -> Unseen:
    """Learn once per group without it, and map it."""
    mean, variance = np.zeros_like(z), np.full_like(z, np.nan)
    for group in dict.fromkeys(groups):
        out = np.array([each == group for each in groups])
        mapper = learn(y[~out], z[~out])
        # One by one: key poses are no motion, and none may lean on the one before it.
        for i in np.flatnonzero(out):
            mapped = mapper.predict(y[i : i + 1])
            mean[i], variance[i] = mapped.mean[0], mapped.coordinate_variance[0]
    return Unseen(mean, variance, z)


def marker_rms(miss: Array) -> float:
    """RMS length of the markers' displacements, from stacked coordinates (N, 3K)."""
    return float(np.sqrt(np.mean(np.sum(miss.reshape(len(miss), -1, 3) ** 2, axis=2))))


@one_thread
def jerk_rms(tracks: Sequence[Array], fps: Sequence[float]) -> float:
    """RMS length of the third derivative per row over tracks (T, D), each at its rate."""
    squares = [
        np.sum((np.diff(track, n=3, axis=0) * rate**3) ** 2, axis=1)
        for track, rate in zip(tracks, fps, strict=True)
        if len(track) > 3
    ]
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def marker_jerk(tracks: Sequence[Array], fps: Sequence[float]) -> float:
    """RMS jerk of a marker, m/s³, over mapped features (T, 3K)."""
    return jerk_rms(tracks, fps) / float(np.sqrt(tracks[0].shape[1] / 3))


def largest_step(tracks: Sequence[Array], fps: Sequence[float]) -> float:
    """Fastest marker in any track, m/s: a jump of the mapping shows here."""
    return max(
        float(np.linalg.norm(np.diff(track, axis=0).reshape(len(track) - 1, -1, 3), axis=2).max())
        * rate
        for track, rate in zip(tracks, fps, strict=True)
    )
