"""A pose to start from: what an animator does first, whatever the character.

Yamane 2010, section 6.2, saw its animator always begin a key pose with the same two operations:
match the orientation of the root to the actor's, and the direction of the face. Here they are
done automatically, with the contacts.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from physretarget.capture.actor import CONTACT_POINTS, SEGMENT
from physretarget.errors import InputError
from physretarget.keyposes.face import face_of
from physretarget.keyposes.layout import layout_of
from physretarget.keyposes.limbs import Choice, limb_targets
from physretarget.keyposes.pairs import actor_character_of_reference
from physretarget.keyposes.pose import without_heading
from physretarget.keyposes.settle import settled
from physretarget.kinematics import PointTargets, forward, points, solve
from physretarget.mjcf import Character

__all__ = ["gaze_of_actor", "gazes", "planted_points", "propose"]

Array = NDArray[np.float64]

PLANTED_HEIGHT = 0.035  # m: contact points of the actor below this count as planted
SIGHT = 0.5  # m ahead of the face, where the point to look at is put
CONTACT_WEIGHT, FACE_WEIGHT, LIMB_WEIGHT, STAY_WEIGHT = 100.0, 1.0, 0.3, 2e-3


def propose(
    character: Character,
    actor_qpos: Array,
    *,
    planted: tuple[str, ...] | None = None,
    limbs: Choice = (),
) -> Array:
    """A start pose (nq,) of the character for a pose (75,) of the reference actor.

    From the reference pose: the root tilted as the actor's pelvis, the face turned to where
    the actor's head faces, limbs that act for the actor's (see
    :mod:`physretarget.keyposes.limbs`) turned as these, what is tied to the actor's planted points
    brought to the floor, and in the air lifted by as much as the actor's lowest contact point, in
    metres. Where not all can be had, contacts win over the face, the face over limbs, limbs over
    the root. At last nothing is in the floor.

    Args:
        character: whose pose it is.
        actor_qpos: (75,) of the reference actor; its heading does not matter.
        planted: the actor's contact points that stand; None for those within 3.5 cm of the floor.
        limbs: which limb acts for the actor's, as :attr:`KeyPoseSet.limbs` has it.

    Returns:
        (nq,) the start pose.

    Raises:
        InputError: the character has no free root.
    """
    if not character.has_root:
        raise InputError(f"{character.name!r} has no free joint, so it cannot be posed in space")
    actor_qpos = without_heading(actor_qpos)
    heights = _actor_heights(actor_qpos)
    if planted is None:
        planted = planted_points(actor_qpos)
    start = _tilted(character, actor_qpos)
    tied = [i for i, point in enumerate(character.tied) if point is not None]
    if tied:
        start = _lifted(character, start, tied, 0.0 if planted else min(heights.values()))
    posed = _solved(character, start, actor_qpos, planted, limbs)
    if tied and not planted:
        posed = _lifted(character, posed, tied, min(heights.values()))
    down = settled(character, posed, planted=planted)
    return without_heading(down, front=character.front, up=character.up)


def gaze_of_actor(actor_qpos: Array) -> Array:
    """Unit vector (3,) out of the actor's face, in the heading frame.

    Args:
        actor_qpos: (75,) pose of the reference actor.

    Returns:
        (3,) unit vector.
    """
    actor = actor_character_of_reference()
    pose = forward(actor.tree, without_heading(actor_qpos)[None])
    return np.array(pose.rotation[0, SEGMENT["head"] + 1, :, 0])


def planted_points(actor_qpos: Array) -> tuple[str, ...]:
    """The actor's contact points within 3.5 cm of the floor."""
    heights = _actor_heights(actor_qpos)
    return tuple(name for name in CONTACT_POINTS if heights[name] < PLANTED_HEIGHT)


def gazes(character: Character, qpos: Array) -> Array:
    """Unit vectors (T, 3) out of the character's face; its front where it has none."""
    pose = forward(character.tree, qpos)
    face = face_of(character)
    body, ahead = (character.root_body, character.front) if face is None else (face[0], face[2])
    return np.asarray(pose.rotation[:, body] @ ahead)


def _actor_heights(actor_qpos: Array) -> dict[str, float]:
    actor = actor_character_of_reference()
    pose = forward(actor.tree, actor_qpos[None])
    height = points(pose, actor.contacts.body, actor.contacts.local)[0, :, 2]
    return dict(zip(CONTACT_POINTS, height.tolist(), strict=True))


def _tilted(character: Character, actor_qpos: Array) -> Array:
    """The reference pose with the actor's roll and pitch."""
    qpos = without_heading(character.reference_qpos, front=character.front, up=character.up)
    tilt = Rotation.from_quat(actor_qpos[3:7], scalar_first=True)
    at = character.root_qpos + 3
    turn = tilt * layout_of(character).aligned
    qpos[at : at + 4] = turn.as_quat(canonical=True, scalar_first=True)
    return qpos


def _lifted(character: Character, qpos: Array, tied: list[int], height: float) -> Array:
    """The pose with the lowest of its tied contact points at `height` above the floor."""
    contacts = character.contacts
    pose = forward(character.tree, qpos[None])
    lowest = points(pose, contacts.body[tied], contacts.local[tied])[0, :, 2].min()
    qpos = qpos.copy()
    qpos[character.root_qpos + 2] += character.floor_height + height - lowest
    return qpos


def _solved(
    character: Character,
    start: Array,
    actor_qpos: Array,
    planted: tuple[str, ...],
    limbs: Choice,
) -> Array:
    face, gaze = face_of(character), gaze_of_actor(actor_qpos)
    contacts = character.contacts
    down = [i for i, point in enumerate(character.tied) if point in planted]
    locked = np.zeros(character.model.nv, dtype=bool)
    if not down:  # in the air nothing holds the root: it keeps the actor's tilt and height
        locked[character.root_dof : character.root_dof + 6] = True
    qpos = start
    for _ in range(4):  # looking at a point moves the eyes, and so the point to look at
        pose = forward(character.tree, qpos[None])
        targets = []
        if down:
            floor = points(pose, contacts.body[down], contacts.local[down])
            floor[..., 2] = character.floor_height
            targets.append(
                PointTargets(contacts.body[down], contacts.local[down], floor, CONTACT_WEIGHT)
            )
        if face is not None:
            body, place, ahead = face
            origin = points(pose, np.array([body]), place[None])
            targets.append(
                PointTargets(
                    np.array([body]),
                    (place + SIGHT * ahead)[None],
                    origin + SIGHT * gaze,
                    FACE_WEIGHT,
                )
            )
        stands = {int(contacts.body[i]) for i in down}
        for limb, place in limb_targets(character, actor_qpos, pose, limbs):
            if limb.last not in stands:
                targets.append(
                    PointTargets(
                        np.array([limb.last]), limb.tip[None], place[None, None], LIMB_WEIGHT
                    )
                )
        if not targets:
            return qpos
        qpos = solve(
            character.tree,
            qpos[None],
            targets,
            lower=character.lower,
            upper=character.upper,
            locked=locked,
            prior=start[None],
            prior_weight=STAY_WEIGHT,
        ).qpos[0]
    return qpos
