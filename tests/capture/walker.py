"""A person who walks straight on with planted feet, and files that hold what others saw of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physretarget.capture.actor import SEGMENT, SEGMENTS, ActorShape
from physretarget.capture.marker_sets import recognise
from physretarget.kinematics import Pose, forward, points

Floats = NDArray[np.float64]

FPS = 60.0
CMU = [
    "LFHD", "RFHD", "LBHD", "RBHD", "C7", "T10", "CLAV", "STRN", "RBAK", "LASI", "RASI",
    "LPSI", "RPSI", "LSHO", "RSHO", "LUPA", "RUPA", "LELB", "RELB", "LFRM", "RFRM", "LWRA",
    "RWRA", "LWRB", "RWRB", "LFIN", "RFIN", "LTHI", "RTHI", "LKNE", "RKNE", "LTIB", "RTIB",
    "LANK", "RANK", "LHEE", "RHEE", "LTOE", "RTOE",
]  # fmt: skip
_STEP_S, _SWING = 0.5, np.radians(18.0)


def walk(seconds: float = 2.5) -> tuple[ActorShape, Floats]:
    """The reference actor's shape and a walk (T, 75): an inverted pendulum on level soles."""
    shape = ActorShape.reference()
    time = np.arange(round(seconds * FPS)) / FPS
    step, phase = np.divmod(time / _STEP_S, 1.0)
    lean = _SWING * (2 * phase - 1)  # of the leg that stands: from in front to behind
    leg = float(-shape.offset[SEGMENT["left_shank"], 2] - shape.offset[SEGMENT["left_foot"], 2])
    qpos = np.tile(shape.tree().neutral(), (len(time), 1))
    qpos[:, 0] = (2 * step * np.sin(_SWING) + np.sin(lean)) * leg
    qpos[:, 2] -= leg * (1 - np.cos(lean))
    knee = np.radians(50.0) * np.sin(np.pi * phase)
    for side, first in (("left", 0), ("right", 1)):
        stands = step % 2 == first
        thigh = np.where(stands, lean, -lean - knee / 2)
        shank = np.where(stands, 0.0, knee)
        for part, angle in (("thigh", thigh), ("shank", shank), ("foot", -thigh - shank)):
            at = 3 + 4 * SEGMENT[f"{side}_{part}"]
            qpos[:, at], qpos[:, at + 2] = np.cos(angle / 2), np.sin(angle / 2)
    return shape, qpos


def pose_of(shape: ActorShape, qpos: Floats) -> Pose:
    """World poses of the segments."""
    return forward(shape.tree(), qpos)


def markers(labels: Sequence[str] = CMU, seconds: float = 2.5) -> Floats:
    """World places (T, M, 3) m, z up, of the walker's markers."""
    shape, qpos = walk(seconds)
    marks = [mark for mark in recognise(labels) if mark is not None]
    segment = np.array([mark.segment for mark in marks]) + 1
    return points(pose_of(shape, qpos), segment, np.array([mark.local for mark in marks]))


def joint_centres(seconds: float = 2.5) -> dict[str, Floats]:
    """World places (T, 3) m of the walker's joints, by segment."""
    shape, qpos = walk(seconds)
    position = pose_of(shape, qpos).position
    return {name: position[:, 1 + i] for i, name in enumerate(SEGMENTS)}


def write_trc(path: Path, labels: Sequence[str], position: Floats, *, y_up: bool = True) -> Path:
    """Write markers (T, M, 3), z up, as a TRC file in metres with y up."""
    turned = position[..., [1, 2, 0]] if y_up else position
    names = "\t\t\t".join(labels)
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{path.name}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits",
        f"{FPS:g}\t{FPS:g}\t{len(turned)}\t{len(labels)}\tm",
        f"Frame#\tTime\t{names}",
        "",
    ]
    for frame, row in enumerate(turned):
        numbers = "\t".join(f"{value:.5f}" for value in row.ravel())
        lines.append(f"{frame + 1}\t{frame / FPS:.5f}\t{numbers}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path
