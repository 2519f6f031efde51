"""Levenberg-Marquardt on banded normal equations: time and memory linear in the clip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from physretarget.ocp.basis import Basis
from physretarget.ocp.problem import Problem

Array = NDArray[np.float64]

BLOCK = 4096
"""Frames whose products are held at once."""


@dataclass(frozen=True)
class Outcome:
    """Weights (n,), cost, iterations used, and whether the tolerance was reached."""

    weights: Array
    cost: float
    iterations: int
    converged: bool


class Normal:
    """Assembles JᵀJ (upper banded form of scipy) and Jᵀr of residuals over a basis."""

    def __init__(self, basis: Basis) -> None:
        self.basis = basis
        one, other = np.triu_indices(basis.width)
        self._band = basis.width - 1
        self._pairs = one * basis.width + other
        self._place = (self._band + one - other) * basis.count + other

    def equations(self, r: Array, slopes: Array, ridge: float) -> tuple[Array, Array]:
        """Banded (width, n) matrix and right-hand side (n,) of r (T, R), slopes (T, R, 3).

        ``ridge`` goes on the diagonal. Frames are summed one after the other, some of them at a
        time: the products of all would take more memory than anything else.
        """
        banded, rhs = np.zeros((self._band + 1) * self.basis.count), np.zeros(self.basis.count)
        for start in range(0, len(r), BLOCK):
            rows = slice(start, start + BLOCK)
            self._add(rows, r[rows], slopes[rows], banded, rhs)
        matrix = banded.reshape(self._band + 1, self.basis.count)
        matrix[-1] += ridge
        return matrix, rhs

    def _add(self, rows: slice, r: Array, slopes: Array, banded: Array, rhs: Array) -> None:
        basis = self.basis
        parts = (basis.value[rows], basis.rate[rows], basis.curvature[rows])
        operators = np.stack(parts, axis=1)
        # per frame only a 3 x 3 matrix stands between the operators
        inner = np.einsum("tra,trb->tab", slopes, slopes)
        blocks = operators.transpose(0, 2, 1) @ (inner @ operators)
        flat = blocks.reshape(len(r), -1)[:, self._pairs]
        first = basis.first[rows, None]
        np.add.at(banded, (first + self._place).ravel(), flat.ravel())
        pull = np.einsum("tra,tr->ta", slopes, r)
        local = np.einsum("ta,tam->tm", pull, operators)
        np.add.at(rhs, (first + np.arange(basis.width)).ravel(), local.ravel())


def solve(
    problem: Problem,
    basis: Basis,
    start: Array,
    *,
    f0: float,
    ridge: float,
    iterations: int,
    tolerance: float,
) -> Outcome:
    """Minimise ``½|r|² + ½ ridge |w|²`` over the weights w (n,) from ``start``."""
    normal = Normal(basis)
    weights, damping = start.copy(), 1e-4
    r, slopes = problem.evaluate(basis.motion(weights), f0)
    cost = _cost(r, weights, ridge)
    small_gains = 0
    for used in range(1, iterations + 1):
        matrix, rhs = normal.equations(r, slopes, ridge)
        rhs = rhs + ridge * weights
        gained = -1.0
        while damping < 1e8:
            damped = matrix.copy()
            damped[-1] *= 1.0 + damping
            trial = weights - solveh_banded(damped, rhs, check_finite=False)
            cost_new = _cost(problem.value(basis.motion(trial), f0), trial, ridge)
            if cost_new < cost:
                gained = (cost - cost_new) / cost
                weights, cost = trial, cost_new
                damping = max(damping / 5.0, 1e-8)
                break
            damping *= 4.0
        small_gains = small_gains + 1 if gained < tolerance else 0
        if gained < 0 or small_gains == 2:
            return Outcome(weights, cost, used, True)
        r, slopes = problem.evaluate(basis.motion(weights), f0)
    return Outcome(weights, cost, iterations, False)


def _cost(r: Array, weights: Array, ridge: float) -> float:
    return 0.5 * float(np.sum(r**2)) + 0.5 * ridge * float(weights @ weights)
