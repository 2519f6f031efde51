"""Floors that are not level in the file: a plane through the places where feet rest.

A capture volume whose calibration is off by some degrees carries its actor up an invisible hill.
The plane through all stances shows it. A real slope has the same plane; but on a slope a body
stays upright along gravity, and in a tilted volume it leans with the floor.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import overload

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from physretarget.capture.actor import CONTACT_POINTS, SEGMENT, ActorMotion
from physretarget.capture.recording import Floats, JointRecording, MarkerRecording
from physretarget.kinematics import forward, points

__all__ = ["Plane", "floor_plane", "turned"]

_FEET = tuple(f"{side}_{part}" for side in ("left", "right") for part in ("heel", "toe"))
_STILL = 0.15  # m/s: a foot point slower than this rests
_STANCE_S = 0.08  # s: for at least so long
_HEIGHT_SD = 0.01  # m, by which rests of one foot point scatter about a plane floor
_SOLE_SD = 0.02  # m, by which the four points' distances from the sole are off
_TILT_SD = 0.05  # rad, how far capture volumes are tilted (3 degrees)
_LEAN_SD = 0.06  # rad, how far a body leans sideways on average (3.4 degrees, a sad walk's)
_OUTLIER = 0.03  # m off the plane: no rest on it
_ROUNDS = 30
_LEAST = np.radians(1.5)  # volumes that are level measure up to 0.6 degrees
_MOST = np.radians(12.0)  # steeper are stairs and boxes
_WIDEST_GAP = 0.5  # of the heights' range: a floor and a box on it are two heights, no plane
_SURE = 4.0  # standard deviations of the slope from none
_ON_PLANE = 0.8  # of the rests: stairs and boxes have fewer


@dataclass(frozen=True)
class Plane:
    """A floor that is not level: its unit normal (3,), and the tilt in rad.

    ``leans`` tells whether the body leans with it, as in a tilted volume, or stands upright on it,
    as on a slope.
    """

    normal: Floats
    tilt: float
    leans: bool


def floor_plane(motion: ActorMotion) -> Plane | None:
    """The plane on which a motion's feet rest, None where it is level or there is none.

    Most likely slopes and offsets of the four foot points, given normal errors with the scatter
    above; rests off the plane lose their say (Geman and McClure). How the body leans sideways
    tells the slope across a straight walk, which its narrow track hides.
    """
    rest, which = _rests(motion)
    if len(rest) < 4:
        return None
    off = rest - np.median(rest, axis=0)
    left, lean, axis = _lean(motion)
    rows = np.zeros((len(off), 7))
    rows[:, :2], rows[:, 2] = off[:, :2], 1.0
    rows[np.arange(len(off)), 3 + which] = 1.0
    prior = np.diag([_TILT_SD**-2, _TILT_SD**-2, 0.0, *[_SOLE_SD**-2] * 4])
    across = np.r_[left, np.zeros(5)]
    prior += np.outer(across, across) / _LEAN_SD**2
    pull = across * lean / _LEAN_SD**2
    weight = np.ones(len(off))
    for _ in range(_ROUNDS):
        weighed = rows * weight[:, None] / _HEIGHT_SD**2
        precision = weighed.T @ rows + prior
        solved = np.linalg.solve(precision, weighed.T @ off[:, 2] + pull)
        left_over = off[:, 2] - rows @ solved
        weight = 1 / (1 + (left_over / _OUTLIER) ** 2) ** 2
    normal = np.array([-solved[0], -solved[1], 1.0])
    normal /= np.linalg.norm(normal)
    tilt = float(np.arccos(normal[2]))
    slope, scatter = solved[:2], np.linalg.inv(precision)[:2, :2]
    sure = float(np.sqrt(slope @ np.linalg.solve(scatter, slope))) > _SURE
    heights = np.sort(off[:, :2] @ slope)
    gap = float(np.diff(heights).max() / max(np.ptp(heights), 1e-9))
    plane = np.mean(np.abs(left_over) < _OUTLIER) >= _ON_PLANE and gap < _WIDEST_GAP
    if not (sure and plane and _LEAST < tilt < _MOST):
        return None
    return Plane(normal, tilt, bool(axis @ normal > axis[2]))


def _rests(motion: ActorMotion) -> tuple[Floats, NDArray[np.int64]]:
    """Places (N, 3) at which a foot point rests, one for each rest, and which point (N,) it is."""
    segment, local = motion.shape.contact_points()
    feet = [CONTACT_POINTS.index(name) for name in _FEET]
    if len(motion.qpos) < 3:
        return np.empty((0, 3)), np.empty(0, dtype=np.int64)
    at = points(forward(motion.shape.tree(), motion.qpos), segment[feet] + 1, local[feet])
    speed = np.linalg.norm(np.gradient(at, axis=0), axis=-1) * motion.fps
    places, which = [], []
    for k in range(len(feet)):
        still = np.r_[False, (speed[:, k] < _STILL) & motion.valid, False]
        edges = np.flatnonzero(np.diff(still.astype(np.int8)))
        for first, stop in zip(edges[::2], edges[1::2], strict=True):
            if (stop - first) / motion.fps >= _STANCE_S:
                places.append(np.median(at[first:stop, k], axis=0))
                which.append(k)
    return np.array(places).reshape(-1, 3), np.array(which, dtype=np.int64)


def _lean(motion: ActorMotion) -> tuple[Floats, float, Floats]:
    """The body's mean left (2,) along the floor, the slope along it that its lean tells, and its
    trunk's mean axis (3,)."""
    pose = forward(motion.shape.tree(), motion.qpos[motion.valid])
    trunk = [1 + SEGMENT[name] for name in ("pelvis", "abdomen", "chest")]
    axis = pose.rotation[:, trunk, :, 2].mean(axis=(0, 1))
    hips = (
        pose.position[:, 1 + SEGMENT["left_thigh"]] - pose.position[:, 1 + SEGMENT["right_thigh"]]
    )
    left = np.mean(hips[:, :2], axis=0)
    size = float(np.linalg.norm(left))
    usual = float(np.median(np.linalg.norm(hips[:, :2], axis=1)))
    # Who turns around has no left of his own: then the lean tells nothing.
    left = left / size if usual > 0 and size > 0.8 * usual else np.zeros(2)
    axis = axis / np.linalg.norm(axis)
    return left, float(-(axis[:2] @ left) / axis[2]), axis


@overload
def turned(recording: JointRecording, normal: Floats) -> JointRecording: ...
@overload
def turned(recording: MarkerRecording, normal: Floats) -> MarkerRecording: ...
def turned(
    recording: JointRecording | MarkerRecording, normal: Floats
) -> JointRecording | MarkerRecording:
    """The recording turned by the smallest rotation that takes ``normal`` (3,) to z."""
    turn = Rotation.align_vectors(np.array([[0.0, 0.0, 1.0]]), normal[None])[0].as_matrix()
    position = recording.position @ turn.T
    if isinstance(recording, JointRecording):
        return replace(recording, position=position, rotation=turn @ recording.rotation)
    plates = tuple(
        replace(
            plate, corners=plate.corners @ turn.T, force=plate.force @ turn.T,
            point=plate.point @ turn.T, free_moment=plate.free_moment @ turn.T,
        )
        for plate in recording.plates
    )  # fmt: skip
    return replace(recording, position=position, plates=plates)
