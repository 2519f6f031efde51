"""Direct Gaussian process regression from actor to character features (Yamane 2010, 6.4)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from physretarget.mapping.calibration import Calibration, calibrate
from physretarget.mapping.kernels import Kernel, gram_gradient, squared_distances
from physretarget.mapping.protocol import (
    Array,
    Arrays,
    Mapped,
    Space,
    checked_frames,
    checked_pairs,
)
from physretarget.mapping.regression import Posterior, likelihood
from physretarget.mapping.threads import one_thread

BOUNDS = ((1e-2, 1e4), (1e-6, 1e2), (1e-6, 1e1), (1e-6, 1e-2), (1e-8, 1e2))
"""Signal, sharpness (of distances per feature), offset, noise, linear; see ``gplvm.BOUNDS``."""

STARTS = (0.1, 1.0, 10.0)
"""Widths tried, as multiples of 1 / median squared distance: the likelihood has local optima."""


@dataclass(frozen=True)
class GaussianProcess:
    """One kernel for all character features, inputs are normal actor features (N, DY)."""

    kernel: Kernel
    space_y: Space
    space_z: Space
    keys_y: Array
    keys_z: Array
    calibration: Calibration
    name: str = "gp"

    def __post_init__(self) -> None:
        object.__setattr__(self, "_posterior", Posterior.of(self.kernel, self.keys_y, self.keys_z))

    @property
    def posterior(self) -> Posterior:
        """Normal actor features → normal character features, the variance not calibrated."""
        posterior: Posterior = self._posterior  # type: ignore[attr-defined]
        return posterior

    @one_thread
    def predict(self, y: Array) -> Mapped:
        """Map frames y (T, DY), each on its own.

        Args:
            y: (T, DY) actor features, m.

        Returns:
            Mean (T, DZ) m and variance (T,) m².
        """
        frames = self.space_y.normal(checked_frames(y, self.space_y.centre.size))
        mean, variance = self.posterior.at(frames)
        scale = self.calibration.factor * self.space_z.scale**2
        return Mapped(self.space_z.natural(mean), variance * scale, share=self.calibration.share)

    def knowing(self, keep: NDArray[np.bool_]) -> GaussianProcess:
        """The same kernel on a part (N,) of the key poses.

        Args:
            keep: (N,) which key poses stay.

        Returns:
            The smaller mapper.
        """
        return replace(self, keys_y=self.keys_y[keep], keys_z=self.keys_z[keep])

    def to_arrays(self) -> Arrays:
        """Plain arrays; see :func:`physretarget.mapping.from_arrays`."""
        return {
            "mapper": np.array(self.name),
            "logs": self.kernel.logs(),
            "centre_y": self.space_y.centre,
            "centre_z": self.space_z.centre,
            "scales": np.array([self.space_y.scale, self.space_z.scale]),
            "keys_y": self.keys_y,
            "keys_z": self.keys_z,
            "factor": np.array(self.calibration.factor),
            "share": self.calibration.share,
        }

    @classmethod
    def from_arrays(cls, arrays: Arrays) -> GaussianProcess:
        """Rebuild what :meth:`to_arrays` gave.

        Args:
            arrays: Name → array.

        Returns:
            The mapper.
        """
        a = {k: np.asarray(v, dtype=np.float64) for k, v in arrays.items() if k != "mapper"}
        return cls(
            kernel=Kernel.from_logs(a["logs"]),
            space_y=Space(a["centre_y"], float(a["scales"][0])),
            space_z=Space(a["centre_z"], float(a["scales"][1])),
            keys_y=a["keys_y"],
            keys_z=a["keys_z"],
            calibration=Calibration(float(a["factor"]), a["share"]),
        )


def marginal(
    logs: Array, squared: Array, inner: Array, scatter: Array, width: int
) -> tuple[float, Array]:
    """Negative log-likelihood of the five kernel logs, with gradient."""
    kernel = Kernel.from_logs(logs)
    value, sensitivity = likelihood(kernel.gram(squared, inner), scatter, width)
    return value, gram_gradient(kernel, squared, inner, sensitivity)[0]


@one_thread
def fit_gp(y: Array, z: Array, *, calibrated: bool = True) -> GaussianProcess:
    """Fit the five kernel parameters to key poses y (N, DY), z (N, DZ) by their likelihood."""
    y, z = checked_pairs(y, z)
    space_y, space_z = Space.of(y), Space.of(z)
    keys_y, keys_z = space_y.normal(y), space_z.normal(z)
    squared, inner = squared_distances(keys_y, keys_y), keys_y @ keys_y.T
    scatter = keys_z @ keys_z.T
    median = max(float(np.median(squared[np.triu_indices_from(squared, k=1)])), 1e-6)
    box = [tuple(np.log(bound)) for bound in BOUNDS]
    best = None
    for start in STARTS:
        found = minimize(
            marginal,
            np.clip(
                Kernel(1.0, start / median, 1e-2, 1e-4, 1.0 / y.shape[1]).logs(), *np.transpose(box)
            ),
            args=(squared, inner, scatter, z.shape[1]),
            jac=True,
            method="L-BFGS-B",
            bounds=box,
        )
        if best is None or found.fun < best.fun:
            best = found
    assert best is not None
    none = Calibration.none(keys_z.shape[1])
    mapper = GaussianProcess(Kernel.from_logs(best.x), space_y, space_z, keys_y, keys_z, none)
    if not calibrated:
        return mapper

    def left_out(keep: NDArray[np.bool_], frames: Array) -> tuple[Array, Array]:
        return mapper.knowing(keep).posterior.at(frames)

    return replace(mapper, calibration=calibrate(left_out, keys_y, keys_z))
