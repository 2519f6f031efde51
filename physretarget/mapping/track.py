"""Mapping frames one by one, in real time: Yamane 2010 eq. (5) warm-started from the last frame.

The search is the one of :mod:`physretarget.mapping.search`, with its objective and its guide;
only the optimiser differs. A few quasi-Newton steps from a start near the optimum replace L-BFGS
from afar: they begin with the expected curvature of a Gaussian, learn the rest of it on the way,
and keep what they learned for the next frame.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from physretarget.mapping.gplvm import SharedGPLVM
from physretarget.mapping.protocol import Mapped, Mapper, checked_frames
from physretarget.mapping.regression import Posterior

__all__ = ["Tracker", "track"]

Array = NDArray[np.float64]

STEPS, FIRST = 6, 20
"""Steps per frame at most, and in the first one."""
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


class _Single:
    """A posterior that is asked for one point at a time, what does not depend on it multiplied
    out beforehand.
    """

    def __init__(self, posterior: Posterior) -> None:
        kernel, inputs = posterior.kernel, posterior.inputs
        self.kernel, self.inputs, self.inverse = kernel, inputs, posterior.inverse
        self.weights = posterior.weights
        self.along = np.ascontiguousarray(kernel.sharpness * inputs)
        self.linear = np.ascontiguousarray(kernel.linear * inputs)
        self.constant = kernel.signal + kernel.offset + kernel.noise
        self.base = math.log(kernel.signal) - 0.5 * kernel.sharpness * np.sum(inputs**2, axis=1)

    def bump(self, x: Array) -> Array:
        """θ1 exp(-θ2/2 |x - x_n|²) of the N inputs (N,) at x (DX,)."""
        power = self.along @ x
        power += self.base - 0.5 * self.kernel.sharpness * float(x @ x)
        bump: Array = np.exp(power, out=power)
        return bump

    def at(self, x: Array) -> tuple[Array, float]:
        """Mean (D,) and variance at x (DX,), see :meth:`Posterior.at`."""
        k = self.cross(self.bump(x), x)
        explained = float(k @ (self.inverse @ k))
        return k @ self.weights, max(self.prior_variance(x) - explained, self.kernel.noise)

    def cross(self, bump: Array, x: Array) -> Array:
        """k (N,) between x (DX,) and the inputs, of which ``bump`` is known."""
        k: Array = self.linear @ x
        k += bump
        k += self.kernel.offset
        return k

    def prior_variance(self, x: Array) -> float:
        """k(x, x), noise included."""
        return self.constant + self.kernel.linear * float(x @ x)


class _LatentTracker:
    """Follows the optimum of the posterior over the latent space from frame to frame."""

    def __init__(self, model: SharedGPLVM) -> None:
        self.model = model
        self.actor = _Single(model.actor)
        self.guide = _Single(model.guide.posterior)
        self.character = _Single(model.character)
        count = len(model.latent)
        # Rows 0 to N: K⁻¹; N to 2N: misses without the features. One product gives both.
        self.both = np.concatenate([model.actor.inverse, model.actor.scatter])
        scatter = model.character.scatter
        moment = scatter * (model.latent @ model.latent.T)
        self.decoding = np.concatenate([moment, scatter])
        self.count = count
        self.x: Array | None = None
        self.led: Array | None = None
        self.downhill: Array | None = None

    def next(self, y: Array) -> Mapped:
        model = self.model
        frame = model.space_y.normal(checked_frames(y[None], model.space_y.centre.size)[0])
        led, variance = self._led(frame)
        precision = model.search.guide / max(variance, 1e-12)
        problem = _Frame(self, frame, led, precision)
        at = problem.at(led)
        if self.x is not None and self.led is not None:
            before = problem.at(self.x + (led - self.led))
            at = before if before.value < at.value else at
        self.x, self.led = self._descended(problem, at), led
        return self._decoded(self.x, variance)

    def _led(self, frame: Array) -> tuple[Array, float]:
        """Latent point (DX,) that the guide leads to, and its variance per coordinate."""
        guide = self.model.guide
        mean, variance = self.guide.at(guide.space_y.normal(frame))
        return guide.space_z.natural(mean), variance * guide.space_z.scale**2

    def _descended(self, frame: _Frame, point: _Point) -> Array:
        """A few steps downhill; their curvature is that of the frame before while it foretells
        the gain.
        """
        gradient = frame.gradient(point)
        fresh, downhill = False, self.downhill
        for _ in range(STEPS if self.x is not None else FIRST):
            if downhill is None:
                fresh, downhill = True, _inverse(frame.curvature(point))
            step = downhill @ gradient
            new = frame.at(point.x - step)
            gain = point.value - new.value
            if 0.0 <= gain < REST * frame.width:
                point = new
                break
            after = frame.gradient(new)
            if gain < TRUST * 0.5 * float(gradient @ step) and not fresh:
                downhill = None
            else:
                downhill = _learned(downhill, step, gradient - after)
            if gain > 0.0:
                point, gradient = new, after
        self.downhill = downhill
        return point.x

    def _decoded(self, x: Array, doubt: float) -> Mapped:
        """As :meth:`SharedGPLVM.decode` does."""
        model, kernel, count = self.model, self.character.kernel, self.count
        bump = self.character.bump(x)
        k = self.character.cross(bump, x)
        explained = float(k @ (model.character.inverse @ k))
        pull = kernel.sharpness * bump
        whole = pull + kernel.linear
        spread = self.decoding[count:] @ pull
        square = float(whole @ (self.decoding[:count] @ whole))
        square -= 2.0 * float((whole * (model.latent @ x)) @ spread)
        square += float(x @ x) * float(pull @ spread)
        variance = max(self.character.prior_variance(x) - explained, kernel.noise)
        variance += doubt * max(square, 0.0) / self.character.weights.shape[1]
        return Mapped(
            model.space_z.natural(k @ self.character.weights)[None],
            np.array([variance * model.calibration.factor * model.space_z.scale**2]),
            x[None],
            model.calibration.share,
        )


class _Point:
    """A latent point with everything that its value and gradient need."""

    __slots__ = ("bump", "pulled", "residual", "solved", "value", "variance", "x")

    def __init__(self, frame: _Frame, x: Array) -> None:
        tracker = frame.tracker
        kernel, count = tracker.actor.kernel, tracker.count
        self.x = x
        self.bump = tracker.actor.bump(x)
        k = tracker.actor.cross(self.bump, x)
        product = tracker.both @ k
        self.solved, self.pulled = product[:count], product[count:]
        self.variance = max(tracker.actor.prior_variance(x) - float(self.solved @ k), kernel.noise)
        self.pulled -= frame.pulled
        missed = float(k @ self.pulled) - float(k @ frame.pulled)
        self.residual = max(frame.energy + missed, 0.0)
        from_led = x - frame.led
        self.value = 0.5 * (
            frame.width * math.log(self.variance)
            + self.residual / self.variance
            + frame.precision * float(from_led @ from_led)
        )


class _Frame:
    """The negative log-posterior of one frame as a function of the latent point."""

    def __init__(self, tracker: _LatentTracker, frame: Array, led: Array, precision: float) -> None:
        self.tracker, self.led, self.precision = tracker, led, precision
        self.pulled, self.energy = tracker.actor.weights @ frame, float(frame @ frame)
        self.width = len(frame)

    def at(self, x: Array) -> _Point:
        return _Point(self, x)

    def gradient(self, at: _Point) -> Array:
        """By the latent point (DX,)."""
        weight = (self.width - at.residual / at.variance) / at.variance
        pull = at.pulled / at.variance
        pull -= weight * at.solved
        actor = self.tracker.actor
        gradient: Array = pull @ actor.linear
        pull *= at.bump
        gradient += pull @ actor.along
        gradient += (
            weight * actor.kernel.linear - actor.kernel.sharpness * float(pull.sum())
        ) * at.x
        gradient += self.precision * (at.x - self.led)
        return gradient

    def curvature(self, at: _Point) -> Array:
        """The expected one (DX, DX): Fisher's information and the prior."""
        actor = self.tracker.actor
        slope = actor.along - actor.kernel.sharpness * at.x
        slope *= at.bump[:, None]
        slope += actor.linear
        by_variance = at.solved @ slope - actor.kernel.linear * at.x
        by_mean = slope.T @ actor.weights
        curvature: Array = by_mean @ by_mean.T
        curvature /= at.variance
        curvature += 2.0 * self.width / at.variance**2 * np.outer(by_variance, by_variance)
        curvature.ravel()[:: len(at.x) + 1] += self.precision
        return curvature


def _inverse(matrix: Array) -> Array:
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)


def _learned(downhill: Array, step: Array, change: Array) -> Array:
    """The inverse curvature (DX, DX) after a step that changed the gradient so (BFGS)."""
    along = float(step @ change)
    if along <= 1e-12 * float(step @ step):
        return downhill
    moved = downhill @ change
    share = (0.5 + 0.5 * float(change @ moved) / along) * step - moved
    new = np.outer(share / along, step)
    new += new.T
    new += downhill
    return new
