"""Bringing a pose down to its floor: planted points on it, nothing in it.

What an animator does by hand after every change, as whole-body inverse kinematics: the pose moves
as little as it can, joints stay within their limits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from physretarget.ground.undersides import Solid, lowest_heights, solids
from physretarget.keyposes.pose import KeyPose, KeyPoseSet, without_heading
from physretarget.kinematics import PointTargets, forward, points, solve
from physretarget.mjcf import Character

__all__ = ["Pull", "plant", "planted_contacts", "pulled", "settled"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

# Costs of a metre (squared) off the floor, of a metre from where a point is pulled, and of a radian
# away from the pose before: a planted foot gives way to nothing, the rest of the body to the hand.
CONTACT_WEIGHT, PULL_WEIGHT, STAY_WEIGHT = 100.0, 1.0, 1e-3
# Parts may sink this far, m: below what the check of key poses minds.
_SINKS = 5e-4
# Bringing one part out of the floor may bring another in: so many times it is looked again.
_ROUNDS = 4
_STEPS = 12
# While a hand drags, the next pose begins where this one ends: fewer do, in under 5 ms.
_DRAG_STEPS = 5
# Of one geom so many points are held up at a time: a face has four corners.
_LOWEST_OF_A_PART = 4


@dataclass(frozen=True, eq=False)
class Pull:
    """A point (3,) fixed on a body, in its frame, and where in the world it shall go (3,), m."""

    body: int
    local: Array
    target: Array
    weight: float = PULL_WEIGHT


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
    stay: float = STAY_WEIGHT,
) -> Array:
    """The pose (nq,) with points pulled to their places, planted ones firm, nothing in the floor.

    Args:
        character: whose pose it is.
        qpos: (nq,) the pose before; it is left by as little as possible.
        pulls: what is pulled, and where to.
        planted: the actor's contact points that stand; what is tied to them goes to the floor below
            where it is, and stays there.
        held: degrees of freedom that must not move.
        stay: what a radian away from ``qpos`` costs, in m².
    """
    firm = [*_down(character, qpos, planted), *_targets(pulls)]
    found = _solved(character, qpos, firm, held, stay, _DRAG_STEPS)
    sunk = _sunk(character, found, _solids(character))
    if sunk is None:
        return found
    return _solved(character, found, [*firm, sunk], held, stay, _DRAG_STEPS)


def settled(
    character: Character, qpos: Array, *, planted: Sequence[str] = (), held: Sequence[int] = ()
) -> Array:
    """The pose (nq,) on its floor: planted points on it, none of the geometry in it.

    Where both cannot be had, the whole body is lifted.
    """
    every = _solids(character)
    found = np.array(qpos, dtype=np.float64)
    firm = _down(character, qpos, planted)
    keep: list[PointTargets] = []
    for _ in range(_ROUNDS):
        found = _solved(character, found, [*firm, *keep], held)
        sunk = _sunk(character, found, every)
        if sunk is None:
            return found
        keep.append(sunk)
    return _lifted(character, found, every)


def plant(keyposes: KeyPoseSet, character: Character) -> KeyPoseSet:
    """Key poses put down: of every pose what stands stands on the floor, and nothing is in it."""
    return replace(keyposes, poses=tuple(_planted(pose, character) for pose in keyposes.poses))


def _planted(pose: KeyPose, character: Character) -> KeyPose:
    qpos = settled(character, pose.qpos, planted=pose.planted)
    return replace(pose, qpos=without_heading(qpos, front=character.front, up=character.up))


def _targets(pulls: Sequence[Pull]) -> list[PointTargets]:
    return [
        PointTargets(np.array([p.body]), p.local[None], p.target[None, None], p.weight)
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


def _solved(
    character: Character,
    qpos: Array,
    targets: Sequence[PointTargets],
    held: Sequence[int],
    stay: float = STAY_WEIGHT,
    steps: int = _STEPS,
) -> Array:
    if not targets:
        return np.array(qpos, dtype=np.float64)
    locked = np.zeros(character.tree.nv, dtype=bool)
    locked[list(held)] = True
    found: Array = solve(
        character.tree, qpos[None], targets, lower=character.lower, upper=character.upper,
        locked=locked, prior=qpos[None], prior_weight=stay, iterations=steps,
    ).qpos[0]  # fmt: skip
    return found


def _sunk(character: Character, qpos: Array, every: Sequence[Solid]) -> PointTargets | None:
    """The lowest points of what is in the floor, and the floor above them; None if nothing is."""
    pose = forward(character.tree, qpos[None])
    body, local, target = [], [], []
    for solid in every:
        height = solid.heights(pose)[0] - character.floor_height
        lowest = np.argsort(height)[:_LOWEST_OF_A_PART]
        turn, place = pose.rotation[0, solid.body], pose.position[0, solid.body]
        for k in lowest[height[lowest] < -_SINKS].tolist():
            body.append(solid.body)
            local.append(solid.points[k])
            target.append(place + turn @ solid.points[k] - [0.0, 0.0, height[k]])
    if not body:
        return None
    return PointTargets(np.array(body), np.array(local), np.array(target)[None], CONTACT_WEIGHT)


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
