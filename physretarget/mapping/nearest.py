"""Nearest key poses, weighted by inverse distance (a baseline of Yamane 2010, 6.4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from physretarget.mapping.kernels import squared_distances
from physretarget.mapping.protocol import (
    Array,
    Arrays,
    Mapped,
    checked_frames,
    checked_pairs,
)
from physretarget.mapping.threads import one_thread


@dataclass(frozen=True)
class NearestPoses:
    """Mean of the ``neighbours`` key poses nearest to a frame, weights 1 / distance."""

    keys_y: Array
    keys_z: Array
    neighbours: int

    @property
    def name(self) -> str:
        """``nn3``, ``nn10``, …"""
        return f"nn{self.neighbours}"

    @one_thread
    def predict(self, y: Array) -> Mapped:
        """Map frames y (T, DY), each on its own; the variance is not known.

        Args:
            y: (T, DY) actor features, m.

        Returns:
            Mean (T, DZ) m; the variance is NaN.
        """
        frames = checked_frames(y, self.keys_y.shape[1])
        count = min(self.neighbours, self.keys_y.shape[0])
        centre = self.keys_y.mean(axis=0)  # keeps the squares small
        distance = np.sqrt(squared_distances(frames - centre, self.keys_y - centre))
        chosen = np.argsort(distance, axis=1, kind="stable")[:, :count]
        weight = 1.0 / np.maximum(np.take_along_axis(distance, chosen, axis=1), 1e-6)
        weight /= weight.sum(axis=1, keepdims=True)
        mean = np.einsum("tn,tnd->td", weight, self.keys_z[chosen])
        return Mapped(mean, np.full(frames.shape[0], np.nan))

    def to_arrays(self) -> Arrays:
        """Plain arrays; see :func:`physretarget.mapping.from_arrays`."""
        return {
            "mapper": np.array(self.name),
            "keys_y": self.keys_y,
            "keys_z": self.keys_z,
            "neighbours": np.array(self.neighbours),
        }

    @classmethod
    def from_arrays(cls, arrays: Arrays) -> NearestPoses:
        """Rebuild what :meth:`to_arrays` gave.

        Args:
            arrays: Name → array.

        Returns:
            The mapper.
        """
        return cls(
            np.asarray(arrays["keys_y"], dtype=np.float64),
            np.asarray(arrays["keys_z"], dtype=np.float64),
            int(arrays["neighbours"]),
        )


def fit_nearest(y: Array, z: Array, *, neighbours: int) -> NearestPoses:
    """Keep the key poses y (N, DY), z (N, DZ)."""
    y, z = checked_pairs(y, z)
    return NearestPoses(y, z, neighbours)
