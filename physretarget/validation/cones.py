"""Contact forces that best explain a wrench: an exact, batched second-order cone fit.

For every frame, with n touching points p_i, friction mu and a wrench b (6,):

    minimise  1/2 |sum_i A_i f_i - b|^2 + 1/2 sum_i rho_i |S f_i|^2   over  |f_it| <= mu f_iz

A_i = [1; (p_i - c)x / h] maps a force to force and moment about c, the moment scaled by a
height h, so that both halves count in body weights. S = diag(1, 1, mu) makes the cone its own
dual. rho (about 1e-7) makes the forces unique and lets the caller prefer some points; it moves
the residual by that order only.

The dual has six unknowns however many points there are. With y the residual b - sum A_i f_i
and P the projection on the second-order cone,

    phi(y) = 1/2 |y|^2 - b.y + sum_i |P(z_i)|^2 / (2 rho_i),  z_i = S^-1 A_i^T y,
    S f_i = P(z_i) / rho_i

is strongly convex with a piecewise smooth gradient: a semismooth Newton method with a line
search solves all frames at once (Qi and Sun 1993). The few frames where it zigzags go through
an interior-point method first.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget.validation.interior import interior_point

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

RHO = 1e-7
# Strong convexity: the residual is as near to its optimum as the gradient is to zero.
_ROUNDING = 1e-15
_TOLERANCE = 1e-8
# Most frames need fewer steps; those that zigzag begin again from inside the cones.
_ITERATIONS, _LAST_ITERATIONS = 18, 30


@dataclass(frozen=True, eq=False)
class ConeFit:
    """Forces (T, n, 3), residual wrench (T, 6), iterations used, converged (T,)."""

    force: Floats
    residual: Floats
    iterations: int
    converged: Bools


@dataclass(frozen=True, eq=False)
class _Problem:
    """B frames of n points: a (B, 3n, 6) = S^-1 A^T, b (B, 6), inv (B, 3n) = 1 / rho."""

    a: Floats
    b: Floats
    inv: Floats

    def take(self, rows: NDArray[np.int64] | Bools) -> _Problem:
        return _Problem(self.a[rows], self.b[rows], self.inv[rows])


def fit_forces(
    arm: Floats,
    mask: Bools,
    wrench: Floats,
    *,
    friction: float,
    rho: Floats | float = RHO,
) -> ConeFit:
    """Fit forces in Coulomb cones (z up) to wrenches, every frame at once.

    ``arm`` (T, n, 3) are the points relative to the wrench's reference point, divided by the
    height that scales moments; ``mask`` (T, n) the points that exist; ``wrench`` (T, 6) is
    force and scaled moment. Returns forces in the unit of the wrench. The outcome is a value:
    see ``converged``.
    """
    frames, points = mask.shape
    force = np.zeros((frames, points, 3))
    residual = wrench.copy()
    converged = np.ones(frames, dtype=bool)
    weight = np.broadcast_to(np.asarray(rho, dtype=np.float64), (frames, points))
    counts = mask.sum(axis=1)
    iterations = 0
    stuck: list[NDArray[np.int64]] = []
    # Frames with about as many points share arrays with little padding.
    for width in np.unique((counts[counts > 0] + 1) // 2 * 2):
        rows = np.flatnonzero((counts + 1) // 2 * 2 == width)
        pick, problem = _gathered(arm, mask, weight, wrench, rows, int(width), friction)
        y, done, used = _newton(problem, _start(problem), _ITERATIONS)
        _finish(problem, y, rows, pick, friction, force, residual)
        converged[rows], iterations = done, max(iterations, used)
        stuck.append(rows[~done])
    rest = np.concatenate(stuck) if stuck else np.zeros(0, dtype=np.int64)
    if len(rest):
        pick, problem = _gathered(
            arm, mask, weight, wrench, rest, int(counts[rest].max()), friction
        )
        begun = interior_point(problem.a, problem.b, 1 / problem.inv[:, ::3])
        y, done, used = _newton(problem, begun, _LAST_ITERATIONS)
        _finish(problem, y, rest, pick, friction, force, residual)
        converged[rest], iterations = done, iterations + used
    return ConeFit(force, residual, iterations, converged)


def _gathered(
    arm: Floats, mask: Bools, weight: Floats, wrench: Floats, rows: NDArray[np.int64], width: int,
    friction: float,
) -> tuple[tuple[NDArray[np.int64], NDArray[np.int64]], _Problem]:  # fmt: skip
    """Where the points of some frames are, and their problem, padded to ``width`` points.

    A point that is not there maps every force to nothing.
    """
    width = min(width, mask.shape[1])
    columns = np.argsort(~mask[rows], axis=1, kind="stable")[:, :width]
    pick = (rows[:, None], columns)
    there = mask[pick]
    maps = _maps(arm[pick], friction).reshape(len(rows), width, 3, 6)
    maps *= there[..., None, None]
    inv = np.repeat(1 / np.where(there, weight[pick], 1.0), 3, axis=1)
    return pick, _Problem(maps.reshape(len(rows), -1, 6), wrench[rows], inv)


def _finish(
    problem: _Problem,
    y: Floats,
    rows: NDArray[np.int64],
    pick: tuple[NDArray[np.int64], NDArray[np.int64]],
    friction: float,
    force: Floats,
    residual: Floats,
) -> None:
    scaled = _scaled_force(problem, y)
    force[pick] = scaled / np.array([1.0, 1.0, friction])
    residual[rows] = problem.b - _wrench_of(problem, scaled)


def _maps(arm: Floats, friction: float) -> Floats:
    """(T, 3n, 6): S^-1 A_i^T = S^-1 [1, -(arm x)] stacked."""
    maps = np.zeros((*arm.shape[:2], 3, 6))
    maps[..., 0, 0] = maps[..., 1, 1] = maps[..., 2, 2] = 1
    x, y, z = arm[..., 0], arm[..., 1], arm[..., 2]
    # moment = arm x f, so the rows of A^T are the columns of the cross-product matrix.
    maps[..., 0, 4], maps[..., 0, 5] = z, -y
    maps[..., 1, 3], maps[..., 1, 5] = -z, x
    maps[..., 2, 3], maps[..., 2, 4] = y, -x
    maps[..., 2, :] /= friction
    return maps.reshape(len(arm), -1, 6)


def _start(problem: _Problem) -> Floats:
    """A residual as small as it would be with all points sharing the load."""
    y: Floats = problem.b / (problem.inv.sum(axis=1, keepdims=True) / 3)
    return y


def _newton(problem: _Problem, y: Floats, most: int) -> tuple[Floats, Bools, int]:
    """Newton steps with Armijo backtracking until the gradient vanishes."""
    y = y.copy()
    done = np.zeros(len(y), dtype=bool)
    goal = _TOLERANCE * np.maximum(1.0, np.abs(problem.b).max(axis=1))
    live = np.arange(len(y))
    used = 0
    while used < most:
        used += 1
        part = problem.take(live)
        gradient, step = _step(part, y[live])
        finished = np.abs(gradient).max(axis=1) < goal[live]
        done[live[finished]] = True
        live, part = live[~finished], part.take(~finished)
        if len(live) == 0:
            break
        y[live] = _search(part, y[live], step[~finished], gradient[~finished])
    return y, done, used


def _step(problem: _Problem, y: Floats) -> tuple[Floats, Floats]:
    """Gradient (B, 6) and Newton step (B, 6)."""
    frames = len(y)
    z = (problem.a @ y[:, :, None]).reshape(frames, -1, 3)
    out, jacobian = _project(z)
    gradient = y - problem.b + _wrench_of(problem, out.reshape(frames, -1) * problem.inv)
    mapped = (jacobian @ problem.a.reshape(*z.shape, 6)).reshape(problem.a.shape)
    hessian = np.eye(6) + np.swapaxes(problem.a, 1, 2) @ (mapped * problem.inv[:, :, None])
    try:
        step = np.linalg.solve(hessian, -gradient[:, :, None])[:, :, 0]
    except np.linalg.LinAlgError:
        # Arms of thousands of kilometres drown the unit matrix in rounding.
        rounding = _ROUNDING * np.trace(hessian, axis1=1, axis2=2)
        hessian += rounding[:, None, None] * np.eye(6)
        step = np.linalg.solve(hessian, -gradient[:, :, None])[:, :, 0]
    return gradient, np.asarray(step, dtype=np.float64)


def _scaled_force(problem: _Problem, y: Floats) -> Floats:
    z = (problem.a @ y[:, :, None]).reshape(len(y), -1, 3)
    return _project(z)[0] * problem.inv.reshape(z.shape)


def _wrench_of(problem: _Problem, scaled: Floats) -> Floats:
    flat = scaled.reshape(len(scaled), 1, -1)
    wrench: Floats = (flat @ problem.a)[:, 0]
    return wrench


def _phi(problem: _Problem, y: Floats) -> Floats:
    z = (problem.a @ y[:, :, None]).reshape(len(y), -1, 3)
    tangent = np.hypot(z[..., 0], z[..., 1])
    # Half the squared length of the projection, from its two spectral values.
    squared = np.maximum(z[..., 2] - tangent, 0) ** 2 + np.maximum(z[..., 2] + tangent, 0) ** 2
    phi: Floats = np.sum((0.5 * y - problem.b) * y, axis=1) + 0.25 * np.sum(
        squared * problem.inv[:, ::3], axis=1
    )
    return phi


def _project(z: Floats) -> tuple[Floats, Floats]:
    """Projection on |t| <= n and an element of its generalised Jacobian (..., 3, 3).

    In spectral form: values n -+ |t| on (-+u, 1) / 2 with u = t / |t|, each cut off at zero.
    """
    tangent = np.hypot(z[..., 0], z[..., 1])
    low, high = z[..., 2] - tangent, z[..., 2] + tangent
    g_low, g_high = np.maximum(low, 0), np.maximum(high, 0)
    d_low, d_high = (low > 0).astype(np.float64), (high > 0).astype(np.float64)
    slanted = tangent > 0
    safe = np.where(slanted, tangent, 1.0)
    ux, uy = np.where(slanted, z[..., 0] / safe, 1.0), np.where(slanted, z[..., 1] / safe, 0.0)
    across = np.where(slanted, 0.5 * (g_high - g_low) / safe, d_high)
    out = np.empty_like(z)
    out[..., :2] = across[..., None] * z[..., :2]
    out[..., 2] = 0.5 * (g_high + g_low)
    mean, half = 0.5 * (d_high + d_low), 0.5 * (d_high - d_low)
    along = mean - across
    jacobian = np.empty((*z.shape, 3))
    jacobian[..., 0, 0] = across + along * ux * ux
    jacobian[..., 1, 1] = across + along * uy * uy
    jacobian[..., 0, 1] = jacobian[..., 1, 0] = along * ux * uy
    jacobian[..., 0, 2] = jacobian[..., 2, 0] = half * ux
    jacobian[..., 1, 2] = jacobian[..., 2, 1] = half * uy
    jacobian[..., 2, 2] = mean
    return out, jacobian


def _search(problem: _Problem, y: Floats, step: Floats, gradient: Floats) -> Floats:
    """Armijo backtracking, each frame its own step length."""
    value = _phi(problem, y)
    slope = np.sum(gradient * step, axis=1)
    length = np.ones(len(y))
    rising = np.arange(len(y))
    for _ in range(30):
        part = problem if len(rising) == len(y) else problem.take(rising)
        phi = _phi(part, y[rising] + length[rising, None] * step[rising])
        # The last steps change phi by less than rounding: allow for that.
        allowed = value[rising] + 1e-4 * length[rising] * slope[rising]
        rising = rising[phi > allowed + 1e-14 * (1 + np.abs(value[rising]))]
        if len(rising) == 0:
            break
        length[rising] *= 0.5
    searched: Floats = y + length[:, None] * step
    return searched
