"""Inverse kinematics over a clip: poses that follow their targets and each other.

Solved frame by frame, a shoulder of three hinges answers evenly moving targets with leaps
between its two ways of reaching them. Here all frames of a window are unknowns of one least
squares problem in which the joints' velocity and acceleration have a price, and one banded
Cholesky factorisation gives the Gauss–Newton step of all of them. Prices are per rad/s and
rad/s², so that the answer is the same motion at any frame rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg.lapack import dpbsv
from scipy.ndimage import minimum_filter1d, uniform_filter1d

from physretarget.kinematics.pose import Pose, forward
from physretarget.kinematics.rotations import Floats
from physretarget.kinematics.solver import (
    Bools,
    PointTargets,
    Problem,
    add_prior,
    against_bounds,
    normal_equations,
    pose_problem,
)
from physretarget.kinematics.tree import Ints, Tree, difference, integrate

WINDOW, OVERLAP = 192, 32
"""Frames solved together, and how many of them the next window solves again."""
LONGEST_STEP = 0.5
"""Farthest that a degree of freedom moves in one iteration (rad or m): linearisation reaches no
farther, and near a singular pose the Gauss–Newton step can be a full turn."""
NEIGHBOURS = 9
"""Frames over which a step that was cut short cuts its neighbours' short, so that the correction
stays smooth in time."""
_LARGEST_DAMPING = 1e3


@dataclass(frozen=True, kw_only=True, eq=False)
class Price:
    """What motion costs, beside the targets' ``weight/2 · distance²``.

    ``velocity`` (nv,) in m² s²: half of it is the cost of 1 (rad/s)² in one frame, or of
    1 (m/s)² along a slide. ``acceleration`` (nv,) in m² s⁴, likewise of 1 (rad/s²)².
    """

    velocity: Floats
    acceleration: Floats


@dataclass(frozen=True, eq=False)
class Trajectory:
    """What :func:`solve_trajectory` found.

    ``qpos`` (T, nq); ``residual`` (T, K) distance of each point to its target in metres, NaN
    where there is none; ``iterations`` the most that any window took.
    """

    qpos: Floats
    residual: Floats
    iterations: int


def solve_trajectory(
    tree: Tree,
    starts: Sequence[Floats],
    targets: Sequence[PointTargets],
    *,
    step_s: float,
    price: Price,
    lower: Floats | None = None,
    upper: Floats | None = None,
    locked: Bools | None = None,
    prior: Floats | None = None,
    prior_weight: Floats | float = 0.0,
    reference: Floats | None = None,
    doubt: float = np.inf,
    iterations: int = 12,
    damping: float = 1e-2,
    tolerance: float = 1e-3,
) -> Trajectory:
    """Bring points of ``tree`` to their targets along a path that is smooth in time.

    Args:
        tree: whose poses are sought.
        starts: poses (T, nq) from which each window begins. The second and further ones are
            tried where the first leads to a window whose cost per frame exceeds ``doubt``; the
            cheapest answer counts.
        targets: as for :func:`physretarget.kinematics.solve`, T frames each.
        step_s: time between frames, s.
        price: of velocity and acceleration.
        lower, upper: (nq,) bounds of hinges and slides.
        locked: (nv,) degrees of freedom that keep the values of the first start.
        prior, prior_weight: pose (T, nq), by default the first start, and weights (nv,) of
            staying with it.
        reference: poses (T, nq) whose own motion has no price: only what differs from their
            velocity and acceleration has.
        doubt: cost of a frame, m².
        iterations: the most steps per window and start.
        damping: Levenberg–Marquardt's at first, as a share of the curvature of each degree of
            freedom; it never falls below a tenth of that. It must be small beside the ratio of the
            smallest weight that matters to the largest.
        tolerance: a window is done when its step is below this (rad or m).

    Windows follow each other in time, each with the two poses before it given; memory does not
    grow with the length of the clip. Deterministic.
    """
    first = starts[0]
    whole = pose_problem(tree, first, targets, lower, upper, locked, prior, prior_weight)
    frames = len(first)
    qpos = np.array(first)
    residual = np.empty((frames, len(whole.body)))
    most = 0
    for at in range(0, frames, WINDOW - OVERLAP):
        part = slice(at, min(at + WINDOW, frames))
        if at and part.stop - at <= OVERLAP:
            break  # the window before reached the end
        usual = None if reference is None else reference[max(at - 2, 0) : part.stop]
        window = _Window(whole.of(part), price, step_s, qpos[max(at - 2, 0) : at], usual)
        best = window.solved(qpos[part], iterations, damping, tolerance)
        for other in starts[1:]:
            if best.cost <= doubt * (part.stop - at):
                break
            found = window.solved(other[part], iterations, damping, tolerance)
            best = found if found.cost < best.cost else best
        qpos[part] = best.qpos
        distance = np.linalg.norm(best.error, axis=-1)
        residual[part] = np.where(window.problem.weight > 0, distance, np.nan)
        most = max(most, best.iterations)
    return Trajectory(qpos, residual, most)


@dataclass(frozen=True, eq=False)
class _State:
    """Poses of a window and what they cost."""

    qpos: Floats
    pose: Pose
    error: Floats
    cost: float
    iterations: int = 0


@dataclass(frozen=True, eq=False)
class _Window:
    """Frames that are solved together, and the poses (0 to 2, nq) before them.

    ``usual`` are poses of all these whose motion has no price, if any.
    """

    problem: Problem
    price: Price
    step_s: float
    before: Floats
    usual: Floats | None = None

    @cached_property
    def _usual_speed(self) -> Floats:
        assert self.usual is not None
        steps = difference(self.problem.tree, self.usual[:-1], self.usual[1:])
        return np.asarray(steps / self.step_s)

    def solved(self, start: Floats, iterations: int, damping: float, tolerance: float) -> _State:
        """Levenberg–Marquardt from one start."""
        now = self._at(np.clip(start, self.problem.lower, self.problem.upper))
        least = 0.1 * damping
        for taken in range(1, iterations + 1):
            step = self._step(now, damping)
            trial = self._moved(now, step)
            if trial.cost <= now.cost:
                gain = now.cost - trial.cost
                now, damping = replace(trial, iterations=taken), max(0.2 * damping, least)
                if gain <= 1e-5 * now.cost:
                    break
            else:
                damping = 10.0 * damping
            if np.abs(step).max() < tolerance or damping > _LARGEST_DAMPING:
                break
        return now

    def _at(self, qpos: Floats) -> _State:
        pose = forward(self.problem.tree, qpos)
        error = self.problem.errors(pose)
        speed, change = self._rates(qpos)
        cost = float(np.sum(self.problem.cost(qpos, error)))
        cost += 0.5 * float(np.sum(self.price.velocity * speed * speed))
        cost += 0.5 * float(np.sum(self.price.acceleration * change * change))
        return _State(qpos, pose, error, cost)

    def _moved(self, now: _State, step: Floats) -> _State:
        qpos = integrate(self.problem.tree, now.qpos, step)
        return self._at(np.clip(qpos, self.problem.lower, self.problem.upper))

    def _rates(self, qpos: Floats) -> tuple[Floats, Floats]:
        """Velocities and accelerations between the frames, those before included."""
        path = np.concatenate([self.before, qpos])
        speed = difference(self.problem.tree, path[:-1], path[1:]) / self.step_s
        if self.usual is not None:
            speed = speed - self._usual_speed
        return speed, np.diff(speed, axis=0) / self.step_s

    def _step(self, now: _State, damping: float) -> Floats:
        """The damped Gauss–Newton step (T, nv), zero along locked dofs and against bounds."""
        problem = self.problem
        matrix, gradient = normal_equations(problem.tree, now.qpos, now.pose, problem, now.error)
        if problem.prior_weight.any():
            add_prior(problem, now.qpos, matrix, gradient)
        gradient += self._pull(now.qpos)
        fixed = against_bounds(problem, now.qpos, gradient)
        free = np.flatnonzero(problem.free)
        matrix, fixed = matrix[:, free[:, None], free], fixed[:, free]
        diagonal = np.einsum("tii->ti", matrix)
        # Degrees of freedom that no point sees have a zero diagonal; the floor holds them.
        floor = 1e-3 * diagonal.max(axis=1, keepdims=True) + 1e-12
        diagonal += damping * (diagonal + floor)
        band = self._band(matrix, ~fixed, free)
        right = np.where(fixed, 0.0, -gradient[:, free]).reshape(-1, 1)
        _, found, failed = dpbsv(band, right, lower=1, overwrite_ab=1, overwrite_b=1)
        step = np.zeros_like(gradient)
        if not failed:
            step[:, free] = found.reshape(len(gradient), -1)
        return _shortened(step)

    def _pull(self, qpos: Floats) -> Floats:
        """Slope (T, nv) of the price of motion.

        Exact for hinges and slides. Of rotations the change of one frame's axes to the next is
        left out, which is of the order of the step between them.
        """
        speed, change = self._rates(qpos)
        given, step = len(self.before), self.step_s
        slope = np.zeros((given + len(qpos), self.problem.tree.nv))
        push = self.price.velocity * speed / step
        slope[1:] += push
        slope[:-1] -= push
        push = self.price.acceleration * change / step**2
        slope[2:] += push
        slope[1:-1] -= 2.0 * push
        slope[:-2] += push
        return slope[given:]

    def _band(self, matrix: Floats, moves: Bools, free: Ints) -> Floats:
        """The curvature of a window in LAPACK's lower band storage (2n+1, T n), n free dofs.

        ``matrix`` (T, n, n) of each frame for itself; ``moves`` (T, n) False where a bound
        holds a degree of freedom, whose row becomes that of the identity.
        """
        frames, count = moves.shape
        moving = moves.astype(np.float64)
        band = np.zeros((2 * count + 1, frames * count), order="F")
        by_frame = band.T.reshape(frames, count, 2 * count + 1)
        for below in range(count):
            across = np.einsum("tii->ti", matrix[:, below:, : count - below])
            moved = moving[:, below:] * moving[:, : count - below]
            by_frame[:, : count - below, below] = across * moved
        for later, coupling in enumerate(self._couplings(free)):
            both = moving.copy()
            both[: frames - later] *= moving[later:]
            by_frame[:, :, later * count] += coupling * both
        by_frame[:, :, 0] += 1.0 - moving
        return band

    def _couplings(self, free: Ints) -> list[Floats]:
        """(T, n) coupling by the price of motion with the frame itself, the next, the one after."""
        given = len(self.before)
        total = given + len(self.problem.target)
        first, second = np.zeros((3, total)), np.zeros((3, total))
        for at, one in enumerate((-1.0, 1.0)):
            for after in range(at, 2):
                first[after - at, at : total - 1 + at] += one * (-1.0, 1.0)[after]
        for at, one in enumerate((1.0, -2.0, 1.0)):
            for after in range(at, 3):
                second[after - at, at : max(total - 2 + at, at)] += one * (1.0, -2.0, 1.0)[after]
        velocity = self.price.velocity[free] / self.step_s**2
        acceleration = self.price.acceleration[free] / self.step_s**4
        return [
            np.outer(first[k, given:], velocity) + np.outer(second[k, given:], acceleration)
            for k in range(3)
        ]


def _shortened(step: Floats) -> Floats:
    """The step, shortened around frames where it is longer than what linearisation bears."""
    longest = np.abs(step).max(axis=1)
    if longest.max(initial=0.0) <= LONGEST_STEP:
        return step
    share = np.minimum(1.0, LONGEST_STEP / np.maximum(longest, 1e-12))
    share = uniform_filter1d(minimum_filter1d(share, NEIGHBOURS), NEIGHBOURS)
    return np.asarray(step * share[:, None])
