"""Whether a fitted motion could be a human's: doubts, one sentence each."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from physretarget.capture.actor import SEGMENT, ActorMotion
from physretarget.capture.level import Plane
from physretarget.capture.moving_floor import MovingFloor

_STATURE = (1.2, 2.2)  # m
_KNEE = np.radians(-20.0)  # knees extend to about -10 degrees (AAOS 1965); the rest is error
_MISSED = 0.04  # m RMS; good fits of markers miss by 1 to 2 cm, of joints by less than 1 mm
_SHARE = 0.05  # of the frames


def doubts(
    motion: ActorMotion, plane: Plane | None = None, moving: MovingFloor | None = None
) -> tuple[str, ...]:
    """Sentences about what could not be a human's motion on a floor.

    Statures of nobody, points that no body fits, knees that bend backward, hips that are nailed to
    their place, a slope (``plane``) on which the body stands upright, a floor that is ``moving``.
    """
    found = []
    if plane is not None and not plane.leans:
        found.append(
            f"the feet rest on a slope of {np.degrees(plane.tilt):.1f} degrees on which the body "
            "stands upright: everything after this takes the floor for level"
        )
    if moving is not None:
        found.append(f"{moving.sentence}: --hold-floor takes that out")
    height = motion.shape.height
    if not _STATURE[0] <= height <= _STATURE[1]:
        found.append(
            f"the actor is {height:.2f} m tall: if that is wrong, tell the unit "
            f"(now {motion.source.unit})"
        )
    missed = motion.marker_error_rms
    if missed is not None and missed > _MISSED:
        found.append(
            f"the fitted actor misses the file's points by {100 * missed:.0f} cm (RMS): they move "
            "as no one body does"
        )
    if _nailed(motion):
        found.append(
            "the hips stay at one point while the legs move: the file seems to hold rotations "
            "alone, so that feet slide"
        )
    for side in ("left", "right"):
        bent = knee_flexion(motion, side)[motion.valid]
        backward = bent < _KNEE
        if len(bent) and backward.mean() > _SHARE:
            found.append(
                f"the {side} knee bends backward by up to {-np.degrees(bent.min()):.0f} degrees "
                f"in {int(backward.sum())} frames: labels, sides or axes may be wrong"
            )
    return tuple(found)


def _nailed(motion: ActorMotion) -> bool:
    """Whether thighs turn by more than 10 degrees and the pelvis moves by less than 1 cm."""
    pose = motion.qpos[motion.valid]
    if len(pose) < 2 or np.ptp(pose[:, :3], axis=0).max() > 0.01:
        return False
    at = [3 + 4 * SEGMENT[f"{side}_thigh"] for side in ("left", "right")]
    turned = [np.abs(pose[:, i : i + 4] @ pose[0, i : i + 4]).min() for i in at]
    return bool(min(turned) < np.cos(np.radians(10.0) / 2))


def knee_flexion(motion: ActorMotion, side: str) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Flexion (T,) of a knee, rad: the shank's turn about the thigh's left axis."""
    at = 3 + 4 * SEGMENT[f"{side}_shank"]
    turn = Rotation.from_quat(motion.qpos[:, at : at + 4], scalar_first=True).as_matrix()
    flexion: np.ndarray[tuple[int], np.dtype[np.float64]] = np.arctan2(turn[:, 0, 2], turn[:, 2, 2])
    return flexion
