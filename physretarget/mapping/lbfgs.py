"""L-BFGS on many small independent problems at once.

One call per iteration evaluates all problems that are still moving, so that the cost of Python
is shared by a whole clip.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Rows = NDArray[np.intp]

ARMIJO = 1e-4
HALVINGS = 12


class Objective(Protocol):
    """Values (n,) and gradients (n, D) of the problems ``rows`` (n,) at points x (n, D)."""

    def __call__(self, x: Array, rows: Rows) -> tuple[Array, Array]:
        """Values (n,), gradients (n, D)."""
        ...


@dataclass(frozen=True)
class Minima:
    """Points (T, D), values (T,), gradient size (T,) and iterations used."""

    x: Array
    value: Array
    gradient: Array
    iterations: int


@dataclass
class _State:
    """The problems still moving. ``steps``, ``changes`` (m, n, D) and ``rho`` (m, n) are the
    history, the newest pair first."""

    rows: Rows
    x: Array
    value: Array
    gradient: Array
    steps: Array
    changes: Array
    rho: Array

    def subset(self, keep: NDArray[np.bool_]) -> _State:
        return _State(
            self.rows[keep],
            self.x[keep],
            self.value[keep],
            self.gradient[keep],
            self.steps[:, keep],
            self.changes[:, keep],
            self.rho[:, keep],
        )


def minimise(
    objective: Objective,
    start: Array,
    *,
    iterations: int = 100,
    tolerance: float = 1e-5,
    decrease: float = 1e-9,
    memory: int = 8,
) -> Minima:
    """Minimise T independent functions of D variables from ``start`` (T, D).

    A problem rests when its gradient's largest entry is below ``tolerance``, when an iteration
    gains less than ``decrease``, or when no step improves it.
    """
    count, size = start.shape
    rows = np.arange(count)
    value, gradient = objective(start, rows)
    best = Minima(start.copy(), value.copy(), np.abs(gradient).max(axis=1), 0)
    shape = (memory, count, size)
    state = _State(
        rows, start, value, gradient, np.zeros(shape), np.zeros(shape), np.zeros(shape[:2])
    )
    state = state.subset(best.gradient > tolerance)
    used = 0
    while state.rows.size and used < iterations:
        used += 1
        moved = _advance(objective, state)
        gain = best.value[state.rows] - state.value
        size_now = np.abs(state.gradient).max(axis=1)
        best.x[state.rows] = state.x
        best.value[state.rows] = state.value
        best.gradient[state.rows] = size_now
        state = state.subset(moved & (gain > decrease) & (size_now > tolerance))
    return Minima(best.x, best.value, best.gradient, used)


def _advance(objective: Objective, state: _State) -> NDArray[np.bool_]:
    """One iteration, in place; False where no step improved."""
    direction = -_two_loops(state)
    slope = np.einsum("td,td->t", direction, state.gradient)
    uphill = slope >= 0
    direction[uphill] = -state.gradient[uphill]
    slope[uphill] = -np.sum(state.gradient[uphill] ** 2, axis=1)
    fresh = state.rho.max(axis=0, initial=0.0) == 0.0
    length = np.linalg.norm(direction, axis=1)
    step = np.where(fresh, np.minimum(1.0, 0.1 / np.maximum(length, 1e-300)), 1.0)
    x, value, gradient = state.x.copy(), state.value.copy(), state.gradient.copy()
    todo = np.arange(state.rows.size)
    for _ in range(HALVINGS):
        trial = state.x[todo] + step[todo, None] * direction[todo]
        f, g = objective(trial, state.rows[todo])
        good = f <= state.value[todo] + ARMIJO * step[todo] * slope[todo]
        done = todo[good]
        x[done], value[done], gradient[done] = trial[good], f[good], g[good]
        todo = todo[~good]
        if todo.size == 0:
            break
        step[todo] *= 0.3
    _remember(state, x - state.x, gradient - state.gradient)
    state.x, state.value, state.gradient = x, value, gradient
    moved = np.ones(state.rows.size, dtype=np.bool_)
    moved[todo] = False
    return moved


def _two_loops(state: _State) -> Array:
    """Inverse Hessian times gradient (n, D)."""
    q = state.gradient.copy()
    alphas = []
    for s, y, rho in zip(state.steps, state.changes, state.rho, strict=True):
        alpha = rho * np.einsum("td,td->t", s, q)
        q -= alpha[:, None] * y
        alphas.append(alpha)
    yy = np.einsum("td,td->t", state.changes[0], state.changes[0])
    known = state.rho[0] > 0
    scale = np.where(known, 1.0 / np.where(known, state.rho[0] * yy, 1.0), 1.0)
    q *= scale[:, None]
    pairs = zip(state.steps, state.changes, state.rho, alphas, strict=True)
    for s, y, rho, alpha in reversed(list(pairs)):
        beta = rho * np.einsum("td,td->t", y, q)
        q += (alpha - beta)[:, None] * s
    return q


def _remember(state: _State, step: Array, change: Array) -> None:
    """Push a pair where its curvature is positive; elsewhere start that history afresh."""
    curvature = np.einsum("td,td->t", step, change)
    sizes = np.linalg.norm(step, axis=1) * np.linalg.norm(change, axis=1)
    positive = curvature > 1e-10 * sizes
    state.steps = np.concatenate([step[None], state.steps[:-1]])
    state.changes = np.concatenate([change[None], state.changes[:-1]])
    rho = np.where(positive, 1.0 / np.where(positive, curvature, 1.0), 0.0)
    state.rho = np.concatenate([rho[None], np.where(positive, state.rho[:-1], 0.0)])
