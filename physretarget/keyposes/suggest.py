"""Which frames to pose next, and why: Yamane 2010, section 7, wished for this.

Posing a frame tells the mapper something about every frame that is like it. How much is known
before anything is posed: the variance of a Gaussian process depends on which frames are posed,
not on how. Frames are chosen one after the other, each the one whose variance, given all that is
posed or chosen so far, is largest: new ground first, and nothing twice. Taking the variance away
from all frames together instead spends key poses on what lasts long, not on what differs; it did
worse (docs/measured/suggest.md).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget.errors import InputError, UsageError
from physretarget.mapping.kernels import squared_distances

__all__ = ["MOST_FRAMES", "Suggestion", "suggest", "uncertainty"]

Array = NDArray[np.float64]

MOST_FRAMES = 3000
"""Candidates at most: their covariances are one dense matrix (72 MB)."""
WIDTH = 2.0
"""Width of the kernel as a multiple of the median distance between frames."""
NOISE = 1e-3
"""Share of the signal's variance that posing a frame leaves at that frame."""
STANDS_FOR = 0.5
"""A pose stands for the frames whose variance it lowers by at least this share."""


@dataclass(frozen=True, kw_only=True)
class Suggestion:
    """One frame to pose.

    Attributes:
        index: which candidate.
        score: variance of this frame in its turn, as a share of that of the frame that is
            least known before anything is chosen: 1 for the first, then falling.
        stands_for: share of all candidates whose variance it at least halves.
        nearest: key pose (number in ``posed``, or ``len(posed)`` + number of an earlier
            suggestion) that is most like it; None for the first of all.
        distance: RMS distance of the actor's feature points to that pose's, m.
    """

    index: int
    score: float
    stands_for: float
    nearest: int | None
    distance: float


def suggest(frames: Array, posed: Array, *, count: int = 10) -> tuple[Suggestion, ...]:
    """The frames whose posing would help the mapper most, best first.

    Args:
        frames: (M, DY) actor features of the candidates, see :data:`MOST_FRAMES`.
        posed: (N, DY) those of the key poses so far; N may be 0.
        count: how many to choose; fewer come back where nothing is left to be learned.

    Raises:
        UsageError: count is below one, or there are too many candidates.
        InputError: there are no candidates, or widths differ.
    """
    if count < 1:
        raise UsageError(f"count is {count}; it must be at least 1.")
    if not len(frames):
        raise InputError("there are no frames to choose from.")
    if len(frames) > MOST_FRAMES:
        raise UsageError(f"{len(frames)} candidates are given; {MOST_FRAMES} is the most.")
    posed = np.asarray(posed, dtype=np.float64)
    if len(posed) and posed.shape[1] != frames.shape[1]:
        raise InputError(f"frames have {frames.shape[1]} features, key poses {posed.shape[1]}.")
    posed = posed.reshape(-1, frames.shape[1])
    kernel = _width(frames)
    return _greedy(_conditioned(kernel, frames, posed), kernel, frames, posed, count)


def uncertainty(frames: Array, posed: Array) -> Array:
    """(M,) standard deviation that is left of each frame, 0 to 1, once ``posed`` is posed.

    Args:
        frames: (M, DY) actor features.
        posed: (N, DY) those of the key poses; N may be 0.
    """
    if not len(posed):
        return np.ones(len(frames))
    kernel = _width(frames)
    gram = kernel(posed, posed) + kernel.noise * np.eye(len(posed))
    cross = kernel(posed, frames)
    known = np.einsum("nm,nm->m", cross, np.linalg.solve(gram, cross))
    left: Array = np.sqrt(np.clip(1.0 - known, 0.0, 1.0))
    return left


@dataclass(frozen=True)
class _Width:
    """An RBF of unit signal with squared width 1 / ``sharpness``, in metres."""

    sharpness: float
    noise: float

    def __call__(self, a: Array, b: Array) -> Array:
        result: Array = np.exp(-0.5 * self.sharpness * squared_distances(a, b))
        return result


def _width(frames: Array) -> _Width:
    """How alike two actor poses must be for one to tell about the other."""
    some = frames[:: max(len(frames) // 300, 1)]
    squared = squared_distances(some, some)
    median = float(np.median(squared[np.triu_indices_from(squared, k=1)])) if len(some) > 1 else 1.0
    return _Width(1.0 / (WIDTH**2 * max(median, 1e-9)), NOISE)


def _conditioned(kernel: _Width, frames: Array, posed: Array) -> Array:
    """Covariance (M, M) of the frames, given the posed ones."""
    covariance = kernel(frames, frames)
    if len(posed):
        gram = kernel(posed, posed) + kernel.noise * np.eye(len(posed))
        cross = kernel(posed, frames)
        covariance -= cross.T @ np.linalg.solve(gram, cross)
    return covariance


def _greedy(
    covariance: Array, kernel: _Width, frames: Array, posed: Array, count: int
) -> tuple[Suggestion, ...]:
    least_known = max(float(np.diagonal(covariance).max()), 1e-12)
    known = posed
    chosen: list[Suggestion] = []
    for _ in range(min(count, len(frames))):
        variance = np.maximum(np.diagonal(covariance), 0.0)
        best = int(np.argmax(variance))
        if variance[best] <= kernel.noise or any(s.index == best for s in chosen):
            break
        column = covariance[:, best] / np.sqrt(variance[best] + kernel.noise)
        lowered = column**2 >= STANDS_FOR * np.maximum(variance, 1e-12)
        nearest, distance = _nearest(frames[best], known)
        chosen.append(
            Suggestion(
                index=best,
                score=float(variance[best] / least_known),
                stands_for=float(lowered.mean()),
                nearest=nearest,
                distance=distance,
            )
        )
        covariance = covariance - np.outer(column, column)
        known = np.concatenate([known, frames[best : best + 1]])
    return tuple(chosen)


def _nearest(frame: Array, known: Array) -> tuple[int | None, float]:
    if not len(known):
        return None, np.inf
    squared = np.sum((known - frame) ** 2, axis=1)
    nearest = int(np.argmin(squared))
    return nearest, float(np.sqrt(squared[nearest] / (len(frame) / 3)))
