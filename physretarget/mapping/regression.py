"""Gaussian process posterior over fixed inputs: Yamane 2010 eqs. (3) and (4)."""

from __future__ import annotations

from dataclasses import dataclass

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
        inverse, _ = inverse_and_logdet(kernel.gram(squared_distances(inputs, inputs)))
        return cls(kernel, inputs, inverse, inverse @ targets)

    def at(self, x: Array) -> tuple[Array, Array]:
        """Mean (T, D) and variance (T,), noise included, at inputs x (T, DX)."""
        k = self.kernel.cross(squared_distances(x, self.inputs))
        explained = np.einsum("tn,tn->t", k @ self.inverse, k)
        floor = self.kernel.noise
        return k @ self.weights, np.maximum(self.kernel.prior_variance - explained, floor)


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
