"""What a key pose is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from physretarget.capture.actor import REFERENCE_ACTOR
from physretarget.errors import InputError
from physretarget.features import local_frame

__all__ = ["KeyPose", "KeyPoseSet", "merged", "without_heading"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class KeyPose:
    """One pair of poses.

    Attributes:
        name: unique within a set.
        source: file name of the capture that it was posed from.
        sha256: of that capture.
        time: of the frame in it (s).
        actor_qpos: (75,) pose of the reference actor; x, y and heading are zero.
        qpos: (nq,) pose of the character; x, y and heading are zero.
        planted: the actor's contact points that stand on the floor.
        note: anything that the animator wants remembered.
    """

    name: str
    source: str
    sha256: str
    time: float
    actor_qpos: Array
    qpos: Array
    planted: tuple[str, ...] = ()
    note: str = ""


@dataclass(frozen=True, eq=False, kw_only=True)
class KeyPoseSet:
    """Key poses of one character.

    Attributes:
        character_name, character_sha256: the model that they were posed on.
        reference_actor: version of the reference actor that carries the actor's poses.
        license: of the captures that they were posed from, and so of the poses.
        poses: the pairs, in the order of the file.
        limbs: which limb of the character acts for the actor's in start poses: pairs of the actor's
            limb and the body at which the character's begins, "" for none; what is not there goes
            by the shape.
        remarks: what loading found odd, one sentence each.
    """

    character_name: str
    character_sha256: str
    license: str
    poses: tuple[KeyPose, ...]
    reference_actor: str = REFERENCE_ACTOR
    limbs: tuple[tuple[str, str], ...] = ()
    remarks: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.poses)


def merged(sets: Sequence[KeyPoseSet]) -> KeyPoseSet:
    """One set of several, in order. Licences are joined: all of them bind.

    Args:
        sets: Sets of one character.

    Returns:
        The set of all.

    Raises:
        InputError: no set, sets of different characters or actors, a name that occurs twice.
    """
    if not sets:
        raise InputError("no key poses given")
    first = sets[0]
    seen: set[str] = set()
    for other in sets:
        if other.character_name != first.character_name:
            raise InputError(
                f"key poses of {other.character_name!r} cannot join those of "
                f"{first.character_name!r}"
            )
        if other.reference_actor != first.reference_actor:
            raise InputError(
                f"key poses on reference actor {other.reference_actor} cannot join those on "
                f"reference actor {first.reference_actor}"
            )
        for pose in other.poses:
            if pose.name in seen:
                raise InputError(f"two key poses are named {pose.name!r}")
            seen.add(pose.name)
    licences = dict.fromkeys(each.license for each in sets if each.license)
    return KeyPoseSet(
        character_name=first.character_name,
        character_sha256=first.character_sha256,
        license="; ".join(licences),
        poses=tuple(pose for each in sets for pose in each.poses),
        reference_actor=first.reference_actor,
        limbs=tuple({actor: mine for each in reversed(sets) for actor, mine in each.limbs}.items()),
        remarks=tuple(dict.fromkeys(remark for each in sets for remark in each.remarks)),
    )


def without_heading(
    qpos: Array, *, front: ArrayLike = (1.0, 0.0, 0.0), up: ArrayLike = (0.0, 0.0, 1.0)
) -> Array:
    """The pose (nq,) with x = y = heading = 0; its first seven numbers are a free joint.

    The heading is that of Yamane 2010, section 4.1, so that what remains of the root's
    rotation is the smallest one that takes the vertical to the root's ``up``: roll and pitch.

    Args:
        qpos: (nq,) pose.
        front: Front of the root, in its own frame.
        up: Up direction of the root, in its own frame.

    Returns:
        (nq,) the pose.
    """
    result = np.array(qpos, dtype=np.float64)
    rotation = Rotation.from_quat(result[3:7], scalar_first=True)
    yaw = local_frame(result[None, :3], rotation.as_matrix()[None], front, up).yaw[0]
    result[:2] = 0.0
    result[3:7] = (Rotation.from_rotvec([0.0, 0.0, -yaw]) * rotation).as_quat(
        canonical=True, scalar_first=True
    )
    return result
