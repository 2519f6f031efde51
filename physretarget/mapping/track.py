"""Mapping frames one by one, in real time: Yamane 2010 eq. (5) warm-started from the last frame.

The search is the one of :mod:`physretarget.mapping.search`, with its objective and its guide;
only the optimiser differs. A few scoring steps (Gauss-Newton with the expected curvature of a
Gaussian) from a start near the optimum replace L-BFGS from afar.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from physretarget.mapping.gplvm import SharedGPLVM
from physretarget.mapping.protocol import Mapped, Mapper, checked_frames

__all__ = ["Tracker", "track"]

Array = NDArray[np.float64]

STEPS = 4
"""Steps per frame at most."""
TRUST = 0.3
"""Share of the predicted gain below which the curvature is taken anew."""
REST = 3e-5
"""Decrease of the negative log-posterior per feature at which a frame rests."""


class Tracker(Protocol):
    """Maps frames as they come; remembers the last one."""

    def next(self, y: Array) -> Mapped:
        """Map one frame y (DY,); arrays of the answer have one row."""
        ...


def track(mapper: Mapper) -> Tracker:
    """A tracker for any mapper; those without a search are just asked."""
    if isinstance(mapper, SharedGPLVM) and mapper.search.guide > 0:
        return _LatentTracker(mapper)
    return _Asked(mapper)


class _Asked:
    def __init__(self, mapper: Mapper) -> None:
        self.mapper = mapper

    def next(self, y: Array) -> Mapped:
        return self.mapper.predict(y[None])


class _LatentTracker:
    """Follows the optimum of the posterior over the latent space from frame to frame."""

    def __init__(self, model: SharedGPLVM) -> None:
        self.model = model
        self.weights = model.actor.weights
        self.gram = model.actor.scatter  # (N, N): misses without the features
        self.guide = model.guide.posterior
        self.x: Array | None = None
        self.led: Array | None = None

    def next(self, y: Array) -> Mapped:
        model = self.model
        frame = model.space_y.normal(checked_frames(y[None], model.space_y.centre.size))
        led, variance = self._led(frame)
        precision = model.search.guide / max(variance, 1e-12)
        pulled, energy = self.weights @ frame[0], float(frame[0] @ frame[0])
        problem = _Frame(self, pulled, energy, led, precision)
        at = problem.at(led)
        if self.x is not None and self.led is not None:
            before = problem.at(self.x + (led - self.led))
            at = before if before.value < at.value else at
        self.x, self.led = problem.descended(at), led
        return model.decode(self.x[None], variance)

    def _led(self, frame: Array) -> tuple[Array, float]:
        guide = self.model.guide
        mean, variance = self.guide.at(guide.space_y.normal(frame))
        return guide.space_z.natural(mean)[0], float(variance[0]) * guide.space_z.scale**2


class _Point:
    """A latent point with everything that its value needs."""

    __slots__ = ("bump", "k", "pulled", "residual", "solved", "value", "variance", "x")

    def __init__(self, frame: _Frame, x: Array) -> None:
        posterior = frame.tracker.model.actor
        kernel = posterior.kernel
        away = x - posterior.inputs
        self.x = x
        self.bump = kernel.bump(np.square(away, out=away).sum(axis=1))
        self.k = self.bump + kernel.offset
        self.solved = posterior.inverse @ self.k
        self.variance = max(kernel.prior_variance - float(self.solved @ self.k), kernel.noise)
        self.pulled = frame.tracker.gram @ self.k
        missed = float(self.k @ self.pulled) - 2.0 * float(self.k @ frame.pulled)
        self.residual = max(frame.energy + missed, 0.0)
        from_led = x - frame.led
        self.value = 0.5 * (
            frame.width * np.log(self.variance)
            + self.residual / self.variance
            + frame.precision * float(from_led @ from_led)
        )


class _Frame:
    """The negative log-posterior of one frame as a function of the latent point."""

    def __init__(
        self, tracker: _LatentTracker, pulled: Array, energy: float, led: Array, precision: float
    ) -> None:
        self.tracker, self.pulled, self.energy = tracker, pulled, energy
        self.led, self.precision = led, precision
        self.width = tracker.model.space_y.centre.size

    def at(self, x: Array) -> _Point:
        return _Point(self, x)

    def descended(self, point: _Point) -> Array:
        """The curvature changes little on the way: it is kept while it predicts the gain."""
        downhill: Array = np.empty((0, 0))
        stale, damping = True, 0.0
        for _ in range(STEPS):
            slope, gradient = self._slope(point)
            if stale:
                downhill = np.asarray(
                    np.linalg.inv(self._curvature(point, slope, damping)), dtype=np.float64
                )
            step = downhill @ gradient
            new = self.at(point.x - step)
            gain = point.value - new.value
            stale = gain < TRUST * 0.5 * float(gradient @ step)
            if gain < 0.0:
                damping = max(4.0 * damping, 1.0)
                continue
            point, damping = new, 0.0
            if gain < REST * self.width:
                break
        return point.x

    def _slope(self, at: _Point) -> tuple[Array, Array]:
        """Derivatives of the kernel by x (N, DX), and the gradient (DX,)."""
        posterior = self.tracker.model.actor
        slope = (posterior.kernel.sharpness * at.bump)[:, None] * (posterior.inputs - at.x)
        weight = (self.width - at.residual / at.variance) / at.variance
        pull = (at.pulled - self.pulled) / at.variance - weight * at.solved
        return slope, pull @ slope + self.precision * (at.x - self.led)

    def _curvature(self, at: _Point, slope: Array, damping: float) -> Array:
        """The expected one (DX, DX): Fisher's information and the prior."""
        by_variance = -2.0 * (at.solved @ slope)
        curvature = slope.T @ (self.tracker.gram @ slope) / at.variance
        curvature += 0.5 * self.width / at.variance**2 * np.outer(by_variance, by_variance)
        diagonal = curvature.ravel()[:: len(at.x) + 1]
        diagonal += self.precision
        diagonal *= 1.0 + damping
        result: Array = curvature
        return result
