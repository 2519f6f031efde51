"""The belt of a treadmill, found from the feet that stand on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.capture.actor import ActorMotion

Floats = NDArray[np.float64]

_LOW = 0.02  # m above where a foot point rests: in stance
_SLOWEST = 0.4  # m/s of a belt: slower ones are a body that shuffles
_STAYS = 0.3  # of the belt's speed: whoever travels faster than that is on no treadmill


def belt_velocity(motion: ActorMotion) -> Floats:
    """(2,) m/s of the belt under the feet; zero for who moves over a floor.

    Feet that are low move with the ground. On a floor that is at rest, on a treadmill it runs
    backward while the pelvis stays.
    """
    nothing = np.zeros(2)
    if len(motion.time) < 4:
        return nothing
    segment, local = motion.shape.contact_points()
    feet = kinematics.trajectories(motion.shape.tree(), motion.qpos, segment[:4] + 1, local[:4])
    speed = np.gradient(feet, motion.time, axis=0)[..., :2]
    rest = np.quantile(feet[..., 2], 0.05, axis=0)
    low = (feet[..., 2] < rest + _LOW) & motion.valid[:, None]
    if not low.any():
        return nothing
    belt: Floats = np.median(speed[low], axis=0)
    size = float(np.linalg.norm(belt))
    travel = motion.qpos[-1, :2] - motion.qpos[0, :2]
    pelvis = float(np.linalg.norm(travel)) / float(motion.time[-1] - motion.time[0])
    return belt if size > _SLOWEST and pelvis < _STAYS * size else nothing


def over_ground(motion: ActorMotion, belt: Floats) -> ActorMotion:
    """The motion as the belt sees it: all forces are the same, and feet in stance stand still."""
    if not belt.any():
        return motion
    qpos = motion.qpos.copy()
    qpos[:, :2] -= belt * motion.time[:, None]
    return replace(motion, qpos=qpos)
