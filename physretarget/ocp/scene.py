"""A clip as the root-height problem sees it: one pass of kinematics and inverse dynamics."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from physretarget import kinematics
from physretarget.errors import InputError
from physretarget.ground.undersides import lowest_heights, solids
from physretarget.mjcf import Character
from physretarget.mjcf.dynamics import derivatives, required_wrench
from physretarget.ocp.basis import differences
from physretarget.ocp.problem import Scene

Array = NDArray[np.float64]

EDGE = 0.08
"""Seconds before take-off and after landing in which a stance may give way."""


def scene_of(
    character: Character,
    qpos: Array,
    time: Array,
    active: NDArray[np.bool_],
    pose_error: Array | None = None,
    pose_variance: Array | None = None,
) -> Scene:
    """What a clip qpos (T, nq) requires of the floor, and where its contact points are.

    ``active`` (T, P): which contact points are meant to touch. ``pose_error`` (T, 3K) m and
    ``pose_variance`` (T,) m² are what the mapper says of the features.
    """
    if not character.has_root:
        raise InputError(f"{character.name} has no free root joint whose height could change")
    points = len(character.contacts)
    if points == 0:
        raise InputError(f"{character.name} declares no contact points (sites 'contact_*')")
    if active.shape != (len(qpos), points):
        raise InputError(
            f"contact phases have shape {active.shape}, not ({len(qpos)}, {points}) as needed"
        )
    wrench = required_wrench(character, qpos, *derivatives(character, qpos, time))
    pose = kinematics.forward(character.tree, qpos)
    contact = kinematics.points(pose, character.contacts.body, character.contacts.local)
    step = float(time[-1] - time[0]) / (len(time) - 1)
    rate, _ = differences(len(qpos), step)
    velocity = (rate @ contact.reshape(len(qpos), -1)).reshape(contact.shape)
    offset, spread, features = _pose_knowledge(pose_error, pose_variance)
    return Scene(
        force=wrench.force,
        moment=wrench.moment,
        arm=wrench.com - wrench.root,
        contact=contact - wrench.root[:, None],
        height=contact[..., 2] - character.floor_height,
        velocity=velocity,
        active=active,
        standing=_standing(active, step),
        clearance=_clearance(character, pose),
        mass=character.mass,
        weight=character.weight,
        size=character.height,
        friction=character.friction,
        pose_offset=offset,
        pose_spread=spread,
        features=features,
    )


def _clearance(character: Character, pose: kinematics.Pose) -> Array:
    """(T,) height of the lowest point of any geom above the floor, m."""
    heights = lowest_heights(solids(character), pose)
    lowest: Array = heights.min(axis=1, initial=np.inf) - character.floor_height
    return lowest


def _standing(active: NDArray[np.bool_], step: float) -> Array:
    """(T,) smoothly from 0 in flight to 1 at :data:`EDGE` seconds from the nearest flight."""
    flight = ~np.any(active, axis=1)
    if not flight.any():
        return np.ones(len(active))
    away = distance_transform_edt(~flight) * step
    share = np.clip(away / EDGE, 0.0, 1.0)
    faded: Array = share**2 * (3.0 - 2.0 * share)
    return faded


def _pose_knowledge(
    error: Array | None, variance: Array | None
) -> tuple[Array | None, Array | None, int]:
    """Raising the root shifts all features' heights alike: their mean error and its spread."""
    if error is None or variance is None or not np.isfinite(variance).all():
        return None, None, 1
    heights = error.reshape(len(error), -1, 3)[..., 2]
    return heights.mean(axis=1), np.sqrt(np.maximum(variance, 1e-12)), heights.shape[1]
