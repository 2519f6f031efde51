"""Shared Gaussian process latent variable model (Yamane 2010, section 4.2).

Two observation spaces, actor features Y and character features Z, hang on one set of latent
points X, one kernel each.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from physretarget.mapping.calibration import Calibration, calibrate
from physretarget.mapping.gp import GaussianProcess, fit_gp
from physretarget.mapping.kcca import initial_latent
from physretarget.mapping.kernels import (
    Kernel,
    gram_gradient,
    position_gradient,
    squared_distances,
)
from physretarget.mapping.protocol import (
    Array,
    Arrays,
    Mapped,
    Space,
    checked_frames,
    checked_pairs,
)
from physretarget.mapping.regression import Posterior, likelihood
from physretarget.mapping.search import Prior, SearchSettings, locate, locate_as_paper
from physretarget.mapping.threads import one_thread

_SIGNAL, _SHARPNESS, _OFFSET = (1e-2, 1e2), (1e-3, 1e1), (1e-6, 1e1)
_BLOCK = 8192  # frames searched at a time: the search's arrays are the largest of a long capture
_LINEAR = (1e-6, 1e2)
BOUNDS_Y = (_SIGNAL, _SHARPNESS, _OFFSET, (1e-2, 1e-1), _LINEAR)
BOUNDS_Z = (_SIGNAL, _SHARPNESS, _OFFSET, (1e-3, 1e-2), _LINEAR)
"""Boxes of the kernel parameters (θ1, θ2, θ3, 1/β, θ4), features scaled to unit RMS spread. The
prior 1/Φ is improper: without bounds the likelihood of centred data grows for ever as the offset
goes to zero. The noise 1/β lies on its lower bound in both spaces, and must: no key pose is posed
twice, so nothing in the data is noise, and with 30 latent coordinates per key pose the latent
points explain all of it. The likelihood cannot tell noise from detail; whole sequences left out
can: 1e-2 for the actor (a tenth of the spread; an actor never takes a pose twice to better than
that) and 1e-3 for the character (3 %: a key pose is meant as posed and has to come back)."""


@dataclass(frozen=True)
class JointLikelihood:
    """The negative log of Yamane 2010 eq. (2), constants left out, as a function of one vector.

    The vector holds the kernel logs of Y (5,), of Z (5,), then X (N * dims,).
    """

    scatter_y: Array
    scatter_z: Array
    width_y: int
    width_z: int
    dims: int

    def __call__(self, vector: Array) -> tuple[float, Array]:
        """Value and gradient."""
        x = vector[10:].reshape(-1, self.dims)
        squared, inner = squared_distances(x, x), x @ x.T
        value = 0.5 * float(np.sum(x**2))
        gradient_x = x.copy()
        by_logs = []
        spaces = ((self.scatter_y, self.width_y), (self.scatter_z, self.width_z))
        for logs, (scatter, width) in zip((vector[:5], vector[5:10]), spaces, strict=True):
            kernel = Kernel.from_logs(logs)
            cost, sensitivity = likelihood(kernel.gram(squared, inner), scatter, width)
            by_log, by_distance = gram_gradient(kernel, squared, inner, sensitivity)
            # -log P(Φ) = log θ1 + log θ2 + log θ3 + log β + log θ4, and log β = -log(1/β)
            prior = np.array([1.0, 1.0, 1.0, -1.0, 1.0])
            value += cost + float(prior @ logs)
            by_logs.append(by_log + prior)
            gradient_x += position_gradient(x, by_distance) + 2.0 * kernel.linear * sensitivity @ x
        return value, np.concatenate([*by_logs, gradient_x.ravel()])


@dataclass(frozen=True)
class SharedGPLVM:
    """A learned shared GPLVM.

    ``latent`` (N, DX); ``keys_y`` (N, DY) and ``keys_z`` (N, DZ) in normal units. ``guide``
    leads from actor features straight to latent points and keeps the search on one path: the
    likelihood alone has several optima per frame, and jumps between them.
    """

    latent: Array
    kernel_y: Kernel
    kernel_z: Kernel
    space_y: Space
    space_z: Space
    keys_y: Array
    keys_z: Array
    guide: GaussianProcess
    calibration: Calibration
    search: SearchSettings = field(default_factory=SearchSettings)
    name: str = "sgplvm"

    def __post_init__(self) -> None:
        actor = Posterior.of(self.kernel_y, self.latent, self.keys_y)
        character = Posterior.of(self.kernel_z, self.latent, self.keys_z)
        object.__setattr__(self, "_actor", actor)
        object.__setattr__(self, "_character", character)

    @property
    def actor(self) -> Posterior:
        """Latent point → actor features."""
        posterior: Posterior = self._actor  # type: ignore[attr-defined]
        return posterior

    @property
    def character(self) -> Posterior:
        """Latent point → character features."""
        posterior: Posterior = self._character  # type: ignore[attr-defined]
        return posterior

    @one_thread
    def predict(self, y: Array) -> Mapped:
        """Map frames y (T, DY): search the latent points (eq. (5)), then eqs. (3) and (4).

        With the guide every frame is searched on its own, so that frames mapped one by one
        and all at once agree; the paper's search wants them in order of time.

        Args:
            y: (T, DY) actor features, m.

        Returns:
            Mean (T, DZ) m and variance (T,) m².
        """
        frames = self.space_y.normal(checked_frames(y, self.space_y.centre.size))
        if self.search.guide == 0 or len(frames) <= _BLOCK:
            return self.decode(*self.located(frames))
        blocks = [
            self.decode(*self.located(frames[start : start + _BLOCK]))
            for start in range(0, len(frames), _BLOCK)
        ]
        return Mapped(
            np.concatenate([block.mean for block in blocks]),
            np.concatenate([block.variance for block in blocks]),
            np.concatenate([block.latent for block in blocks if block.latent is not None]),
            self.calibration.share,
        )

    def located(self, frames: Array) -> tuple[Array, Array]:
        """Latent points (T, DX) of normal frames (T, DY), and how unsure each coordinate is (T,).

        The guide's variance stands for the latter: the likelihood of a frame that is like no key
        pose is as sharp as that of any other, about a wrong point.

        Args:
            frames: (T, DY) frames in normal units.

        Returns:
            Latent points (T, DX), and variance (T,) of each coordinate.
        """
        led = self.guide.predict(frames)
        if self.search.guide == 0:
            return locate_as_paper(self.actor, self.keys_y, frames, self.search), led.variance
        prior = Prior(led.mean, self.search.guide / np.maximum(led.variance, 1e-12))
        return locate(self.actor, frames, led.mean, prior, self.search), led.variance

    def decode(self, latent: Array, doubt: Array | float = 0.0) -> Mapped:
        """Character features at latent points (T, DX) known but for a variance ``doubt`` (T,).

        Args:
            latent: (T, DX) latent points.
            doubt: (T,) variance of each latent coordinate.

        Returns:
            Mean (T, DZ) m and variance (T,) m².
        """
        mean, variance = self.character.at(latent)
        variance = variance + doubt * self.character.slope(latent)
        return Mapped(
            self.space_z.natural(mean),
            variance * self.calibration.factor * self.space_z.scale**2,
            latent,
            self.calibration.share,
        )

    def as_paper(self) -> SharedGPLVM:
        """The same model, searched from the nearest key pose, its variance not calibrated."""
        return replace(
            self,
            search=replace(self.search, guide=0.0),
            calibration=Calibration.none(self.keys_z.shape[1]),
        )

    def knowing(self, keep: NDArray[np.bool_]) -> SharedGPLVM:
        """The same kernels and latent points, a part (N,) of the key poses.

        Args:
            keep: (N,) which key poses stay.

        Returns:
            The smaller mapper.
        """
        return replace(
            self,
            latent=self.latent[keep],
            keys_y=self.keys_y[keep],
            keys_z=self.keys_z[keep],
            guide=self.guide.knowing(keep),
        )

    def to_arrays(self) -> Arrays:
        """Plain arrays; see :func:`physretarget.mapping.from_arrays`."""
        return {
            "mapper": np.array(self.name),
            "latent": self.latent,
            "logs_y": self.kernel_y.logs(),
            "logs_z": self.kernel_z.logs(),
            "centre_y": self.space_y.centre,
            "centre_z": self.space_z.centre,
            "scales": np.array([self.space_y.scale, self.space_z.scale]),
            "keys_y": self.keys_y,
            "keys_z": self.keys_z,
            "factor": np.array(self.calibration.factor),
            "share": self.calibration.share,
            "guide": np.array(self.search.guide),
            **{f"guide_{k}": v for k, v in self.guide.to_arrays().items()},
        }

    @classmethod
    def from_arrays(cls, arrays: Arrays) -> SharedGPLVM:
        """Rebuild what :meth:`to_arrays` gave.

        Args:
            arrays: Name → array.

        Returns:
            The mapper.
        """
        names = {"mapper", "guide_mapper"}
        a = {k: np.asarray(v, dtype=np.float64) for k, v in arrays.items() if k not in names}
        guide = {k[6:]: v for k, v in a.items() if k.startswith("guide_")}
        return cls(
            latent=a["latent"],
            kernel_y=Kernel.from_logs(a["logs_y"]),
            kernel_z=Kernel.from_logs(a["logs_z"]),
            space_y=Space(a["centre_y"], float(a["scales"][0])),
            space_z=Space(a["centre_z"], float(a["scales"][1])),
            keys_y=a["keys_y"],
            keys_z=a["keys_z"],
            guide=GaussianProcess.from_arrays(dict(guide)),
            calibration=Calibration(float(a["factor"]), a["share"]),
            search=SearchSettings(guide=float(a["guide"])),
        )


@one_thread
def fit_gplvm(
    y: Array,
    z: Array,
    *,
    dims: int = 30,
    iterations: int = 70,
    seed: int = 0,
    calibrated: bool = True,
) -> SharedGPLVM:
    """Learn from key poses y (N, DY) and z (N, DZ).

    ``dims`` latent dimensions and ``iterations`` of L-BFGS as in the paper. Stopping there
    matters: run to convergence, the latent points overfit, and unseen poses get worse.
    """
    y, z = checked_pairs(y, z)
    space_y, space_z = Space.of(y), Space.of(z)
    keys_y, keys_z = space_y.normal(y), space_z.normal(z)
    joint = JointLikelihood(keys_y @ keys_y.T, keys_z @ keys_z.T, y.shape[1], z.shape[1], dims)
    start = initial_latent(keys_y, keys_z, dims, np.random.default_rng(seed))
    squared = squared_distances(start, start)
    width = float(np.median(squared[np.triu_indices_from(squared, k=1)]))
    logs = Kernel(1.0, 1.0 / max(width, 1e-3), 1e-2, 3e-4, 1.0 / dims).logs()
    box = [tuple(np.log(bound)) for bound in (*BOUNDS_Y, *BOUNDS_Z)] + [(None, None)] * start.size
    found = minimize(
        joint,
        np.concatenate([logs, logs, start.ravel()]),
        jac=True,
        method="L-BFGS-B",
        bounds=box,
        options={"maxiter": iterations, "maxfun": 2 * iterations, "maxcor": 20, "ftol": 1e-7},
    )
    latent = found.x[10:].reshape(start.shape)
    model = SharedGPLVM(
        latent=latent,
        kernel_y=Kernel.from_logs(found.x[:5]),
        kernel_z=Kernel.from_logs(found.x[5:10]),
        space_y=space_y,
        space_z=space_z,
        keys_y=keys_y,
        keys_z=keys_z,
        guide=fit_gp(keys_y, latent, calibrated=False),
        calibration=Calibration.none(keys_z.shape[1]),
    )
    if not calibrated:
        return model

    def left_out(keep: NDArray[np.bool_], frames: Array) -> tuple[Array, Array]:
        part = model.knowing(keep)
        x, doubt = part.located(frames)
        mean, variance = part.character.at(x)
        return mean, variance + doubt * part.character.slope(x)

    return replace(model, calibration=calibrate(left_out, keys_y, keys_z))
