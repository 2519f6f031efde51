"""Inverse kinematics: a Levenberg–Marquardt solver over all frames of a clip at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from physretarget.errors import UsageError
from physretarget.kinematics.pose import Pose, forward, points, screws
from physretarget.kinematics.rotations import Floats, rotvec_slope
from physretarget.kinematics.tree import Ints, Tree, difference, integrate

Bools = NDArray[np.bool_]

_SMALLEST_DAMPING = 1e-9
_LARGEST_DAMPING = 1e6


@dataclass(frozen=True, eq=False)
class PointTargets:
    """Points of bodies and where they shall be.

    ``body`` (K,), ``local`` (K, 3) in the body's frame, ``target`` (T, K, 3) in the world
    with NaN for "no target", ``weight`` scalar, (K,) or (T, K): the cost of a point is
    ``weight/2 · distance²``.
    """

    body: Ints
    local: Floats
    target: Floats
    weight: Floats | float = 1.0


@dataclass(frozen=True, eq=False)
class Solution:
    """What :func:`solve` found.

    ``qpos`` (T, nq); ``residual`` (T, K) distance of each point to its target in metres, NaN
    where there is none; ``iterations`` the most that any frame took; ``converged`` (T,).
    """

    qpos: Floats
    residual: Floats
    iterations: int
    converged: Bools


@dataclass(frozen=True, eq=False)
class Problem:
    """The cost of a batch of frames; all arrays batch over the same frames."""

    tree: Tree
    body: Ints
    local: Floats
    target: Floats  # (T, K, 3), zeros where the weight is zero
    weight: Floats  # (T, K)
    prior: Floats  # (T, nq)
    prior_weight: Floats  # (nv,)
    lower: Floats  # (nq,)
    upper: Floats  # (nq,)
    free: Bools  # (nv,)

    def of(self, frames: Ints | slice | Bools) -> Problem:
        """The same for some of the frames."""
        return replace(
            self,
            target=self.target[frames],
            weight=self.weight[frames],
            prior=self.prior[frames],
        )

    def errors(self, pose: Pose) -> Floats:
        """(T, K, 3) from each target to its point, m."""
        return points(pose, self.body, self.local) - self.target

    def cost(self, qpos: Floats, error: Floats) -> Floats:
        """(T,) half the weighted squares of errors and of what the pose is off the prior, m²."""
        near = np.einsum("tk,tkc,tkc->t", self.weight, error, error)
        if self.prior_weight.any():
            away = difference(self.tree, self.prior, qpos)
            near = near + (away * away) @ self.prior_weight
        half: Floats = 0.5 * near
        return half


def solve(
    tree: Tree,
    start: Floats,
    targets: Sequence[PointTargets],
    *,
    lower: Floats | None = None,
    upper: Floats | None = None,
    locked: Bools | None = None,
    prior: Floats | None = None,
    prior_weight: Floats | float = 0.0,
    iterations: int = 30,
    damping: float = 1e-3,
    tolerance: float = 1e-5,
    chunk: int = 256,
) -> Solution:
    """Bring points of ``tree`` to their targets in every frame, by weighted least squares.

    Parameters
    ----------
    start: (T, nq) or (nq,), where the search begins; ``locked`` dofs keep these values.
    targets: any number of :class:`PointTargets` with T frames each.
    lower, upper: (nq,) bounds; only those of hinges and slides are heeded.
    locked: (nv,) True for degrees of freedom that must not move.
    prior, prior_weight: qpos (T, nq) or (nq,), by default ``start``, and weights (nv,) in m²
        per rad² (m² per m² for lengths): costs ``weight/2 · difference²``.
    iterations: the most steps tried per frame.
    tolerance: a frame has converged when its step stays below this (rad or m).
    chunk: frames solved at once; memory does not grow with the length of the clip.

    Every frame has its own damping and is independent of the others. Deterministic.
    """
    start = np.atleast_2d(np.asarray(start, dtype=np.float64))
    problem = pose_problem(tree, start, targets, lower, upper, locked, prior, prior_weight)
    frames = len(problem.target)
    qpos = np.array(np.broadcast_to(start, (frames, tree.nq)))
    residual = np.empty((frames, len(problem.body)))
    converged = np.zeros(frames, dtype=bool)
    most = 0
    for first in range(0, frames, chunk):
        part = slice(first, first + chunk)
        some = problem.of(part)
        qpos[part], converged[part], taken = _solve_chunk(
            some, qpos[part], iterations, damping, tolerance
        )
        most = max(most, taken)
        distance = np.linalg.norm(some.errors(forward(tree, qpos[part])), axis=-1)
        residual[part] = np.where(some.weight > 0, distance, np.nan)
    return Solution(qpos, residual, most, converged)


def pose_problem(
    tree: Tree,
    start: Floats,
    targets: Sequence[PointTargets],
    lower: Floats | None,
    upper: Floats | None,
    locked: Bools | None,
    prior: Floats | None,
    prior_weight: Floats | float,
) -> Problem:
    """The cost of a batch of frames, from the arguments of :func:`solve`."""
    if not targets:
        raise UsageError("solve needs at least one PointTargets.")
    target = np.concatenate([np.asarray(t.target, dtype=np.float64) for t in targets], axis=1)
    weight = np.concatenate([np.broadcast_to(t.weight, t.target.shape[:2]) for t in targets], 1)
    known = np.isfinite(target).all(axis=-1)
    heeded_lower, heeded_upper = np.full(tree.nq, -np.inf), np.full(tree.nq, np.inf)
    limited = [j.qpos for j in tree.joints if j.kind in ("hinge", "slide")]
    if lower is not None:
        heeded_lower[limited] = lower[limited]
    if upper is not None:
        heeded_upper[limited] = upper[limited]
    before = start if prior is None else np.atleast_2d(prior)
    return Problem(
        tree=tree,
        body=np.concatenate([np.asarray(t.body, dtype=np.int64) for t in targets]),
        local=np.concatenate([np.asarray(t.local, dtype=np.float64) for t in targets]),
        target=np.where(known[..., None], target, 0.0),
        weight=np.where(known, weight, 0.0),
        prior=np.broadcast_to(before, (len(target), tree.nq)),
        prior_weight=np.array(np.broadcast_to(prior_weight, tree.nv), dtype=np.float64),
        lower=heeded_lower,
        upper=heeded_upper,
        free=np.ones(tree.nv, dtype=bool) if locked is None else ~np.asarray(locked),
    )


def _solve_chunk(
    problem: Problem, qpos: Floats, iterations: int, damping: float, tolerance: float
) -> tuple[Floats, Bools, int]:
    """Levenberg–Marquardt with one damping per frame; frames that are done leave the batch."""
    tree = problem.tree
    qpos = _clipped(problem, qpos)
    done = np.zeros(len(qpos), dtype=bool)
    strength = np.full(len(qpos), damping)
    pose = forward(tree, qpos)
    error = problem.errors(pose)
    cost = problem.cost(qpos, error)
    for taken in range(iterations):
        live = np.flatnonzero(~done)
        if not len(live):
            return qpos, done, taken
        some, at = problem.of(live), Pose(pose.position[live], pose.rotation[live])
        step = _step(some, qpos[live], at, error[live], strength[live])
        trial = _clipped(some, integrate(tree, qpos[live], step))
        trial_pose = forward(tree, trial)
        trial_error = some.errors(trial_pose)
        trial_cost = some.cost(trial, trial_error)
        better = trial_cost <= cost[live]
        won = live[better]
        # Nothing left to gain: the step is tiny, or even the most careful one does not help.
        small = np.abs(step).max(axis=1) < tolerance
        stuck = ~better & (strength[live] >= _LARGEST_DAMPING)
        gain = cost[live] - trial_cost
        flat = better & (gain <= 1e-9 * cost[live])
        done[live[small | stuck | flat]] = True
        strength[live] = np.clip(
            strength[live] * np.where(better, 0.2, 8.0), _SMALLEST_DAMPING, _LARGEST_DAMPING
        )
        qpos[won], error[won], cost[won] = trial[better], trial_error[better], trial_cost[better]
        pose.position[won] = trial_pose.position[better]
        pose.rotation[won] = trial_pose.rotation[better]
    return qpos, done, iterations


def _step(problem: Problem, qpos: Floats, pose: Pose, error: Floats, strength: Floats) -> Floats:
    """One damped Gauss–Newton step (T, nv), zero along locked dofs and against bounds."""
    matrix, gradient = normal_equations(problem.tree, qpos, pose, problem, error)
    if problem.prior_weight.any():
        add_prior(problem, qpos, matrix, gradient)
    diagonal = np.einsum("tii->ti", matrix)
    # Degrees of freedom that no point sees have a zero diagonal; the floor holds them.
    floor = 1e-3 * diagonal.max(axis=1, keepdims=True) + 1e-12
    diagonal += strength[:, None] * (diagonal + floor)
    fixed = against_bounds(problem, qpos, gradient) | ~problem.free
    frame, dof = np.nonzero(fixed)
    matrix[frame, dof, :] = 0.0
    matrix[frame, :, dof] = 0.0
    matrix[frame, dof, dof] = 1.0
    step = np.linalg.solve(matrix, np.where(fixed, 0.0, -gradient)[..., None])
    return np.asarray(step[..., 0], dtype=np.float64)


def add_prior(problem: Problem, qpos: Floats, matrix: Floats, gradient: Floats) -> None:
    """Add slope and Gauss–Newton curvature of ``weight/2 · difference²`` in place."""
    weight = problem.prior_weight
    away = difference(problem.tree, problem.prior, qpos)
    dof = problem.tree.scalars[1]
    gradient[:, dof] += weight[dof] * away[:, dof]
    matrix[:, dof, dof] += weight[dof]
    turns = problem.tree.quats[1]
    slope = rotvec_slope(away[:, turns])  # (T, n, 3, 3)
    weighted = weight[turns][..., None] * slope
    gradient[:, turns] += np.einsum("tnji,tnj->tni", weighted, away[:, turns])
    rows, columns = turns[:, :, None], turns[:, None, :]
    matrix[:, rows, columns] += np.swapaxes(slope, -1, -2) @ weighted


def normal_equations(
    tree: Tree, qpos: Floats, pose: Pose, problem: Problem, error: Floats
) -> tuple[Floats, Floats]:
    """JᵀWJ (T, nv, nv) and JᵀW·error (T, nv), without ever forming the Jacobian J.

    JᵀWJ is the joint-space inertia matrix of a tree of point masses W: sums of mass, first
    and second moment over what each degree of freedom carries give it (the composite rigid
    body algorithm, Featherstone 2008, ch. 6). For many points this is far cheaper than J.
    """
    frames = len(qpos)
    centre = pose.position[:, 1:2]  # moments about the root keep the numbers small
    at = error + problem.target - centre
    weight = problem.weight
    pull = weight[..., None] * error
    packed = np.empty((frames, len(problem.body), 16))
    packed[..., 0] = weight
    first = weight[..., None] * at
    packed[..., 1:4] = first
    packed[..., 4:10] = first[..., (0, 0, 0, 1, 1, 2)] * at[..., (0, 1, 2, 1, 2, 2)]
    packed[..., 10:13] = pull
    packed[..., 13:16] = _cross(at, pull)
    carried = tree.carries[:, problem.body].astype(np.float64)
    total = np.matmul(carried, packed)[:, tree.dof_body]  # (T, nv, 16)
    angular, anchor, linear = screws(tree, pose, qpos)
    linear = linear + _cross(anchor - centre, angular)  # velocity at the centre
    mass, moment = total[..., :1], total[..., 1:4]
    second = total[..., (4, 5, 6, 5, 7, 8, 6, 8, 9)].reshape(frames, tree.nv, 3, 3)
    trace = total[..., 4] + total[..., 7] + total[..., 9]
    force = mass * linear + _cross(angular, moment)
    torque = _cross(moment, linear) + trace[..., None] * angular
    torque -= np.matmul(second, angular[..., None])[..., 0]
    gradient = np.sum(angular * total[..., 13:16] + linear * total[..., 10:13], axis=-1)
    screw = np.concatenate([angular, linear], axis=-1)
    wrench = np.concatenate([torque, force], axis=-1)
    # Row i, column j: valid where dof i carries the body of dof j. Dofs of one body carry
    # the same points, so both triangles agree there; the rest is filled by symmetry.
    matrix = np.matmul(screw, np.swapaxes(wrench, 1, 2))
    above = tree.carries[np.ix_(tree.dof_body, tree.dof_body)]
    matrix *= above.astype(np.float64)
    row, column = np.nonzero(~above)
    matrix[:, row, column] = matrix[:, column, row]
    return matrix, gradient


def _cross(a: Floats, b: Floats) -> Floats:
    """Cross product over the last axis; np.cross costs several times as much."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    out[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    out[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return out


