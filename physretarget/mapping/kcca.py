"""Kernel canonical correlation analysis: where the latent points start (Akaho 2001)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physretarget.mapping.kernels import squared_distances

Array = NDArray[np.float64]


def centred_gram(observations: Array) -> Array:
    """RBF Gram matrix (N, N) of median-distance width, centred in feature space."""
    squared = squared_distances(observations, observations)
    off_diagonal = squared[np.triu_indices_from(squared, k=1)]
    width = float(np.median(off_diagonal))
    if width <= 1e-12:  # mostly duplicates: any positive width separates the rest
        width = max(float(off_diagonal.max(initial=0.0)), 1.0)
    gram = np.exp(-0.5 * squared / width)
    gram = gram - gram.mean(axis=0)
    result: Array = gram - gram.mean(axis=1)[:, None]
    return result


def canonical_directions(y: Array, z: Array, regularisation: float = 0.1) -> Array:
    """Shared coordinates (N, at most N-1) of two observation matrices (N, DY), (N, DZ).

    The mean of the two canonical projections, in falling order of correlation. Each column
    keeps the length that regularisation leaves it, so that directions which the spaces hardly
    share stay short. ``regularisation`` is relative to the mean eigenvalue of a Gram matrix.
    """
    smooth_y, smooth_z = (_smoother(centred_gram(o), regularisation) for o in (y, z))
    left, correlation, right = np.linalg.svd(smooth_y @ smooth_z)
    shared = 0.5 * (smooth_y @ left + smooth_z.T @ right.T)
    keep = correlation > 1e-9
    keep[y.shape[0] - 1 :] = False  # centring takes one direction
    return _fixed_signs(shared[:, keep])


def initial_latent(y: Array, z: Array, dims: int, rng: np.random.Generator) -> Array:
    """Starting latent points (N, dims): unit mean variance, the rest small seeded noise."""
    directions = canonical_directions(y, z)[:, :dims]
    latent = 1e-3 * rng.standard_normal((y.shape[0], dims))
    spread = np.sqrt(np.mean(directions[:, :1] ** 2)) if directions.size else 0.0
    if spread > 0:
        latent[:, : directions.shape[1]] = directions / spread
    return latent


def _smoother(gram: Array, regularisation: float) -> Array:
    ridge = max(regularisation * np.trace(gram) / gram.shape[0], 1e-12)
    result: Array = np.linalg.solve(gram + ridge * np.eye(gram.shape[0]), gram)
    return result


def _fixed_signs(columns: Array) -> Array:
    """Make the largest entry of each column positive; SVD leaves the sign open."""
    if columns.size == 0:
        return columns
    largest = np.abs(columns).argmax(axis=0)
    sign = np.sign(columns[largest, np.arange(columns.shape[1])])
    result: Array = columns * np.where(sign == 0, 1.0, sign)
    return result
