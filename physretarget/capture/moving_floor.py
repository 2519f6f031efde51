"""Floors that move in the file: treadmills, and captures that drift away.

Planted feet move as the floor does. The lowest of heels and toes is planted more often than not, so
that the floor's velocity is where its velocities crowd.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import overload

import numpy as np

from physretarget.capture.actor import CONTACT_POINTS, ActorMotion
from physretarget.capture.recording import Floats, JointRecording, MarkerRecording
from physretarget.kinematics import forward, points

__all__ = ["MovingFloor", "find_moving_floor", "held_still"]

_FEET = tuple(f"{side}_{part}" for side in ("left", "right") for part in ("heel", "toe"))
_CROWD = 0.15  # m/s, within which planted feet are slow, as in the other thresholds of stance
_LOWEST = 0.01  # m above the lowest foot point of a frame
_UNEVEN = 0.5  # of a belt's speed, by which it seems to vary where hips are pinned to one place
_BELT = 0.25  # m/s: slower than any walk on a belt, faster than feet that are planted slip
_STAYS = 0.3  # of the belt's way: the actor on it travels less
_RISE = 0.08  # m of drift over the whole take that matter
_SURE = 4.0  # standard errors from none
_SAMPLES = 4000  # frames: what a crowd needs, whatever the take's length
_ROUNDS = 20


@dataclass(frozen=True)
class MovingFloor:
    """``velocity`` (3,) m/s of the floor; what lies below the thresholds is zero.

    ``rise`` m by which it rises (falls, if negative) over the take.
    """

    velocity: Floats
    rise: float

    @property
    def sentence(self) -> str:
        """What was found, for a reader of the notes."""
        said = []
        speed = float(np.hypot(*self.velocity[:2]))
        if speed > 0:
            said.append(f"planted feet slide at {speed:.2f} m/s, as on a treadmill")
        if self.rise:
            way = "rise" if self.rise > 0 else "sink"
            said.append(f"planted feet {way} by {100 * abs(self.rise):.0f} cm over the take")
        return ", and ".join(said)


def find_moving_floor(motion: ActorMotion) -> MovingFloor | None:
    """The floor's motion under a take, None where it keeps still as far as can be seen."""
    if len(motion.qpos) < 10 or not motion.valid.any():
        return None
    velocity = _velocities(motion)
    if len(velocity) < 20:
        return None
    found, error = _crowd(velocity)
    duration = len(motion.qpos) / motion.fps
    rise = float(found[2]) * duration
    third = max(1, len(motion.qpos) // 3)
    # The body rises with the floor: by two thirds from the first third's middle to the last's.
    body = 1.5 * float(np.median(motion.qpos[-third:, 2]) - np.median(motion.qpos[:third, 2]))
    agrees = 0.5 < body / rise < 2.0 if rise else False
    if abs(rise) < _RISE or abs(found[2]) < _SURE * error[2] or not agrees:
        found[2], rise = 0.0, 0.0
    travel = np.ptp(motion.qpos[motion.valid, :2], axis=0)
    belt = float(np.hypot(*found[:2]))
    if belt < _BELT or float(np.hypot(*travel)) > _STAYS * belt * duration:
        found[:2] = 0.0
    return MovingFloor(found, rise) if found.any() else None


def _velocities(motion: ActorMotion) -> Floats:
    """(N, 3) m/s of the lowest heels and toes in a sample of frames."""
    segment, local = motion.shape.contact_points()
    feet = [CONTACT_POINTS.index(name) for name in _FEET]
    step = max(1, -(-len(motion.qpos) // _SAMPLES))
    middle = np.arange(1, len(motion.qpos) - 1, step)
    middle = middle[motion.valid[middle - 1] & motion.valid[middle + 1]]
    tree = motion.shape.tree()
    ends = [
        points(forward(tree, motion.qpos[frames]), segment[feet] + 1, local[feet])
        for frames in (middle - 1, middle + 1)
    ]
    low = 0.5 * (ends[0][..., 2] + ends[1][..., 2])
    velocity = (ends[1] - ends[0]) * (motion.fps / 2)
    planted: Floats = velocity[low < low.min(axis=1, keepdims=True) + _LOWEST]
    return planted


def _crowd(velocity: Floats) -> tuple[Floats, Floats]:
    """Where velocities (N, 3) crowd most (3,), and its standard error (3,).

    Mean shift (Fukunaga and Hostetler 1975) from stillness, from the median and from a sample of
    the velocities; of the places that are reached the one with most around it.
    """
    starts = [np.zeros(3), np.median(velocity, axis=0), *velocity[:: max(1, len(velocity) // 40)]]
    best, most = np.zeros(3), 0.0
    for start in starts:
        at = start
        for _ in range(_ROUNDS):
            weight = np.exp(-0.5 * np.sum((velocity - at) ** 2, axis=1) / _CROWD**2)
            after = weight @ velocity / max(float(weight.sum()), 1e-12)
            if np.abs(after - at).max() < 1e-4:
                break
            at = after
        around = float(np.exp(-0.5 * np.sum((velocity - at) ** 2, axis=1) / _CROWD**2).sum())
        if around > most * 1.05:  # stillness comes first and yields to what is plainly more
            best, most = at, around
    reach = max(1.5 * _CROWD, _UNEVEN * float(np.hypot(*best[:2])))
    near = velocity[np.linalg.norm(velocity - best, axis=1) < reach]
    centre = near.mean(axis=0) if len(near) else best
    # Frames one after the other tell the same: a tenth of the samples count as independent.
    error = near.std(axis=0) / np.sqrt(max(1.0, 0.1 * len(near))) if len(near) else np.full(3, 9.0)
    return centre, error


@overload
def held_still(recording: JointRecording, velocity: Floats) -> JointRecording: ...
@overload
def held_still(recording: MarkerRecording, velocity: Floats) -> MarkerRecording: ...
def held_still(
    recording: JointRecording | MarkerRecording, velocity: Floats
) -> JointRecording | MarkerRecording:
    """The recording as seen from a floor that moves with ``velocity`` (3,) m/s."""
    way = recording.time[:, None, None] * velocity
    return replace(recording, position=recording.position - way)
