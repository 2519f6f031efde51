"""How far a base that only stands on its floor is from tipping over."""

from __future__ import annotations

import numpy as np

from physretarget import kinematics
from physretarget.ground.edge import support_edge
from physretarget.ground.undersides import solids
from physretarget.mjcf import Character
from physretarget.validation.analysis import Analysis
from physretarget.validation.continuity import Floats
from physretarget.validation.series import Requirement

# Below this share of body weight a centre of pressure means nothing.
_LIFTED_BW = 0.2


def tip_margin(analysis: Analysis, required: Requirement) -> Floats:
    """(T,) m from the centre of pressure that the motion needs to the nearest edge of the base.

    Below 0 it lies outside and the base tips; NaN where hardly any force is needed. The base
    does not move: its edge is that of the first frame.
    """
    character = analysis.character
    height = max(character.com_height, 1e-3)
    force, moment = required.force, required.moment * height
    com = required.com
    above = com[:, 2] - character.floor_height
    with np.errstate(divide="ignore", invalid="ignore"):
        x = com[:, 0] - (moment[:, 1] + above * force[:, 0]) / force[:, 2]
        y = com[:, 1] - (above * force[:, 1] - moment[:, 0]) / force[:, 2]
    way, reach = _edge(character, analysis.poses(0, 1), analysis.tolerance)
    margin = (reach - np.stack([x, y], axis=1) @ way.T).min(axis=1)
    return np.where(force[:, 2] > _LIFTED_BW, margin, np.nan)


def has_base(analysis: Analysis) -> bool:
    """Whether anything of the base is on the floor."""
    _, reach = _edge(analysis.character, analysis.poses(0, 1), analysis.tolerance)
    return bool(np.isfinite(reach).all())


def _edge(character: Character, qpos: Floats, tolerance: float) -> tuple[Floats, Floats]:
    """(n, 2) directions, and how far the base's underside reaches along each, m from the origin."""
    pose = kinematics.forward(character.tree, qpos)
    every = solids(character, _base(character))
    return support_edge(every, pose, character.floor_height, tolerance)


def _base(character: Character) -> list[int]:
    """The root and the bodies that are fixed to it."""
    model, base = character.model, [character.root_body]
    for body in character.bodies:
        if model.body_parentid[body] in base and not model.body_jntnum[body]:
            base.append(int(body))
    return base
