"""Root-height optimisation of a clip: Yamane 2010, section 5.3."""

from __future__ import annotations

import time as clock
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from physretarget.errors import InputError
from physretarget.mjcf import Character
from physretarget.mjcf.dynamics import derivatives, required_wrench
from physretarget.ocp import gauss_newton, ipopt
from physretarget.ocp.basis import Basis, gaussian_basis
from physretarget.ocp.bound import cone_programme, vertical_bound
from physretarget.ocp.problem import Problem, Scene, build
from physretarget.ocp.scene import scene_of
from physretarget.ocp.settings import RootHeightSettings

Array = NDArray[np.float64]

TOUCH = 0.02
"""Contact force, in body weights, above which a frame counts as touching for the bound."""


@dataclass(frozen=True)
class RootHeight:
    """A clip with its root raised and lowered, and what that changed. T frames, SI units.

    qpos (T, nq), displacement (T,) m. required_* and contact_* (T, 3) N: force that the motion
    needs, and force of the contact model (of the cone programme for ``convex``), before and
    after. mismatch_*: RMS of their vertical difference, N. pull_*: the same with the best floor
    that never pulls and never reaches into flight, N: independent of any contact model.
    bound_rms: least mismatch of all displacements with the same contact times, N.
    ballistic_*: RMS of |CoM acceleration + g| over flight frames, m/s², NaN without flight; and
    of its vertical part alone, since the root's height cannot mend the horizontal one.
    verified: largest difference between the forces predicted by the affine law and those of a
    full pass of inverse dynamics, N.
    """

    qpos: Array
    displacement: Array
    required_before: Array
    required_after: Array
    contact_before: Array
    contact_after: Array
    mismatch_before: float
    mismatch_after: float
    pull_before: float
    pull_after: float
    bound_rms: float
    ballistic_before: float
    ballistic_after: float
    ballistic_vertical_before: float
    ballistic_vertical_after: float
    verified: float
    status: str
    iterations: int
    seconds: float
    notes: tuple[str, ...] = ()

    @property
    def bound_ratio(self) -> float:
        """Mismatch after over the bound; infinite where the bound is zero."""
        return self.mismatch_after / self.bound_rms if self.bound_rms > 0 else np.inf

    @property
    def improvement(self) -> float:
        """Share by which the vertical mismatch fell."""
        return 1.0 - self.mismatch_after / self.mismatch_before if self.mismatch_before else 0.0


@dataclass(frozen=True)
class _Answer:
    weights: Array
    contact: Array
    contact_before: Array
    status: str
    iterations: int


def optimise(
    character: Character,
    qpos: Array,
    time: Array,
    active: NDArray[np.bool_],
    *,
    pose_error: Array | None = None,
    pose_variance: Array | None = None,
    settings: RootHeightSettings | None = None,
    share: Array | None = None,
    strength: float = 1.0,
) -> RootHeight:
    """Raise and lower the root of a clip qpos (T, nq) until floor and gravity agree with it.

    ``active`` (T, P): contact points meant to touch; frames without any are flight.
    ``share`` (T,): how far each frame may move, 0 for one that stays; all alike if None.
    ``strength``: how much of the displacement that is found is made.
    ``pose_error`` (T, 3K) and ``pose_variance`` (T,): the mapper's opinion of the features.
    Raises InputError for a character without free root or contact points, or fewer than four
    frames; SolverError where a convex programme fails.
    """
    began = clock.perf_counter()
    settings = settings or RootHeightSettings()
    if len(qpos) < 4:
        raise InputError(f"root-height optimisation needs at least four frames, not {len(qpos)}")
    scene = scene_of(character, qpos, time, active, pose_error, pose_variance)
    basis = gaussian_basis(time, settings.interval, share)
    problem = build(scene, settings)
    by = _convex if settings.name == "convex" else _penalty
    answer = by(scene, basis, problem, settings)
    if strength != 1.0:
        answer = _partly(answer, strength, basis, None if by is _convex else problem)
    displacement, _, acceleration = basis.motion(answer.weights)
    touching = answer.contact[:, 2] > TOUCH * scene.weight
    bound = vertical_bound(scene, basis, touching, displacement, settings.limit * scene.size)
    raised = qpos.copy()
    raised[:, character.root_qpos + 2] += displacement
    full = required_wrench(character, raised, *derivatives(character, raised, time)).force
    after = scene.force.copy()
    after[:, 2] += scene.mass * acceleration
    return RootHeight(
        qpos=raised,
        displacement=displacement,
        required_before=scene.force,
        required_after=full,
        contact_before=answer.contact_before,
        contact_after=answer.contact,
        mismatch_before=_rms(scene.force[:, 2] - answer.contact_before[:, 2]),
        mismatch_after=_rms(full[:, 2] - answer.contact[:, 2]),
        pull_before=_rms(_unsupported(scene.force[:, 2], scene.flight)),
        pull_after=_rms(_unsupported(full[:, 2], scene.flight)),
        bound_rms=bound,
        ballistic_before=_ballistic(scene.force, scene),
        ballistic_after=_ballistic(full, scene),
        ballistic_vertical_before=_ballistic(scene.force[:, 2:], scene),
        ballistic_vertical_after=_ballistic(full[:, 2:], scene),
        verified=float(np.abs(full - after).max()),
        status=answer.status,
        iterations=answer.iterations,
        seconds=clock.perf_counter() - began,
        notes=_notes(scene, displacement, answer, settings),
    )


