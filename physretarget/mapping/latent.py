"""The latent space to look at: Yamane 2010, Figure 6, as arrays for a drawing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget.mapping.gplvm import SharedGPLVM

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LatentMap:
    """A trajectory on a plane of the latent space, over the variance of the character's pose.

    ``axes`` (2, DX): orthonormal directions of the plane. ``trajectory`` (T, 2) and ``keys``
    (N, 2): coordinates on it. ``grid_x`` (G,), ``grid_y`` (G,); ``variance`` (G, G), rows along
    ``grid_y``: variance of each character coordinate, m², on the plane through ``centre`` (DX,).
    """

    axes: Array
    centre: Array
    trajectory: Array
    keys: Array
    grid_x: Array
    grid_y: Array
    variance: Array


def latent_map(model: SharedGPLVM, latent: Array, *, cells: int = 60) -> LatentMap:
    """Plane of the two widest directions of the key poses, with trajectory ``latent`` (T, DX)."""
    centre = model.latent.mean(axis=0)
    axes = _widest(model.latent - centre)
    keys = (model.latent - centre) @ axes.T
    trajectory = (latent - centre) @ axes.T
    everything = np.concatenate([keys, trajectory])
    low, high = everything.min(axis=0), everything.max(axis=0)
    margin = 0.1 * np.maximum(high - low, 1e-6)
    grid_x, grid_y = np.linspace(low - margin, high + margin, cells).T
    across, along = np.meshgrid(grid_x, grid_y)
    plane = np.stack([across.ravel(), along.ravel()], axis=1)
    variance = model.decode(centre + plane @ axes).variance.reshape(cells, cells)
    return LatentMap(axes, centre, trajectory, keys, grid_x, grid_y, variance)


def _widest(centred: Array) -> Array:
    """Two orthonormal rows (2, DX) of largest spread, signs fixed; one zero row when DX is 1."""
    _, _, basis = np.linalg.svd(centred, full_matrices=False)
    axes = np.zeros((2, centred.shape[1]))
    axes[: min(2, basis.shape[0])] = basis[:2]
    largest = axes[np.arange(2), np.abs(axes).argmax(axis=1)]
    result: Array = axes * np.where(largest < 0, -1.0, 1.0)[:, None]
    return result
