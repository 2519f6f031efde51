"""Motion files of DeepMimic ("humanoid3d"), as the pybullet package carries them.

JSON: ``Frames`` rows of duration, root position (3), root quaternion wxyz (4), then the joints:
chest 4, neck 4, right hip 4, right knee 1, right ankle 4, right shoulder 4, right elbow 1, left
hip 4, left knee 1, left ankle 4, left shoulder 4, left elbow 1. Metres, y up; the character faces
+x and its left is -z; hinges turn about z.
Offsets: the published character humanoid3d.txt of DeepMimic (Peng et al. 2018, MIT licence);
pybullet's humanoid.urdf is the same skeleton four times as large.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from physretarget.capture.reader import ReadOptions
from physretarget.capture.recording import Floats, JointRecording, Names, sha256_of
from physretarget.capture.skeleton import Raw, chain_positions, finish, nice_rate
from physretarget.errors import InputError

# name, parent, offset in the parent's frame (m), numbers per frame (4 quaternion, 1 hinge, 0 none)
_JOINTS: tuple[tuple[str, int, tuple[float, float, float], int], ...] = (
    ("root", -1, (0.0, 0.0, 0.0), 4),
    ("chest", 0, (0.0, 0.236151, 0.0), 4),
    ("neck", 1, (0.0, 0.223894, 0.0), 4),
    ("right_hip", 0, (0.0, 0.0, 0.084887), 4),
    ("right_knee", 3, (0.0, -0.421546, 0.0), 1),
    ("right_ankle", 4, (0.0, -0.409870, 0.0), 4),
    ("right_shoulder", 1, (-0.02405, 0.24350, 0.18311), 4),
    ("right_elbow", 6, (0.0, -0.274788, 0.0), 1),
    ("right_wrist", 7, (0.0, -0.258947, 0.0), 0),
    ("left_hip", 0, (0.0, 0.0, -0.084887), 4),
    ("left_knee", 9, (0.0, -0.421546, 0.0), 1),
    ("left_ankle", 10, (0.0, -0.409870, 0.0), 4),
    ("left_shoulder", 1, (-0.02405, 0.24350, -0.18311), 4),
    ("left_elbow", 12, (0.0, -0.274788, 0.0), 1),
    ("left_wrist", 13, (0.0, -0.258947, 0.0), 0),
)
_WIDTH = 4 + sum(joint[3] for joint in _JOINTS)
# Ends of the published character's shapes: the sole's toe edge, the top of the head, the fists
# (the balls at the wrists), on which the cartwheel stands.
_ENDS = {
    "neck_end": (2, (0.0, 0.2775, 0.0)),
    "right_ankle_end": (5, (0.1335, -0.05, 0.0)),
    "left_ankle_end": (11, (0.1335, -0.05, 0.0)),
    "right_wrist_end": (8, (0.0, -0.07, 0.0)),
    "left_wrist_end": (14, (0.0, -0.07, 0.0)),
}


def read(path: str | Path, options: ReadOptions) -> JointRecording:
    """Read a motion as the registry of readers does; see :func:`read_deepmimic`."""
    return read_deepmimic(path, unit=options.unit, up=options.up, names=options.names)


def read_deepmimic(
    path: str | Path,
    *,
    unit: str | None = None,
    up: str | None = None,
    names: Names | None = None,
) -> JointRecording:
    """Read a DeepMimic motion file; InputError if it is none of a humanoid3d character."""
    content = Path(path).read_bytes()
    frames = _frames(content, path)
    durations = frames[:-1, 0] if len(frames) > 1 else frames[:, 0]
    frame_time, notes = _frame_time(durations, path)
    root = frames[:, 1:4]
    at = 4
    local, rotation = [], []
    for name, parent, offset, width in _JOINTS:
        values = frames[:, at : at + width]
        at += width
        rotation.append(_rotation(name, values, path))
        local.append(root if parent < 0 else np.tile(np.array(offset), (len(frames), 1)))
    joints = zip(local, rotation, strict=True)
    position, world = chain_positions([joint[1] for joint in _JOINTS], joints, len(frames))
    raw = Raw(
        path=str(path),
        sha256=sha256_of(content),
        format="deepmimic",
        fps=nice_rate(frame_time),
        names=tuple(joint[0] for joint in _JOINTS),
        parents=tuple(joint[1] for joint in _JOINTS),
        position=position,
        rotation=world,
        end_sites={name: (joint, np.array(offset)) for name, (joint, offset) in _ENDS.items()},
        notes=notes,
    )
    return finish(raw, unit=unit or "m", up=up or "y", names=names)


def _frames(content: bytes, path: str | Path) -> Floats:
    """The frames' numbers (T, 44), checked."""
    if not content.strip():
        raise InputError("The file is empty.", path=path)
    try:
        loaded = json.loads(content.decode("utf-8-sig"))
    except UnicodeDecodeError:
        raise InputError("The file is no text.", path=path) from None
    except json.JSONDecodeError as error:
        raise InputError(f"Broken JSON: {error.msg}.", path=path, line=error.lineno) from None
    except RecursionError:
        raise InputError("The JSON is nested too deeply.", path=path) from None
    rows = loaded.get("Frames") if isinstance(loaded, dict) else None
    if not isinstance(rows, list) or not rows:
        raise InputError("A DeepMimic motion needs a non-empty list 'Frames'.", path=path)
    for number, row in enumerate(rows):
        if not isinstance(row, list) or len(row) != _WIDTH:
            given = len(row) if isinstance(row, list) else 0
            raise InputError(
                f"A frame of a DeepMimic human has {_WIDTH} numbers, this one {given}: "
                "not a humanoid3d motion.",
                path=path,
                frame=number,
            )
        if not all(type(value) in (int, float) for value in row):
            raise InputError("A value is not a number.", path=path, frame=number)
    try:
        frames = np.array(rows, dtype=np.float64)
    except OverflowError:
        raise InputError("A value is too large.", path=path) from None
    bad = (np.abs(frames) > 1e6).any(axis=1)
    if bad.any():
        raise InputError("A value is infinite or too large.", path=path, frame=int(np.argmax(bad)))
    return frames