def _penalty(scene: Scene, basis: Basis, problem: Problem, settings: RootHeightSettings) -> _Answer:
    """The chosen solver with the residual force f0 continued from soft to hard.

    The kink of the contact is four orders sharper than the motion: solved cold, the search ends
    in a poor local minimum.
    """
    still = (np.zeros(scene.frames),) * 3
    weights, iterations, converged = np.zeros(basis.count), 0, False
    for factor in settings.continuation:
        f0 = factor * problem.model.residual
        if settings.solver == "ipopt":
            outcome = ipopt.solve(problem, basis, weights, f0=f0, ridge=settings.weights)
        else:
            outcome = gauss_newton.solve(
                problem,
                basis,
                weights,
                f0=f0,
                ridge=settings.weights,
                iterations=settings.iterations,
                tolerance=settings.tolerance,
            )
        weights, converged = outcome.weights, outcome.converged
        iterations += outcome.iterations
    return _Answer(
        weights,
        problem.contact_wrench(basis.motion(weights))[0],
        problem.contact_wrench(still)[0],
        "converged" if converged else "iteration limit",
        iterations,
    )


def _convex(scene: Scene, basis: Basis, problem: Problem, settings: RootHeightSettings) -> _Answer:
    """The cone programme; its floor before is the best one under the unmoved root."""
    found = cone_programme(scene, basis, settings)
    before = np.zeros_like(found.force)
    before[:, 2] = np.where(scene.flight, 0.0, np.maximum(scene.force[:, 2], 0.0))
    status = "converged" if found.status == "Solved" else "almost converged"
    return _Answer(found.weights, found.force, before, status, found.iterations)


def _partly(answer: _Answer, strength: float, basis: Basis, problem: Problem | None) -> _Answer:
    """A share of the displacement with its floor: the model's, or between two sets in cones."""
    weights = strength * answer.weights
    if problem is None:
        contact = answer.contact_before + strength * (answer.contact - answer.contact_before)
    else:
        contact = problem.contact_wrench(basis.motion(weights))[0]
    return replace(answer, weights=weights, contact=contact)


def _unsupported(required: Array, flight: NDArray[np.bool_]) -> Array:
    """Vertical force that no floor can supply: all of it in flight, pull elsewhere."""
    return np.where(flight, required, np.minimum(required, 0.0))


def _ballistic(required: Array, scene: Scene) -> float:
    """RMS length of required force over mass, in flight; that is CoM acceleration + g."""
    return _rms(np.linalg.norm(required[scene.flight], axis=1)) / scene.mass


def _notes(
    scene: Scene, displacement: Array, answer: _Answer, settings: RootHeightSettings
) -> tuple[str, ...]:
    notes = []
    largest = float(np.abs(displacement).max()) / scene.size
    if largest > 0.98 * settings.limit:
        notes.append(
            f"the root's displacement reaches its limit of {settings.limit:.0%} of the height"
        )
    if answer.status != "converged":
        notes.append(f"the root-height optimisation stopped early: {answer.status}")
    return tuple(notes)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")
