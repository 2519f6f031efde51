"""When the feet of a file's skeleton stand, and how they are turned: level while they do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physretarget.capture.directions import frame, in_frames, mean_direction, mean_rotation
from physretarget.capture.measure import Measured, unit
from physretarget.capture.recording import Floats

__all__ = ["foot_axes", "stands"]

_STILL = 0.15  # m/s: a foot slower than this stands
_LOW = 0.04  # m: and is this near to its lowest
_TOE_BELOW = float(np.radians(30.0))  # the ball of the toes below the ankle, if no stance shows it


def stands(measured: Measured, side: str) -> NDArray[np.bool_]:
    """Frames (T,) in which a foot is slow and near its lowest."""
    ankle = measured.centre[f"{side}_foot"]
    points = [ankle, measured.end.get(f"{side}_foot", ankle)]
    good = np.ones(len(ankle), dtype=np.bool_)
    if len(ankle) < 3:
        return good
    for point in points:
        speed = np.linalg.norm(np.gradient(point, 1 / measured.fps, axis=0), axis=1)
        good &= speed < _STILL
    low = points[1][:, 2]
    if good.any():
        good &= low < np.quantile(low[good], 0.1) + _LOW
    return good


def foot_axes(
    measured: Measured,
    shank: Floats,
    side: str,
    rest: Floats | None,
    stance: NDArray[np.bool_],
) -> Floats:
    """The foot's axes (3, 3) in its joint's frame: level while it stands, toes forward.

    ``shank`` (T, 3, 3) in the world, ``rest`` the axes of a standing rest pose if it is one,
    ``stance`` (T,) the frames in which the foot stands.
    """
    foot = f"{side}_foot"
    joint = measured.turn[foot]
    if foot not in measured.end:
        if rest is not None:
            return rest
        return mean_rotation(np.swapaxes(joint, 1, 2) @ shank)
    toe = mean_direction(in_frames(joint, unit(measured.end[foot] - measured.centre[foot])))
    up = _level(joint, stance, measured.fps)
    if up is None or abs(up @ toe) > 0.85:
        if rest is not None:
            up = rest[:, 2]
        else:
            side_axis = mean_direction(in_frames(joint, shank[:, :, 1]))
            across = unit(side_axis - (side_axis @ toe) * toe)
            up = np.cross(toe, across)
            below = _below_ankle(measured, foot, stance)
            up = unit(up * np.cos(below) - toe * np.sin(below))
    return frame(np.cross(up, toe), up)


def _below_ankle(measured: Measured, foot: str, stance: NDArray[np.bool_]) -> float:
    """How far (rad) the ball of the toes lies below the ankle, as seen from it, on level ground."""
    if np.count_nonzero(stance) < max(3, 0.15 * measured.fps):
        return _TOE_BELOW
    way = unit(measured.end[foot][stance] - measured.centre[foot][stance])
    angle = float(np.arcsin(np.clip(np.median(-way[:, 2]), -1.0, 1.0)))
    return float(np.clip(angle, np.radians(5.0), np.radians(50.0)))


def _level(joint: Floats, stance: NDArray[np.bool_], fps: float) -> Floats | None:
    """The vertical in the foot's frame while it stands, if that is long enough and steady."""
    if np.count_nonzero(stance) < max(3, 0.15 * fps):
        return None
    local = joint[stance][:, 2, :]  # R^T z
    mean = mean_direction(local)
    spread = np.median(np.arccos(np.clip(local @ mean, -1, 1)))
    return mean if spread < np.radians(10) else None
