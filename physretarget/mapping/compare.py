"""How well mappers do on key poses that they have not seen."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget.mapping.protocol import Array, Mapper, checked_pairs


@dataclass(frozen=True)
class Comparison:
    """RMS errors over all features, metres.

    ``seen``: key poses mapped by a mapper that learned them. ``unseen`` (N,): each key pose
    mapped by one that learned all groups but its own. ``inside``: share of unseen features
    within two predicted standard deviations (NaN where no variance is known; 0.95 is ideal).
    """

    name: str
    seen: float
    unseen: Array
    inside: float

    @property
    def unseen_rms(self) -> float:
        """RMS over all unseen key poses."""
        return float(np.sqrt(np.mean(self.unseen**2)))


def leave_out(
    name: str,
    y: Array,
    z: Array,
    *,
    groups: Iterable[object] | None = None,
    dims: int = 30,
    seed: int = 0,
) -> Comparison:
    """Learn again and again, each time without one group of key poses, and map that group.

    ``groups``: one label per key pose, for instance the capture that it came from; None leaves
    out one key pose at a time.
    """
    from physretarget.mapping import fit

    y, z = checked_pairs(y, z)
    labels = list(groups) if groups is not None else list(range(y.shape[0]))
    unseen = np.zeros(y.shape[0])
    inside = np.zeros(y.shape[0])
    for group in dict.fromkeys(labels):
        out = np.array([label == group for label in labels])
        mapper = fit(name, y[~out], z[~out], dims=dims, seed=seed)
        for i in np.flatnonzero(out):
            unseen[i], inside[i] = _error(mapper, y[i], z[i])
    whole = fit(name, y, z, dims=dims, seed=seed)
    seen = float(np.sqrt(np.mean((whole.predict(y).mean - z) ** 2)))
    return Comparison(name, seen, unseen, float(inside.mean()))


def _error(mapper: Mapper, y: NDArray[np.float64], z: NDArray[np.float64]) -> tuple[float, float]:
    mapped = mapper.predict(y[None])
    miss = mapped.mean[0] - z
    variance = mapped.coordinate_variance[0]
    known = np.isfinite(variance).all()
    inside = float(np.mean(np.abs(miss) <= 2.0 * np.sqrt(variance))) if known else np.nan
    return float(np.sqrt(np.mean(miss**2))), inside
