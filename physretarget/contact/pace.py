"""What a hopping base carries keeps its pace.

A base that hops from place to place stands still, leaps and stands still again. Were all that it
carries to stop and start with it, as one block, the floor would have to push at the height of the
centre of mass, and the block would tip over its edge at every landing. An animator lets the body
lag when the base leaps, and swing on over it when it stops: drag and follow-through.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from physretarget import kinematics
from physretarget.contact.foot import Foot
from physretarget.contact.settings import ContactSettings
from physretarget.kinematics import PointTargets
from physretarget.mjcf import Character

Floats = NDArray[np.float64]

TOP = 0.8
"""What is this far above the base, in heights, takes the whole lead; what is below, less."""
STILL = 1e-5
"""Leads below this, in heights, are none."""
FEW = 8
"""Steps of inverse kinematics: leads change little from frame to frame."""


def kept_pace(
    character: Character, qpos: Floats, time: Floats, foot: Foot, settings: ContactSettings
) -> Floats:
    """Poses (T, nq) on the track of their base ``foot``, in which what it carries moves on.

    Before the adjustment the base moved as smoothly as the actor's trunk. Its correction goes back
    and forth with the hops; what it carries gets a correction without them.
    """
    if settings.pace <= 0.0 or settings.lean <= 0.0 or len(qpos) < 2:
        return qpos
    step = float(np.median(np.diff(time)))
    shift = (foot.track.centre - foot.motion.centre)[:, :2]
    smooth = gaussian_filter1d(shift, settings.pace / step, axis=0, mode="nearest")
    lead = bounded(smooth - shift, settings.lean * character.height)
    return leaned(character, qpos, lead, foot.track.centre[:, 2], settings)


def bounded(lead: Floats, most: float) -> Floats:
    """Leads (..., 2), m, the long ones shortened smoothly to less than ``most``."""
    size = np.linalg.norm(lead, axis=-1, keepdims=True)
    result: Floats = lead * (most * np.tanh(size / most) / np.maximum(size, 1e-12))
    return result


def share_of_lead(above: Floats, height: float) -> Floats:
    """How much of the lead points take that are ``above`` the base, m."""
    share: Floats = np.clip(above / (TOP * height), 0.0, 1.0)
    return share


def leaned(
    character: Character, qpos: Floats, lead: Floats, level: Floats, settings: ContactSettings
) -> Floats:
    """Poses (T, nq) that lean by ``lead`` (T, 2), m, the root where it is.

    Markers of what the root carries are shifted in proportion to their height over ``level`` (T,);
    inverse kinematics finds the joints.
    """
    frames = np.flatnonzero(np.linalg.norm(lead, axis=1) > STILL * character.height)
    index = character.markers.body != character.root_body
    if not len(frames) or not index.any():
        return qpos
    body, local = character.markers.body[index], character.markers.local[index]
    target = kinematics.points(kinematics.forward(character.tree, qpos[frames]), body, local)
    above = target[..., 2] - level[frames, None]
    target[..., :2] += share_of_lead(above, character.height)[..., None] * lead[frames, None]
    locked = np.zeros(character.tree.nv, dtype=bool)
    locked[character.root_dof : character.root_dof + 6] = True
    moved = qpos.copy()
    moved[frames] = kinematics.solve(
        character.tree,
        qpos[frames],
        [PointTargets(body, local, target)],
        lower=character.lower,
        upper=character.upper,
        locked=locked,
        prior_weight=settings.joint_weight * character.height**2,
        iterations=FEW,
        tolerance=1e-3,
    ).qpos
    return moved
