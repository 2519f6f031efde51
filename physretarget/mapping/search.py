"""Where in the latent space a frame lies: Yamane 2010 eq. (5), for all frames at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget.mapping.kernels import squared_distances
from physretarget.mapping.lbfgs import Rows, minimise
from physretarget.mapping.regression import Posterior

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SearchSettings:
    """How latent points are searched.

    ``guide``: weight of the guide, a Gaussian process from actor features straight to latent
    points: it gives every frame its start and a normal prior, as wide as the guide is unsure,
    divided by this weight. Zero means the paper's search instead: from the nearest key pose,
    by likelihood and the unit prior ½|x|², with the previous frame's solution as second start.
    ``iterations`` of L-BFGS per start; ``decrease``: gain per iteration, in log-likelihood per
    feature, at which a frame rests; ``sweeps``: how often the previous frame's solution is
    offered; ``leap``: step from frame to frame above which it is offered, as a share of the
    mean distance between neighbouring key poses. The last two matter without a guide only.
    """

    guide: float = 5.0
    iterations: int = 60
    decrease: float = 1e-6
    sweeps: int = 6
    leap: float = 0.1


@dataclass(frozen=True)
class Prior:
    """Normal priors of latent points: mean (T, DX) and precision (T,)."""

    mean: Array
    precision: Array

    @classmethod
    def unit(cls, frames: int, dims: int) -> Prior:
        """The prior of learning, ½|x|²."""
        return cls(np.zeros((frames, dims)), np.ones(frames))


@dataclass(frozen=True)
class Likelihood:
    """Negative log-posterior per feature of frames y (T, D), as a function of latent points.

    A prediction never leaves the span of the key poses, at most N directions: only the frames'
    coordinates in it matter, ``within`` (T, r); what lies outside adds the constant ``outside``
    (T,). ``weights`` (N, r) are those of the posterior in the same coordinates.
    """

    posterior: Posterior
    width: int
    prior: Prior
    weights: Array
    within: Array
    outside: Array

    @classmethod
    def of(cls, posterior: Posterior, y: Array, prior: Prior) -> Likelihood:
        """For normal frames y (T, D)."""
        basis, upper = np.linalg.qr(posterior.weights.T)
        within = y @ basis
        outside = np.sum((y - within @ basis.T) ** 2, axis=1)
        return cls(posterior, y.shape[1], prior, upper.T, within, outside)

    def __call__(self, x: Array, rows: Rows) -> tuple[Array, Array]:
        """Values (n,) and gradients (n, DX) for frames ``rows`` at x (n, DX)."""
        kernel, inputs = self.posterior.kernel, self.posterior.inputs
        bump = kernel.bump(squared_distances(x, inputs))
        k = bump + kernel.offset + kernel.linear * (x @ inputs.T)
        solved = k @ self.posterior.inverse
        variance = kernel.prior_variance(x) - np.einsum("tn,tn->t", solved, k)
        variance = np.maximum(variance, kernel.noise)
        miss = k @ self.weights - self.within[rows]
        residual = self.outside[rows] + np.einsum("tr,tr->t", miss, miss)
        value = 0.5 * self.width * np.log(variance) + 0.5 * residual / variance
        by_variance = 0.5 * self.width / variance - 0.5 * residual / variance**2
        by_k = (miss @ self.weights.T) / variance[:, None] - 2.0 * by_variance[:, None] * solved
        pull = kernel.sharpness * by_k * bump
        gradient = (pull + kernel.linear * by_k) @ inputs
        gradient += (2.0 * kernel.linear * by_variance - pull.sum(axis=1))[:, None] * x
        away, precision = x - self.prior.mean[rows], self.prior.precision[rows]
        value += 0.5 * precision * np.einsum("td,td->t", away, away)
        gradient += precision[:, None] * away
        return value / self.width, gradient / self.width


def locate(
    posterior: Posterior, y: Array, start: Array, prior: Prior, settings: SearchSettings
) -> Array:
    """Latent points (T, DX) of normal frames y (T, D), each searched from its ``start``."""
    likelihood = Likelihood.of(posterior, y, prior)
    return _descend(likelihood, start, np.arange(y.shape[0]), settings)[0]


def locate_as_paper(posterior: Posterior, keys: Array, y: Array, settings: SearchSettings) -> Array:
    """Latent points (T, DX) of normal frames y (T, D), in order of time.

    ``keys`` (N, D) are the normal key poses. Every frame starts from its nearest key pose. Where
    that leaps from the previous frame, the previous frame's solution is tried as a start and the
    better one kept, until no frame changes any more.
    """
    prior = Prior.unit(y.shape[0], posterior.inputs.shape[1])
    likelihood = Likelihood.of(posterior, y, prior)
    nearest = squared_distances(y, keys).argmin(axis=1)
    x, value = _descend(likelihood, posterior.inputs[nearest], np.arange(y.shape[0]), settings)
    leap = settings.leap * neighbour_distance(posterior.inputs)
    offered = np.arange(1, y.shape[0])
    for _ in range(settings.sweeps):
        step = np.linalg.norm(x[offered] - x[offered - 1], axis=1)
        offered = offered[step > leap]
        if offered.size == 0:
            break
        x_new, value_new = _descend(likelihood, x[offered - 1], offered, settings)
        taken = value_new < value[offered] - settings.decrease
        frames = offered[taken]
        x[frames], value[frames] = x_new[taken], value_new[taken]
        offered = frames[frames < y.shape[0] - 1] + 1
    return x


def neighbour_distance(inputs: Array) -> float:
    """Mean distance of the key poses (N, DX) to their nearest neighbours."""
    squared = squared_distances(inputs, inputs)
    np.fill_diagonal(squared, np.inf)
    return float(np.sqrt(squared.min(axis=1)).mean())


def _descend(
    likelihood: Likelihood, start: Array, frames: Rows, settings: SearchSettings
) -> tuple[Array, Array]:
    """Minimise for ``frames`` (n,) from ``start`` (n, DX)."""
    found = minimise(
        lambda x, rows: likelihood(x, frames[rows]),
        start,
        iterations=settings.iterations,
        decrease=settings.decrease,
    )
    return found.x, found.value
