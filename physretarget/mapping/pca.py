"""Linear map between two principal subspaces (a baseline of Yamane 2010, 6.4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from physretarget.mapping.protocol import (
    Array,
    Arrays,
    Mapped,
    checked_frames,
    checked_pairs,
)
from physretarget.mapping.threads import one_thread


@dataclass(frozen=True)
class PrincipalMap:
    """z = centre_z + linear (y - centre_y); ``linear`` (DZ, DY)."""

    centre_y: Array
    centre_z: Array
    linear: Array
    name: str = "pca"

    @one_thread
    def predict(self, y: Array) -> Mapped:
        """Map frames y (T, DY), each on its own; the variance is not known.

        Args:
            y: (T, DY) actor features, m.

        Returns:
            Mean (T, DZ) m; the variance is NaN.
        """
        frames = checked_frames(y, self.centre_y.size)
        mean = self.centre_z + (frames - self.centre_y) @ self.linear.T
        return Mapped(mean, np.full(frames.shape[0], np.nan))

    def to_arrays(self) -> Arrays:
        """Plain arrays; see :func:`physretarget.mapping.from_arrays`."""
        return {
            "mapper": np.array(self.name),
            "centre_y": self.centre_y,
            "centre_z": self.centre_z,
            "linear": self.linear,
        }

    @classmethod
    def from_arrays(cls, arrays: Arrays) -> PrincipalMap:
        """Rebuild what :meth:`to_arrays` gave.

        Args:
            arrays: Name → array.

        Returns:
            The mapper.
        """
        name = str(arrays.get("mapper", "pca"))
        a = {k: np.asarray(v, dtype=np.float64) for k, v in arrays.items() if k != "mapper"}
        return cls(a["centre_y"], a["centre_z"], a["linear"], name)


@one_thread
def fit_pca(y: Array, z: Array, *, dims: int = 30) -> PrincipalMap:
    """Principal subspaces of at most ``dims`` dimensions and the least-squares map between.

    As many dimensions as key poses would interpolate noise; directions below 1e-6 of the
    largest singular value are left out.
    """
    y, z = checked_pairs(y, z)
    centre_y, centre_z = y.mean(axis=0), z.mean(axis=0)
    basis_y, scores_y = _principal(y - centre_y, dims)
    basis_z, scores_z = _principal(z - centre_z, dims)
    between = np.linalg.lstsq(scores_y, scores_z, rcond=1e-6)[0]
    return PrincipalMap(centre_y, centre_z, basis_z.T @ between.T @ basis_y)


def _principal(centred: Array, dims: int) -> tuple[Array, Array]:
    """Basis (d, D) and scores (N, d)."""
    _, size, basis = np.linalg.svd(centred, full_matrices=False)
    keep = (size > 1e-6 * max(float(size[0]), 1e-12)).sum()
    basis = basis[: min(dims, int(keep))]
    return basis, centred @ basis.T


PENALTIES = np.logspace(-2.0, 3.0, 11)
"""Tried, in units of a feature's mean square over the key poses."""


@one_thread
def fit_ridge(y: Array, z: Array) -> PrincipalMap:
    """Ridge regression; of the penalties the one that misses left-out key poses least.

    What a key pose is missed by when it is left out follows from the fit with it in: the
    residual over one minus its leverage (Golub, Heath and Wahba 1979).
    """
    y, z = checked_pairs(y, z)
    centre_y, centre_z = y.mean(axis=0), z.mean(axis=0)
    inputs, outputs = y - centre_y, z - centre_z
    unit = max(float(np.mean(inputs**2)), 1e-24)
    values, axes = np.linalg.eigh(inputs @ inputs.T)
    turned = axes.T @ outputs
    best, weights = np.inf, np.zeros_like(outputs)
    for penalty in PENALTIES * unit:
        kept = 1.0 / (np.maximum(values, 0.0) + penalty)
        residual = outputs - axes @ ((values * kept)[:, None] * turned)
        leverage = np.sum(axes**2 * (values * kept), axis=1)
        missed = float(np.mean((residual / np.maximum(1.0 - leverage, 1e-9)[:, None]) ** 2))
        if missed < best:
            best, weights = missed, axes @ (kept[:, None] * turned)
    return PrincipalMap(centre_y, centre_z, weights.T @ inputs, "ridge")
