"""Contact forces that best explain a wrench: an exact, batched second-order cone fit.

For every frame, with n touching points p_i, friction mu_i and a wrench b (6,):

    minimise  1/2 r.W r + 1/2 sum_i rho_i |S_i f_i|^2,   r = b - sum_i A_i f_i,
    over  |f_it| <= mu_i f_iz

A_i = [1; (p_i - c)x / h] maps a force to force and moment about c, the moment scaled by a
height h, so that both halves count in body weights. W weighs the force that remains against the
moment that remains: 1 for the distance from the cone of contact wrenches, some thousands for the
moment that is left when the force is explained (its error: the arm over the weight).
S = diag(1, 1, mu) makes the cone its own dual. rho (about 1e-7) makes the forces unique and lets
the caller prefer some points; it moves the residual by that order only.

A cone may lean: f_t = g_t + l f_z with g in the cone above. So does the friction of what slides,
which is on the edge of its cone, against the motion.

The dual has six unknowns however many points there are. With P the projection on the
second-order cone,

    phi(y) = 1/2 y.W^-1 y - b.y + sum_i |P(z_i)|^2 / (2 rho_i),  z_i = S_i^-1 A_i^T y,
    r = W^-1 y,  S_i f_i = P(z_i) / rho_i

is strongly convex with a piecewise smooth gradient: a semismooth Newton method with a line
search solves all frames at once (Qi and Sun 1993). In the few frames where it zigzags between the
faces of the cones, force is made dear first, which rounds them off, and cheaper step by step. Where
y is found it is the derivative of the minimum by b, and
the inverse of phi's Hessian, (W^-1 + sum A_i S_i^-1 P' S_i^-1 A_i^T / rho_i)^-1, the second.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

RHO = 1e-7
# Strong convexity: the residual is as near to its optimum as the gradient is to zero.
_ROUNDING = 1e-15
# Ice: a cone of no width has no inside.
_SMOOTHEST = 1e-3
_TOLERANCE = 1e-8
# Steps, and the least prices of force one after the other: most frames need few steps at the price
# that force has. Those that zigzag begin again, with force that is dear first.
_PATHS = (
    (16, (0.0,)), (30, (1e-2, 1e-4, 0.0)), (30, (*np.geomspace(1e-2, 1e-7, 11).tolist(), 0.0)),
)  # fmt: skip
# Lengths that a step is tried with, (L, 1) at once: few frames are left after the first.
_LENGTHS = [0.5 ** np.arange(a, b)[:, None] for a, b in ((0, 1), (1, 2), (2, 6), (6, 14), (14, 30))]
_SHORTEST = 0.5**30


@dataclass(frozen=True, eq=False)
class ConeFit:
    """Forces (T, n, 3), residual wrench (T, 6), iterations used, converged (T,).

    ``gradient`` (T, 6) is the derivative of the minimum by the wrench; ``curvature`` (T, 6, 6) its
    second derivative, where that was asked for.
    """

    force: Floats
    residual: Floats
    iterations: int
    converged: Bools
    gradient: Floats
    curvature: Floats | None = None


@dataclass(frozen=True, eq=False)
class _Problem:
    """B frames and the P points of all of them, which NumPy runs through at once.

    ``arm`` (3, P), ``inv`` (P,) = 1 / rho and ``friction`` (P,) tell of every point where it is,
    what force costs there and how rough it is; ``counts`` (B,) how many of them, one frame's after
    the other's, each frame has, at least one; ``b`` (6, B); ``slack`` (6, 1) is the diagonal of
    W^-1; ``lean`` (2, P) how cones lean, None where they stand.
    """

    arm: Floats
    inv: Floats
    counts: Ints
    b: Floats
    friction: Floats
    slack: Floats
    lean: Floats | None

    def take(self, chosen: Bools) -> _Problem:
        """Some of the frames."""
        if chosen.all():
            return self
        points = self.points(chosen)
        return _Problem(
            self.arm[:, points], self.inv[points], self.counts[chosen], self.b[:, chosen],
            self.friction[points], self.slack, None if self.lean is None else self.lean[:, points],
        )  # fmt: skip

    def points(self, chosen: Bools) -> Bools:
        """(P,) the points of some of the frames."""
        return np.repeat(chosen, self.counts)

    def priced(self, least: float) -> _Problem:
        """The problem with force that costs at least so much everywhere."""
        return replace(self, inv=np.minimum(self.inv, 1 / least)) if least > 0 else self

    def seen(self, y: Floats) -> Floats:
        """(3, P) z of every point: S^-1 A^T y."""
        own = self.spread(y)
        z: Floats = own[:3]
        z -= _cross(self.arm, own[3:])
        if self.lean is not None:
            z[2] += self.lean[0] * z[0] + self.lean[1] * z[1]
        z[2] /= self.friction
        return z

    def spread(self, values: Floats) -> Floats:
        """(..., B) of frames for each of their points: (..., P)."""
        return np.repeat(values, self.counts, axis=-1)

    def sum(self, values: Floats) -> Floats:
        """(..., P) summed over the points of every frame: (..., B)."""
        total: Floats = np.add.reduceat(values, np.cumsum(self.counts) - self.counts, axis=-1)
        return total

    def forces(self, scaled: Floats) -> Floats:
        """(3, P) f of S f."""
        force = scaled.copy()
        force[2] /= self.friction
        if self.lean is not None:
            force[:2] += self.lean * force[2]
        return force

    def wrench(self, scaled: Floats) -> Floats:
        """(6, B) of forces S f (3, P)."""
        force = self.forces(scaled)
        return self.sum(np.concatenate([force, _cross(self.arm, force)]))


def _cross(left: Floats, right: Floats) -> Floats:
    """Cross products of the first axis of (3, P) and (3, ..., P)."""
    out = np.empty(np.broadcast_shapes(left.shape, right.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[i] = left[j] * right[k]
        out[i] -= left[k] * right[j]
    return out


def fit_forces(
    arm: Floats,
    mask: Bools,
    wrench: Floats,
    *,
    friction: Floats | float,
    rho: Floats | float = RHO,
    lean: Floats | None = None,
    force_weight: float = 1.0,
    curvature: bool = False,
) -> ConeFit:
    """Fit forces in Coulomb cones (z up) to wrenches, every frame at once.

    ``arm`` (T, n, 3) are the points relative to the wrench's reference point, divided by the
    height that scales moments; ``mask`` (T, n) the points that exist; ``wrench`` (T, 6) is
    force and scaled moment. ``friction`` and ``rho`` are numbers or (T, n); ``lean``
    (T, n, 2) is the slope of the axis of each cone, level for none; ``force_weight`` is
    what a force that remains counts against a moment that does. Returns forces in the unit of the
    wrench, and the ``curvature`` if it is wanted. The outcome is a value: see ``converged``.
    """
    slack = np.array([[1 / force_weight]] * 3 + [[1.0]] * 3)
    converged = np.ones(len(mask), dtype=bool)
    force, residual = np.zeros((*mask.shape, 3)), wrench.copy()
    weight = np.broadcast_to(np.asarray(rho, dtype=np.float64), mask.shape)
    rough = np.broadcast_to(np.asarray(friction, dtype=np.float64), mask.shape)
    rough = np.maximum(rough, _SMOOTHEST)
    gradient = wrench / slack.T
    curved = np.tile(np.diag(1 / slack[:, 0]), (len(mask), 1, 1)) if curvature else None
    rows = np.flatnonzero(mask.any(axis=1))
    iterations = 0
    for steps, least_prices in _PATHS:
        if len(rows) == 0:
            break
        problem, pick = _gathered(arm, mask, weight, wrench, rows, rough, slack, lean)
        y = _start(problem)
        for least in least_prices:
            y, done, used = _newton(problem.priced(least), y, steps)
            iterations += used
        scaled = _project(problem.seen(y), problem.inv)[0]
        force[pick] = problem.forces(scaled).T
        residual[rows] = (problem.b - problem.wrench(scaled)).T
        gradient[rows] = y.T
        if curved is not None:
            hessian = _derivatives(problem, y, problem.seen(y))[1]
            curved[rows] = np.linalg.inv(hessian.transpose(2, 0, 1))
        converged[rows] = done
        rows = rows[~done]
    return ConeFit(force, residual, iterations, converged, gradient, curved)


def _gathered(
    arm: Floats,
    mask: Bools,
    weight: Floats,
    wrench: Floats,
    rows: Ints,
    friction: Floats,
    slack: Floats,
    lean: Floats | None,
) -> tuple[_Problem, tuple[Ints, Ints]]:
    """The problem of some frames, and where its points come from: rows and columns."""
    row, column = np.nonzero(mask[rows])
    pick = (rows[row], column)
    problem = _Problem(
        np.ascontiguousarray(arm[pick].T), 1 / weight[pick], np.bincount(row),
        np.ascontiguousarray(wrench[rows].T), friction[pick], slack,
        None if lean is None else np.ascontiguousarray(lean[pick].T),
    )  # fmt: skip
    return problem, pick


def _start(problem: _Problem) -> Floats:
    """A residual as small as it would be with all points sharing the load."""
    y: Floats = problem.b / problem.sum(problem.inv)
    return y


def _newton(problem: _Problem, y: Floats, steps: int) -> tuple[Floats, Bools, int]:
    """Newton steps with Armijo backtracking until the gradient vanishes."""
    y = y.copy()
    done = np.zeros(y.shape[1], dtype=bool)
    goal = _TOLERANCE * np.maximum(1.0, np.abs(problem.b).max(axis=0))
    live = np.arange(len(done))
    used = 0
    while used < steps:
        used += 1
        z = problem.seen(y[:, live])
        gradient, hessian = _derivatives(problem, y[:, live], z)
        going = np.abs(gradient).max(axis=0) >= goal[live]
        done[live[~going]] = True
        if not going.any():
            break
        if not going.all():
            live, z, gradient = live[going], z[:, problem.points(going)], gradient[:, going]
            hessian, problem = hessian[:, :, going], problem.take(going)
        step = _solved(hessian, gradient)
        y[:, live] = _search(problem, y[:, live], z, step, gradient)
    return y, done, used


def _derivatives(problem: _Problem, y: Floats, z: Floats) -> tuple[Floats, Floats]:
    """Gradient (6, B) and Hessian (6, 6, B); ``z`` is ``problem.seen(y)``."""
    out, jacobian = _project(z, problem.inv)
    gradient = y * problem.slack - problem.b
    gradient += problem.wrench(out)
    jacobian[2] /= problem.friction
    jacobian[:, 2] /= problem.friction
    if problem.lean is not None:
        jacobian[:2] += problem.lean[:, None] * jacobian[2]
        jacobian[:, :2] += jacobian[:, 2:] * problem.lean
    # [1; X] J [1, X^T] with X the cross product by the arm.
    hessian = np.empty((6, 6, y.shape[1]))
    hessian[:3, :3] = problem.sum(jacobian)
    turned = _cross(problem.arm[:, None], jacobian)
    hessian[3:, :3] = problem.sum(turned)
    hessian[:3, 3:] = hessian[3:, :3].swapaxes(0, 1)
    hessian[3:, 3:] = problem.sum(_cross(problem.arm[:, None], turned.swapaxes(0, 1)))
    hessian[range(6), range(6)] += problem.slack
    return gradient, hessian


def _solved(hessian: Floats, gradient: Floats) -> Floats:
    """Newton step (6, B)."""
    matrix, right = np.ascontiguousarray(hessian.transpose(2, 0, 1)), -gradient.T[:, :, None]
    try:
        step = np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        # Arms of thousands of kilometres drown the unit matrix in rounding.
        rounding = _ROUNDING * np.trace(matrix, axis1=1, axis2=2)
        step = np.linalg.solve(matrix + rounding[:, None, None] * np.eye(6), right)
    return np.ascontiguousarray(step[:, :, 0].T)


def _length(z: Floats) -> Floats:
    """Of the tangential part."""
    squared = z[0] * z[0]
    squared += z[1] * z[1]
    length: Floats = np.sqrt(squared, out=squared)
    return length


def _worth(problem: _Problem, z: Floats) -> Floats:
    """(..., B) what the points (3, ..., P) add to phi: half the squared length of projections."""
    tangent = _length(z)
    low, high = np.maximum(z[2] - tangent, 0), np.maximum(z[2] + tangent, 0)
    low *= low
    high *= high
    low += high
    low *= 0.25 * problem.inv
    return problem.sum(low)


def _project(z: Floats, inv: Floats) -> tuple[Floats, Floats]:
    """S f: projection of (3, P) on |t| <= n times ``inv`` (P,), and an element of its generalised
    Jacobian (3, 3, P).

    In spectral form: values n -+ |t| on (-+u, 1) / 2 with u = t / |t|, each cut off at zero.
    """
    tangent = _length(z)
    low, high = z[2] - tangent, z[2] + tangent
    halved = 0.5 * inv
    d_low, d_high = halved * (low > 0), halved * (high > 0)
    g_low, g_high = low * d_low, high * d_high
    mean, half = d_high + d_low, d_high - d_low
    # Without a tangential part both values are one, and u may be anything.
    straight = tangent == 0
    tangent[straight] = 1.0
    ux, uy = z[0] / tangent, z[1] / tangent
    across = (g_high - g_low) / tangent
    across[straight] = mean[straight]
    out = np.empty_like(z)
    out[:2] = across * z[:2]
    out[2] = g_high + g_low
    along = mean - across
    jacobian = np.empty((3, *z.shape))
    along_x = along * ux
    jacobian[0, 0] = across + along_x * ux
    jacobian[1, 1] = across + along * uy * uy
    jacobian[0, 1] = jacobian[1, 0] = along_x * uy
    jacobian[0, 2] = jacobian[2, 0] = half * ux
    jacobian[1, 2] = jacobian[2, 1] = half * uy
    jacobian[2, 2] = mean
    return out, jacobian


def _search(problem: _Problem, y: Floats, z: Floats, step: Floats, gradient: Floats) -> Floats:
    """Armijo backtracking, each frame its own step length; ``z`` is ``problem.seen(y)``."""
    # Along a step phi is a parabola and what the points add, whose z run straight.
    moved = problem.seen(step)
    off = y * problem.slack - problem.b
    base = _worth(problem, z)
    # The last steps change phi by less than rounding: allow for that.
    value = base + np.sum((off - 0.5 * problem.slack * y) * y, axis=0)
    parts = np.stack([
        base + 1e-14 * (1 + np.abs(value)), 1e-4 * np.sum(gradient * step, axis=0),
        np.sum(off * step, axis=0), 0.5 * np.sum(problem.slack * step * step, axis=0),
    ])  # fmt: skip
    length = np.full(y.shape[1], _SHORTEST)
    rising = np.arange(y.shape[1])
    for tried in _LENGTHS:
        most, slope, linear, square = parts
        added = _worth(problem, z[:, None] + tried * moved[:, None])
        high = added + tried * (linear - slope + tried * square) > most
        still = high.all(axis=0)
        length[rising[~still]] = tried[high.argmin(axis=0)[~still], 0]
        if not still.any():
            break
        points = problem.points(still)
        z, moved = z[:, points], moved[:, points]
        parts, rising, problem = parts[:, still], rising[still], problem.take(still)
    searched: Floats = y + length * step
    return searched
