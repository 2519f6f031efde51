"""What a pose being dragged is told at once: floor, limits, self-contact, balance."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from physretarget.ground.edge import support_edge
from physretarget.ground.undersides import Solid, bearing_solids
from physretarget.ground.wrench import centre_of_mass
from physretarget.keyposes import KeyPose, KeyPoseSet, check
from physretarget.kinematics import forward
from physretarget.mjcf import Character
from physretarget.validation.selfcollision import SelfCollision

__all__ = ["Live", "live"]

# What is this near to the floor supports, m: the check's tolerance for planted points.
_SUPPORTS = 0.003
# Parts may press into each other this far, m, as soft covers do: what KIN005 warns of.
_PRESSES = 0.005


@dataclass(frozen=True, kw_only=True)
class Live:
    """Remarks on a pose.

    Attributes:
        errors: why it could not be learned from, one sentence each.
        touching: bodies that are in each other.
        margin_m: from the centre of mass, seen from above, to the nearest edge of what stands on
            the floor; below 0 the pose would tip if it were held. None where nothing stands.
    """

    errors: tuple[str, ...]
    touching: tuple[int, ...]
    margin_m: float | None


def live(character: Character, pose: KeyPose) -> Live:
    """Remarks on one key pose as it is being changed."""
    alone = KeyPoseSet(
        character_name=character.name, character_sha256=character.sha256, license="", poses=(pose,)
    )
    errors = [remark.message for remark in check(alone, character) if remark.severity == "error"]
    found = _collision(character).judge(pose.qpos[None])
    touching: tuple[int, ...] = ()
    if found and float(found.depth[0]) > _PRESSES:
        touching = tuple(int(body) for body in found.pair[0])
    at = forward(character.tree, pose.qpos[None])
    com = centre_of_mass(character, at)[0]
    way, reach = support_edge(_bearing(character), at, character.floor_height, _SUPPORTS)
    margin = float((reach - way @ com[:2]).min())
    return Live(
        errors=tuple(errors), touching=touching, margin_m=margin if np.isfinite(margin) else None
    )


@lru_cache(maxsize=4)
def _collision(character: Character) -> SelfCollision:
    return SelfCollision.build(character)


@lru_cache(maxsize=4)
def _bearing(character: Character) -> tuple[Solid, ...]:
    return bearing_solids(character)
