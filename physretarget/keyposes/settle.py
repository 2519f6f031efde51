"""Bringing a pose down to its floor: planted points on it, nothing in it.

What an animator does by hand after every change, as whole-body inverse kinematics: the pose moves
as little as it can, joints stay within their limits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import mujoco
import numpy as np
from numpy.typing import NDArray

from physretarget.ground.undersides import Solid, lowest_heights, solids
from physretarget.keyposes.pose import KeyPose, KeyPoseSet, without_heading
from physretarget.kinematics import PointTargets, Pose, forward, integrate, points, solve
from physretarget.mjcf import Character

__all__ = ["Pull", "plant", "planted_contacts", "pulled", "settled"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

# Costs of a metre (squared) off the floor, of a metre from where a point is pulled, and of a radian
# away from the pose before: a planted foot gives way to nothing, the rest of the body to the hand.
CONTACT_WEIGHT, PULL_WEIGHT, STAY_WEIGHT = 100.0, 1.0, 1e-3
# Parts may sink this far, m: below what the check of key poses minds.
_SINKS = 5e-4
# What a planted point that slides costs, per square metre; a step turns no joint further, rad.
_SLIDE_WEIGHT, _LONGEST_STEP = 1.0, 0.3
# A point is pulled by at most this share of the height at a time: faster than a hand, at 60 Hz.
_LEASH = 0.05
# Bringing one part out of the floor may bring another in: so many times it is looked again.
_ROUNDS, _ACTIVE_ROUNDS = 60, 6
# While a hand drags, the next pose begins where this one ends: fewer steps do, in under 5 ms.
_DRAG_STEPS, _FLOOR_ROUNDS = 5, 4
# Of one geom so many points are held up at a time: a face has four corners.
_LOWEST_OF_A_PART = 4


@dataclass(frozen=True, eq=False)
class Pull:
    """A point (3,) fixed on a body, in its frame, and where in the world it shall go (3,), m."""

    body: int
    local: Array
    target: Array


def planted_contacts(character: Character, planted: Sequence[str]) -> Ints:
    """Contact points of the character that are tied to one of the actor's ``planted`` points."""
    return np.array([i for i, tie in enumerate(character.tied) if tie in planted], dtype=np.int64)


def pulled(
    character: Character,
    qpos: Array,
    pulls: Sequence[Pull] = (),
    *,
    planted: Sequence[str] = (),
    held: Sequence[int] = (),
) -> Array:
    """The pose (nq,) with points pulled to their places, planted ones firm, nothing in the floor.

    Args:
        character: whose pose it is.
        qpos: (nq,) the pose before; it is left by as little as possible.
        pulls: what is pulled, and where to; farther than a twentieth of the height it takes
            several calls, each on the pose of the one before.
        planted: the actor's contact points that stand; what is tied to them goes to the floor below
            where it is, and stays there.
        held: degrees of freedom that must not move.
    """
    pulls = _leashed(character, qpos, pulls)
    targets = [*_down(character, qpos, planted), *_targets(pulls)]
    found = np.array(qpos, dtype=np.float64)
    if targets:
        found = solve(
            character.tree, qpos[None], targets, lower=character.lower, upper=character.upper,
            locked=_locked(character, held), prior=qpos[None], prior_weight=STAY_WEIGHT,
            iterations=_DRAG_STEPS,
        ).qpos[0]  # fmt: skip
    return _put_down(character, found, planted, held, _FLOOR_ROUNDS, pulls, slide=CONTACT_WEIGHT)


def settled(
    character: Character, qpos: Array, *, planted: Sequence[str] = (), held: Sequence[int] = ()
) -> Array:
    """The pose (nq,) on its floor: planted points on it, none of the geometry in it.

    Where both cannot be had, the whole body is lifted.

    Args:
        character: The character.
        qpos: (nq,) pose.
        planted: Names of the contact points that stand.
        held: Degrees of freedom that keep their value.

    Returns:
        (nq,) the pose on the floor.
    """
    found = _put_down(character, np.asarray(qpos, dtype=np.float64), planted, held, _ROUNDS)
    return _lifted(character, found, _solids(character))


def plant(keyposes: KeyPoseSet, character: Character) -> KeyPoseSet:
    """Key poses put down: of every pose what stands stands on the floor, and nothing is in it.

    Args:
        keyposes: The key poses.
        character: The character that was posed.

    Returns:
        The key poses on the floor.
    """
    return replace(keyposes, poses=tuple(_planted(pose, character) for pose in keyposes.poses))


def _planted(pose: KeyPose, character: Character) -> KeyPose:
    qpos = settled(character, pose.qpos, planted=pose.planted)
    return replace(pose, qpos=without_heading(qpos, front=character.front, up=character.up))


def _leashed(character: Character, qpos: Array, pulls: Sequence[Pull]) -> list[Pull]:
    """Pulls no longer than a leash, so that no hand is stronger than the floor."""
    pose, longest, found = forward(character.tree, qpos[None]), _LEASH * character.height, []
    for pull in pulls:
        place = pose.position[0, pull.body] + pose.rotation[0, pull.body] @ pull.local
        way = pull.target - place
        far = float(np.linalg.norm(way))
        found.append(replace(pull, target=place + way * min(1.0, longest / max(far, 1e-12))))
    return found


def _targets(pulls: Sequence[Pull]) -> list[PointTargets]:
    return [
        PointTargets(np.array([p.body]), p.local[None], p.target[None, None], PULL_WEIGHT)
        for p in pulls
    ]


