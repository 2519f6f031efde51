"""The kernel of Yamane 2010 eq. (1), a linear part added, and its derivatives.

``k(a, b) = θ1 exp(-θ2/2 |a - b|²) + θ3 + θ4 a·b + δ_ab / β``; parameters travel as logarithms. The
paper has no θ4: far from all key poses its map falls back to their mean. With it the map goes on
as the key poses do on the whole, and bends from there where they say so.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Kernel:
    """Parameters: signal θ1, inverse squared width θ2, offset θ3, noise 1/β, linear θ4."""

    signal: float
    sharpness: float
    offset: float
    noise: float
    linear: float = 0.0

    @classmethod
    def from_logs(cls, logs: Array) -> Kernel:
        """From (log θ1, log θ2, log θ3, log 1/β, log θ4); of four there is no linear part."""
        return cls(*np.exp(logs).tolist())

    def logs(self) -> Array:
        """(log θ1, log θ2, log θ3, log 1/β, log θ4)."""
        with np.errstate(divide="ignore"):  # without a linear part its logarithm is -inf
            return np.log([self.signal, self.sharpness, self.offset, self.noise, self.linear])

    def prior_variance(self, x: Array) -> Array:
        """k(x, x) (T,) at inputs x (T, D), noise included."""
        constant = self.signal + self.offset + self.noise
        variance: Array = constant + self.linear * np.sum(x * x, axis=-1)
        return variance

    def bump(self, squared: Array) -> Array:
        """θ1 exp(-θ2/2 d²) at squared distances d²."""
        result: Array = self.signal * np.exp(-0.5 * self.sharpness * squared)
        return result

    def cross(self, a: Array, b: Array) -> Array:
        """k (T, N) between other inputs a (T, D) and b (N, D): no noise."""
        return self.between(squared_distances(a, b), a @ b.T)

    def between(self, squared: Array, inner: Array) -> Array:
        """k(a, b) for a ≠ b at squared distances d² and inner products a·b."""
        return self.bump(squared) + self.offset + self.linear * inner

    def gram(self, squared: Array, inner: Array) -> Array:
        """K (N, N) at the squared distances and inner products (N, N) of the key poses."""
        return self.between(squared, inner) + self.noise * np.eye(squared.shape[0])


def squared_distances(a: Array, b: Array) -> Array:
    """(T, N) squared Euclidean distances of the rows of a (T, D) and b (N, D)."""
    squared = np.sum(a**2, axis=1)[:, None] + np.sum(b**2, axis=1)[None] - 2.0 * (a @ b.T)
    result: Array = np.maximum(squared, 0.0)
    return result


def gram_gradient(
    kernel: Kernel, squared: Array, inner: Array, sensitivity: Array
) -> tuple[Array, Array]:
    """Chain rule from ∂L/∂K (N, N, symmetric) to the parameters and the distances.

    Returns ∂L/∂(log θ1, log θ2, log θ3, log 1/β, log θ4) (5,) and ∂L/∂d² (N, N).
    """
    weighted = sensitivity * kernel.bump(squared)
    by_distance = -0.5 * kernel.sharpness * weighted
    by_log = np.array(
        [
            weighted.sum(),
            np.sum(by_distance * squared),
            kernel.offset * sensitivity.sum(),
            kernel.noise * np.trace(sensitivity),
            kernel.linear * np.sum(sensitivity * inner),
        ]
    )
    return by_log, by_distance


def position_gradient(x: Array, by_distance: Array) -> Array:
    """∂L/∂x (N, D) from ∂L/∂d² (N, N, symmetric), d² = |x_i - x_j|²."""
    result: Array = 4.0 * (by_distance.sum(axis=1)[:, None] * x - by_distance @ x)
    return result