def _frame_time(durations: Floats, path: str | Path) -> tuple[float, tuple[str, ...]]:
    """The common duration of a frame; the last frame's own (often 0) does not count."""
    middle = float(np.median(durations))
    if not 1e-4 <= middle <= 2.0:
        raise InputError(
            f"Frames last {middle:g} s; they must last between 0.0001 and 2 s.", path=path
        )
    if np.all(np.abs(durations - middle) < 0.02 * middle):
        return middle, ()
    odd = int(np.argmax(np.abs(durations - middle)))
    return middle, (f"frame durations differ (first at frame {odd}); the median is used",)


def _rotation(name: str, values: Floats, path: str | Path) -> Floats:
    """Rotations (T, 3, 3) from quaternions wxyz, hinge angles about z, or nothing."""
    if values.shape[1] == 0:
        return np.tile(np.eye(3), (len(values), 1, 1))
    if values.shape[1] == 1:
        gap = np.isnan(values[:, 0])
        vector = np.zeros((len(values), 3))
        vector[:, 2] = np.where(gap, 0.0, values[:, 0])
        turned: Floats = Rotation.from_rotvec(vector).as_matrix()
        turned[gap] = np.nan
        return turned
    length = np.linalg.norm(values, axis=1)
    # Interpolated by components, quaternions shrink (humanoid3d_kick falls to 0.78).
    wrong = (length < 0.5) | (length > 2.0)
    if wrong.any():
        raise InputError(
            f"The quaternion of {name} is far from unit length.",
            path=path,
            frame=int(np.argmax(wrong)),
        )
    gap = np.isnan(length)
    quat = np.where(gap[:, None], np.array([1.0, 0, 0, 0]), values)
    matrix: Floats = Rotation.from_quat(quat, scalar_first=True).as_matrix()
    matrix[gap] = np.nan
    return matrix