def _down(character: Character, qpos: Array, planted: Sequence[str]) -> list[PointTargets]:
    """Planted contact points, on the floor below where they are."""
    which = planted_contacts(character, planted)
    if not len(which):
        return []
    body, local = character.contacts.body[which], character.contacts.local[which]
    place = points(forward(character.tree, qpos[None]), body, local)
    place[..., 2] = character.floor_height
    return [PointTargets(body, local, place, CONTACT_WEIGHT)]


def _locked(character: Character, held: Sequence[int]) -> NDArray[np.bool_]:
    locked = np.zeros(character.tree.nv, dtype=bool)
    locked[list(held)] = True
    return locked


def _put_down(
    character: Character,
    qpos: Array,
    planted: Sequence[str],
    held: Sequence[int],
    rounds: int,
    pulls: Sequence[Pull] = (),
    slide: float = _SLIDE_WEIGHT,
) -> Array:
    """Gauss-Newton on heights: planted points on the floor, what is in it out of it.

    Heights alone are asked for, so that a part may leave the floor along the shortest way; planted
    points are held where they stand at the price ``slide``, and ``pulls`` pull on. A joint at its
    limit stays there.
    """
    model, every = character.model, _solids(character)
    which = planted_contacts(character, planted)
    body, local = character.contacts.body[which], character.contacts.local[which]
    data, found = mujoco.MjData(model), np.array(qpos, dtype=np.float64)
    stand = points(forward(character.tree, found[None]), body, local)[0]
    for _ in range(rounds):
        pose = forward(character.tree, found[None])
        place = points(pose, body, local)[0]
        sunk = _sunk(character, pose, every)
        off = place[:, 2] - character.floor_height
        if not sunk and np.abs(off).max(initial=0.0) < _SINKS:
            return found
        data.qpos[:] = found
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        rows, error, weight = [], [], []
        jacobian = np.zeros((3, model.nv))
        for k, owner in enumerate(body.tolist()):
            mujoco.mj_jac(model, data, jacobian, None, place[k], owner)
            rows.append(jacobian.copy())
            error.append([*(place[k, :2] - stand[k, :2]), off[k]])
            weight.append([slide, slide, CONTACT_WEIGHT])
        for pull in pulls:
            turn, origin = pose.rotation[0, pull.body], pose.position[0, pull.body]
            point = origin + turn @ pull.local
            mujoco.mj_jac(model, data, jacobian, None, point, pull.body)
            rows.append(jacobian.copy())
            error.append((point - pull.target).tolist())
            weight.append([PULL_WEIGHT] * 3)
        for owner, point, depth in sunk:
            mujoco.mj_jac(model, data, jacobian, None, point, owner)
            rows.append(jacobian[2:].copy())
            error.append([depth])
            weight.append([CONTACT_WEIGHT])
        found = _moved(
            character, found, np.concatenate(rows), np.concatenate(error), np.concatenate(weight),
            ~_locked(character, held),
        )  # fmt: skip
    return found


def _moved(
    character: Character, qpos: Array, rows: Array, error: Array, weight: Array,
    free: NDArray[np.bool_],
) -> Array:  # fmt: skip
    """The pose after a step that takes errors (m,) off, by their derivatives ``rows`` (m, nv)."""
    matrix = (rows.T * weight) @ rows + STAY_WEIGHT * np.eye(rows.shape[1])
    pull = rows.T @ (weight * error)
    tree = character.tree
    at, dof = tree.scalars
    low, high = character.lower[at], character.upper[at]
    for _ in range(_ACTIVE_ROUNDS):
        step = np.zeros(len(pull))
        step[free] = np.linalg.solve(matrix[np.ix_(free, free)], -pull[free])
        step *= min(1.0, _LONGEST_STEP / max(float(np.abs(step).max()), 1e-12))
        goal = qpos[at] + step[dof]
        beyond = ((goal < low - 1e-9) | (goal > high + 1e-9)) & free[dof]
        # Stop at the limit where it is met, and let the others do the rest.
        stuck = beyond & ((qpos[at] <= low + 1e-9) | (qpos[at] >= high - 1e-9))
        if not stuck.any():
            break
        free = free.copy()
        free[dof[stuck]] = False
    found: Array = integrate(tree, qpos[None], step[None])[0]
    found[at] = np.clip(found[at], low, high)
    return found


def _sunk(
    character: Character, pose: Pose, every: Sequence[Solid]
) -> list[tuple[int, Array, float]]:
    """The lowest points of what is in the floor: body, place (3,) m, height below 0 m."""
    found = []
    for solid in every:
        height = solid.heights(pose)[0] - character.floor_height
        for k in np.argsort(height)[:_LOWEST_OF_A_PART].tolist():
            if height[k] < -_SINKS:
                turn, place = pose.rotation[0, solid.body], pose.position[0, solid.body]
                underside = solid.undersides(turn[2])[k]
                found.append((solid.body, place + turn @ underside, float(height[k])))
    return found


def _lifted(character: Character, qpos: Array, every: Sequence[Solid]) -> Array:
    heights = lowest_heights(every, forward(character.tree, qpos[None]))
    lowest = float(heights.min(initial=np.inf)) - character.floor_height
    found = qpos.copy()
    if lowest < -_SINKS and character.has_root:
        found[character.root_qpos + 2] -= lowest
    return found


@lru_cache(maxsize=8)
def _solids(character: Character) -> tuple[Solid, ...]:
    return solids(character)
