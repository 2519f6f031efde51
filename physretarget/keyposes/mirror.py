"""A pair of poses seen in a mirror: what the left did, the right does.

The mirror is the vertical plane through the front. A rotation about an axis a is seen in it as one
about the mirrored axis, the other way round: S R(a, t) S = R(-S a, t) with S = diag(1, -1, 1). So a
hinge's angle goes to the hinge that lies where the mirror shows it, with the sign of its axis.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from physretarget.capture.actor import SEGMENTS
from physretarget.errors import InputError
from physretarget.keyposes.layout import layout_of
from physretarget.keyposes.pose import KeyPose, without_heading
from physretarget.keyposes.settle import settled
from physretarget.kinematics import Joint, forward
from physretarget.mjcf import Character

__all__ = ["mirrored", "mirrored_actor", "mirrored_pose", "swapped"]

Array = NDArray[np.float64]
_MIRROR = np.array([1.0, -1.0, 1.0])
# Of a quaternion (w, x, y, z): S R S.
_MIRRORED_QUAT = np.array([1.0, -1.0, 1.0, -1.0])
# A joint's counterpart lies this near to where the mirror shows it, as a share of the height, and
# its axis within 15 degrees: models are built by hand.
_NEAR, _ALONG = 0.05, 0.966


def mirrored(pose: KeyPose, character: Character, *, name: str) -> KeyPose:
    """The pair in a mirror, under another name, put down on the floor again.

    Raises:
        InputError: a joint of the character has no counterpart.
    """
    planted = tuple(sorted(swapped(point) for point in pose.planted))
    qpos = settled(character, mirrored_pose(character, pose.qpos), planted=planted)
    return replace(
        pose,
        name=name,
        note=f"Mirrored from {pose.name}.",
        planted=planted,
        actor_qpos=mirrored_actor(pose.actor_qpos),
        qpos=without_heading(qpos, front=character.front, up=character.up),
    )


def swapped(name: str) -> str:
    """An actor's name on the other side: left_toe for right_toe."""
    if "left" in name:
        return name.replace("left", "right")
    return name.replace("right", "left")


def mirrored_actor(qpos: Array) -> Array:
    """The reference actor's pose (75,) in the mirror; its segments' frames are parallel at rest."""
    found = np.empty_like(qpos)
    found[:3] = qpos[:3] * _MIRROR
    for number, segment in enumerate(SEGMENTS):
        source = 3 + 4 * SEGMENTS.index(swapped(segment))
        found[3 + 4 * number : 7 + 4 * number] = qpos[source : source + 4] * _MIRRORED_QUAT
    return found


def mirrored_pose(character: Character, qpos: Array) -> Array:
    """The character's pose (nq,) in the mirror.

    Raises:
        InputError: a joint has no counterpart.
    """
    found = np.array(qpos, dtype=np.float64)
    aligned = layout_of(character).aligned
    for pair in _pairs(character):
        at, source = pair.at.qpos, pair.source.qpos
        if pair.at.kind == "free":
            found[at : at + 3] = qpos[at : at + 3] * _MIRROR
            turn = Rotation.from_quat(qpos[at + 3 : at + 7], scalar_first=True) * aligned.inv()
            found[at + 3 : at + 7] = (_reflected(turn) * aligned).as_quat(
                canonical=True, scalar_first=True
            )
        elif pair.at.kind == "ball":
            turn = Rotation.from_quat(qpos[source : source + 4], scalar_first=True)
            there = pair.source_frame * turn * pair.source_frame.inv()
            here = pair.at_frame.inv() * _reflected(there) * pair.at_frame
            found[at : at + 4] = here.as_quat(canonical=True, scalar_first=True)
        else:
            found[at] = pair.sign * qpos[source]
    return np.clip(found, character.lower, character.upper)


def _reflected(turn: Rotation) -> Rotation:
    return Rotation.from_quat(turn.as_quat(scalar_first=True) * _MIRRORED_QUAT, scalar_first=True)


@dataclass(frozen=True, eq=False)
class _Pair:
    """A joint, the one whose value it takes in the mirror, with which sign; frames of balls are
    those of their bodies in the world, all angles zero."""

    at: Joint
    source: Joint
    sign: float
    at_frame: Rotation
    source_frame: Rotation


@lru_cache(maxsize=8)
def _pairs(character: Character) -> tuple[_Pair, ...]:
    tree, layout = character.tree, layout_of(character)
    zero = np.zeros(tree.nq)
    for joint in tree.joints:
        if joint.kind == "free":
            zero[joint.qpos + 3 : joint.qpos + 7] = layout.aligned.as_quat(scalar_first=True)
        elif joint.kind == "ball":
            zero[joint.qpos] = 1.0
    pose = forward(tree, zero[None])
    place, axis = [], []
    for joint in tree.joints:
        turn = pose.rotation[0, joint.body]
        place.append(pose.position[0, joint.body] + turn @ joint.anchor)
        axis.append(turn @ joint.axis)
    # The mirror goes through the root.
    root = next((k for k, joint in enumerate(tree.joints) if joint.kind == "free"), None)
    middle = np.zeros(3) if root is None else place[root]
    pairs = []
    for number, joint in enumerate(tree.joints):
        seen = middle + (place[number] - middle) * _MIRROR
        best, sign = _counterpart(character, number, seen, np.array(place), np.array(axis))
        source = tree.joints[best]
        frames = [Rotation.from_matrix(pose.rotation[0, j.body]) for j in (joint, source)]
        pairs.append(_Pair(joint, source, sign, *frames))
    return tuple(pairs)


def _counterpart(
    character: Character, number: int, seen: Array, place: Array, axis: Array
) -> tuple[int, float]:
    """Number of the joint that lies where the mirror shows this one, and the sign of its axis."""
    joints = character.tree.joints
    kind = joints[number].kind
    if kind == "free":
        return number, 1.0
    # A slide's direction is mirrored, a hinge's axis the other way round.
    shown = axis[number] * (_MIRROR if kind == "slide" else -_MIRROR)
    along = axis @ shown if kind != "ball" else np.ones(len(joints))
    away = np.linalg.norm(place - seen, axis=1)
    fits = (np.abs(along) > _ALONG) & np.array([j.kind == kind for j in joints])
    away = np.where(fits, away, np.inf)
    best = int(np.argmin(away))
    if away[best] > _NEAR * character.height:
        raise InputError(
            f"joint {character.joint_names[number]!r} of {character.name!r} has no counterpart on "
            "the other side, so that its poses cannot be mirrored"
        )
    return best, float(np.sign(along[best]))
