"""Gaussian process posterior over fixed inputs: Yamane 2010 eqs. (3) and (4)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from physretarget.mapping.kernels import Kernel, squared_distances

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Posterior:
    """GP conditioned on ``inputs`` (N, DX) and normal ``targets`` (N, D).

    ``inverse`` (N, N) is K⁻¹, ``weights`` (N, D) is K⁻¹ targets.
    """

    kernel: Kernel
    inputs: Array
    inverse: Array
    weights: Array

    @classmethod
    def of(cls, kernel: Kernel, inputs: Array, targets: Array) -> Posterior:
        """Condition on the key poses."""
        inverse, _ = inverse_and_logdet(
            kernel.gram(squared_distances(inputs, inputs), inputs @ inputs.T)
        )
        return cls(kernel, inputs, inverse, inverse @ targets)

    def at(self, x: Array) -> tuple[Array, Array]:
        """Mean (T, D) and variance (T,), noise included, at inputs x (T, DX)."""
        k = self.kernel.cross(x, self.inputs)
        explained = np.einsum("tn,tn->t", k @ self.inverse, k)
        floor = self.kernel.noise
        return k @ self.weights, np.maximum(self.kernel.prior_variance(x) - explained, floor)

    @cached_property
    def scatter(self) -> Array:
        """``K⁻¹ O Oᵀ K⁻¹`` (N, N)."""
        return np.asarray(self.weights @ self.weights.T)

    @cached_property
    def _moment(self) -> Array:
        return np.asarray(self.scatter * (self.inputs @ self.inputs.T))

    def slope(self, x: Array) -> Array:
        """Mean square (T,) of the mean's derivative, summed over the directions of x (T, DX).

        ``1/D Σ_cd (∂mean_d/∂x_c)²``: by how much an uncertain input, of unit variance in every
        direction, makes a coordinate of the mean uncertain.
        """
        kernel, inputs = self.kernel, self.inputs
        pull = kernel.sharpness * kernel.bump(squared_distances(x, inputs))
        whole = pull + kernel.linear
        along = whole * (x @ inputs.T)
        spread = pull @ self.scatter
        # Σ_nm S_nm g_n·g_m with g_n = p_n (x_n - x) + θ4 x_n, the product multiplied out
        square = np.einsum("tn,tn->t", whole @ self._moment, whole)
        square -= 2.0 * np.einsum("tn,tn->t", along, spread)
        square += np.sum(x**2, axis=1) * np.einsum("tn,tn->t", pull, spread)
        result: Array = np.maximum(square, 0.0) / self.weights.shape[1]
        return result


def inverse_and_logdet(gram: Array) -> tuple[Array, float]:
    """Inverse (exactly symmetric) and log-determinant of a positive definite matrix."""
    factor, lower = cho_factor(gram, lower=True)
    inverse = cho_solve((factor, lower), np.eye(gram.shape[0]))
    return 0.5 * (inverse + inverse.T), 2.0 * float(np.log(np.diag(factor)).sum())


def likelihood(gram: Array, scatter: Array, width: int) -> tuple[float, Array]:
    """Negative log-likelihood without constants and its gradient ∂L/∂K.

    ``L = D/2 log|K| + ½ tr(K⁻¹ O Oᵀ)``, ``scatter`` (N, N) is O Oᵀ, ``width`` is D.
    """
    inverse, logdet = inverse_and_logdet(gram)
    solved = inverse @ scatter
    value = 0.5 * width * logdet + 0.5 * float(np.trace(solved))
    gradient = 0.5 * (width * inverse - solved @ inverse)
    return value, 0.5 * (gradient + gradient.T)
