"""Which bodies of a character stand, and how far they may turn while they do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.contact.carry import swivels
from physretarget.contact.settings import ContactSettings
from physretarget.contact.sole import Sole, make_sole, with_underside
from physretarget.ground.undersides import solids
from physretarget.mjcf import Character

UNDER = 0.005
"""Of a standing foot's underside, this near to the floor (of the height) must not sink."""


def standing_bodies(character: Character) -> NDArray[np.int64]:
    """The bodies that carry contact points that follow the actor's, in order."""
    return np.unique(character.contacts.body[_tied(character)])


def sole_of(character: Character, body: int) -> Sole:
    """The contact points of one body that follow the actor's."""
    index = np.flatnonzero((character.contacts.body == body) & _tied(character))
    standing = kinematics.forward(character.tree, character.reference_qpos[None])
    sole = make_sole(
        body,
        index,
        character.contacts.local[index],
        tuple(_side(str(character.tied[i])) for i in index),
        standing.rotation[0, body],
        friction=character.friction,
    )
    return with_underside(sole, solids(character, [body]), UNDER * character.height)


def turning_limit(character: Character, body: int, settings: ContactSettings) -> float:
    """How far the motion's heading may be from that of a stance of this body, rad."""
    swivelling = body == character.root_body and bool(swivels(character))
    return settings.swivel if swivelling else settings.pivot


def _tied(character: Character) -> NDArray[np.bool_]:
    return np.array([point is not None for point in character.tied], dtype=bool)


def _side(name: str) -> str:
    return name.split("_")[0] if name.startswith(("left_", "right_")) else name
