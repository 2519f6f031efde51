"""The kernel of Yamane 2010 eq. (1) and its derivatives.

``k(a, b) = θ1 exp(-θ2/2 |a - b|²) + θ3 + δ_ab / β``; parameters travel as logarithms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Kernel:
    """Parameters of eq. (1): signal θ1, inverse squared width θ2, offset θ3, noise 1/β."""

    signal: float
    sharpness: float
    offset: float
    noise: float

    @classmethod
    def from_logs(cls, logs: Array) -> Kernel:
        """From (log θ1, log θ2, log θ3, log 1/β)."""
        signal, sharpness, offset, noise = np.exp(logs)
        return cls(float(signal), float(sharpness), float(offset), float(noise))

    def logs(self) -> Array:
        """(log θ1, log θ2, log θ3, log 1/β)."""
        return np.log([self.signal, self.sharpness, self.offset, self.noise])

    @property
    def prior_variance(self) -> float:
        """k(x, x): the variance far away from all key poses."""
        return self.signal + self.offset + self.noise

    def bump(self, squared: Array) -> Array:
        """θ1 exp(-θ2/2 d²) at squared distances d²."""
        result: Array = self.signal * np.exp(-0.5 * self.sharpness * squared)
        return result

    def cross(self, squared: Array) -> Array:
        """k(a, b) for a ≠ b at squared distances d² (no noise)."""
        return self.bump(squared) + self.offset

    def gram(self, squared: Array) -> Array:
        """K (N, N) at the squared distances (N, N) of the key poses."""
        return self.cross(squared) + self.noise * np.eye(squared.shape[0])


def squared_distances(a: Array, b: Array) -> Array:
    """(T, N) squared Euclidean distances of the rows of a (T, D) and b (N, D)."""
    squared = np.sum(a**2, axis=1)[:, None] + np.sum(b**2, axis=1)[None] - 2.0 * (a @ b.T)
    result: Array = np.maximum(squared, 0.0)
    return result


def gram_gradient(kernel: Kernel, squared: Array, sensitivity: Array) -> tuple[Array, Array]:
    """Chain rule from ∂L/∂K (N, N, symmetric) to the parameters and the distances.

    Returns ∂L/∂(log θ1, log θ2, log θ3, log 1/β) (4,) and ∂L/∂d² (N, N).
    """
    weighted = sensitivity * kernel.bump(squared)
    by_distance = -0.5 * kernel.sharpness * weighted
    by_log = np.array(
        [
            weighted.sum(),
            np.sum(by_distance * squared),
            kernel.offset * sensitivity.sum(),
            kernel.noise * np.trace(sensitivity),
        ]
    )
    return by_log, by_distance


def position_gradient(x: Array, by_distance: Array) -> Array:
    """∂L/∂x (N, D) from ∂L/∂d² (N, N, symmetric), d² = |x_i - x_j|²."""
    result: Array = 4.0 * (by_distance.sum(axis=1)[:, None] * x - by_distance @ x)
    return result