def stiffness(
    tree: Tree, qpos: Floats, pose: Pose, body: Ints, local: Floats, weight: Floats
) -> Floats:
    """JᵀWJ (T, nv, nv) of the points ``local`` (K, 3) of ``body`` (K,), weights W (T, K).

    ``pose`` must be ``forward(tree, qpos)``. Half its quadratic form in a small step is half the
    weighted sum of squares by which the points move.
    """
    at = points(pose, body, local)
    return attraction(tree, qpos, pose, PointTargets(body, local, at, weight))[0]


def attraction(
    tree: Tree, qpos: Floats, pose: Pose, targets: PointTargets
) -> tuple[Floats, Floats]:
    """JᵀWJ (T, nv, nv) and JᵀW (x - target) (T, nv): Gauss-Newton's view of ½ Σ w |x - target|².

    ``pose`` must be ``forward(tree, qpos)``.
    """
    problem = pose_problem(tree, qpos, [targets], None, None, None, None, 0.0)
    return normal_equations(tree, qpos, pose, problem, problem.errors(pose))


def against_bounds(problem: Problem, qpos: Floats, gradient: Floats) -> Bools:
    """(T, nv): dofs that sit on a bound and would be pushed through it."""
    at, dof = problem.tree.scalars
    fixed = np.zeros(gradient.shape, dtype=bool)
    down = (qpos[:, at] <= problem.lower[at]) & (gradient[:, dof] > 0)
    up = (qpos[:, at] >= problem.upper[at]) & (gradient[:, dof] < 0)
    fixed[:, dof] = down | up
    return fixed


def _clipped(problem: Problem, qpos: Floats) -> Floats:
    return np.clip(qpos, problem.lower, problem.upper)
