"""Key poses as the two matrices that a mapper learns from."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from physretarget.capture.actor import ActorShape
from physretarget.errors import InputError
from physretarget.features import features
from physretarget.keyposes.pose import KeyPoseSet
from physretarget.mjcf import Character, actor_character

__all__ = ["actor_character_of_reference", "training_pairs"]

Array = NDArray[np.float64]


@lru_cache(maxsize=1)
def actor_character_of_reference() -> Character:
    """The reference actor as a character."""
    return actor_character(ActorShape.reference())


def training_pairs(keyposes: KeyPoseSet, character: Character) -> tuple[Array, Array]:
    """Features of the actor (N, DY) and of the character (N, DZ), metres, a row per key pose.

    Yamane 2010, section 4.1: local coordinates of markers on every link.

    Args:
        keyposes: The key poses.
        character: The character that was posed.

    Returns:
        Actor features (N, DY) and character features (N, DZ), m.

    Raises:
        InputError: there are no key poses.
    """
    if not keyposes.poses:
        raise InputError(f"there are no key poses of {keyposes.character_name!r} to learn from")
    actor = actor_character_of_reference()
    # Pose by pose: they are no motion, and headings must not be carried from one to the next.
    y = [features(actor, pose.actor_qpos[None])[0] for pose in keyposes.poses]
    z = [features(character, pose.qpos[None])[0] for pose in keyposes.poses]
    return np.array(y), np.array(z)
