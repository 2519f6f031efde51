"""What every mapper offers: matrix in, matrix out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from physretarget.errors import InputError

Array = NDArray[np.float64]
Arrays = dict[str, NDArray[np.generic]]


@dataclass(frozen=True)
class Mapped:
    """Character features predicted from actor features.

    ``mean`` (T, DZ) in the units of the key poses (metres). ``variance`` (T,) of a coordinate of
    ``mean`` on average, m²; NaN where the mapper knows none. ``latent`` (T, DX) or None.
    ``share`` (DZ,): the variance of each coordinate over that average; None means one.
    """

    mean: Array
    variance: Array
    latent: Array | None = None
    share: Array | None = None

    @property
    def coordinate_variance(self) -> Array:
        """Variance of each coordinate (T, DZ), m²."""
        share = np.ones(self.mean.shape[1]) if self.share is None else self.share
        result: Array = self.variance[:, None] * share
        return result

    @property
    def expected_error(self) -> float:
        """Root mean square distance by which a virtual marker is to be missed over all frames, m.

        Where the key poses contradict each other, the error is larger (docs/measured/suggest.md).
        """
        return float(np.sqrt(3.0 * np.mean(self.variance)))


class Mapper(Protocol):
    """A learned map from actor features to character features."""

    @property
    def name(self) -> str:
        """Name under which :func:`physretarget.mapping.fit` made it."""
        ...

    def predict(self, y: Array) -> Mapped:
        """Map frames ``y`` (T, DY), in order of time.

        Args:
            y: (T, DY) actor features, m.

        Returns:
            Mean (T, DZ) m and variance (T,) m².
        """
        ...

    def to_arrays(self) -> Arrays:
        """Everything needed to rebuild the mapper, as plain arrays."""
        ...


@dataclass(frozen=True)
class Space:
    """Centre (D,) and one scale of an observation space; distances stay distances."""

    centre: Array
    scale: float

    @classmethod
    def of(cls, observations: Array) -> Space:
        """Centre and RMS spread per coordinate of ``observations`` (N, D).

        Args:
            observations: (N, D) features, m.

        Returns:
            The space.
        """
        centre = observations.mean(axis=0)
        scale = float(np.sqrt(np.mean((observations - centre) ** 2)))
        return cls(centre, scale if scale > 1e-12 else 1.0)

    def normal(self, observations: Array) -> Array:
        """Centred and scaled.

        Args:
            observations: (N, D) features, m.

        Returns:
            (N, D) of unit spread.
        """
        return (observations - self.centre) / self.scale

    def natural(self, normal: Array) -> Array:
        """Back in the units of the observations.

        Args:
            normal: (N, D) of unit spread.

        Returns:
            (N, D) features, m.
        """
        return self.centre + self.scale * normal


def checked_pairs(y: Array, z: Array) -> tuple[Array, Array]:
    """Key poses as float64 matrices (N, DY), (N, DZ), or an InputError that says what is off."""
    y = np.asarray(y, dtype=np.float64)
    z = np.asarray(z, dtype=np.float64)
    if y.ndim != 2 or z.ndim != 2 or y.shape[0] != z.shape[0]:
        raise InputError(
            f"key poses must be two matrices with one row each, not {y.shape} and {z.shape}"
        )
    if y.shape[0] < 2:
        raise InputError(f"a mapper needs at least two key poses, not {y.shape[0]}")
    if not (np.isfinite(y).all() and np.isfinite(z).all()):
        raise InputError("key poses contain numbers that are not finite")
    return y, z


def checked_frames(y: Array, width: int) -> Array:
    """Frames as a float64 matrix (T, width), or an InputError that names the frame."""
    y = np.asarray(y, dtype=np.float64)
    if y.ndim != 2 or y.shape[1] != width:
        raise InputError(f"frames must have shape (T, {width}) as the key poses, not {y.shape}")
    bad = np.flatnonzero(~np.isfinite(y).all(axis=1))
    if bad.size:
        raise InputError("features are not finite", frame=int(bad[0]))
    return y
