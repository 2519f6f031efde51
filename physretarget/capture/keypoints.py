"""3-D key points: a person's joints as a network sees them, in JSON, CSV or npy.

Read are tables with columns ``NAME_x, NAME_y, NAME_z`` (FreeMoCap, MediaPipe), JSON with ``names``
and ``frames``, lists of frames of ``{NAME: [x, y, z]}``, and arrays (T, J, 3) of a known number of
joints: MediaPipe's 33, OpenPose's 25, COCO's and H36M's 17, SMPL's 22 and 24.
"""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from physretarget.archives.arrays import as_floats, read_npy
from physretarget.capture.marker_file import RawMarkers, finish, markers_of, read_bytes
from physretarget.capture.reader import ReadOptions
from physretarget.capture.recording import Floats, MarkerRecording
from physretarget.capture.text import decoded
from physretarget.errors import InputError, UnsafeInputError

_MEDIAPIPE = [
    "nose", "left_eye_inner", "left_eye", "left_eye_outer", "right_eye_inner", "right_eye",
    "right_eye_outer", "left_ear", "right_ear", "mouth_left", "mouth_right", "left_shoulder",
    "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist", "left_pinky",
    "right_pinky", "left_index", "right_index", "left_thumb", "right_thumb", "left_hip",
    "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle", "left_heel",
    "right_heel", "left_foot_index", "right_foot_index",
]  # fmt: skip
_OPENPOSE = [
    "Nose", "Neck", "RShoulder", "RElbow", "RWrist", "LShoulder", "LElbow", "LWrist", "MidHip",
    "RHip", "RKnee", "RAnkle", "LHip", "LKnee", "LAnkle", "REye", "LEye", "REar", "LEar",
    "LBigToe", "LSmallToe", "LHeel", "RBigToe", "RSmallToe", "RHeel",
]  # fmt: skip
_COCO = [
    "nose", "left_eye", "right_eye", "left_ear", "right_ear", "left_shoulder", "right_shoulder",
    "left_elbow", "right_elbow", "left_wrist", "right_wrist", "left_hip", "right_hip",
    "left_knee", "right_knee", "left_ankle", "right_ankle",
]  # fmt: skip
_H36M = [
    "MidHip", "RHip", "RKnee", "RAnkle", "LHip", "LKnee", "LAnkle", "Spine", "Neck", "Nose",
    "HeadTop", "LShoulder", "LElbow", "LWrist", "RShoulder", "RElbow", "RWrist",
]  # fmt: skip
_SMPL = [
    "MidHip", "LHip", "RHip", "Spine1", "LKnee", "RKnee", "Spine2", "LAnkle", "RAnkle", "Spine3",
    "LFoot", "RFoot", "Neck", "LCollar", "RCollar", "HeadCentre", "LShoulder", "RShoulder",
    "LElbow", "RElbow", "LWrist", "RWrist", "LPalm", "RPalm",
]  # fmt: skip
_BY_COUNT: dict[int, tuple[Sequence[str], ...]] = {
    33: (_MEDIAPIPE,), 25: (_OPENPOSE,), 17: (_COCO, _H36M), 24: (_SMPL,), 22: (_SMPL[:22],),
}  # fmt: skip
_NAME_KEYS = ("names", "joint_names", "keypoint_names", "labels", "joints", "markers")
_FRAME_KEYS = ("frames", "keypoints", "data", "positions", "poses", "keypoints_3d")
_RATE_KEYS = ("fps", "frame_rate", "framerate", "rate", "sampling_rate")
_AXIS = re.compile(r"^(.+?)[ _.:-]*([xyzXYZ])$")
_TIME = ("time", "t", "seconds", "timestamp")
_CUSTOM = 30.0
_MOST_POINTS, _MOST_VALUES = 2000, 100_000_000
_BONES = (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist"))


def read(path: str | Path, options: ReadOptions) -> MarkerRecording:
    """Read key points; ``options.rate`` tells the frame rate of a file that states none.

    Raises:
        InputError: With the frame, for what cannot be understood.
        UnsafeInputError: The file claims absurd sizes.
    """
    content = read_bytes(path)
    ending = Path(path).suffix.lower()
    if ending == ".npy":
        array = read_npy(content, size=len(content), path=str(path))
        position = as_floats(array, name="key points", ndim=3, path=str(path))
        labels, stated = _named(position, path), None
    elif ending == ".json":
        labels, position, stated = _from_json(content, path)
    else:
        labels, position, stated = _from_table(content, path)
    if position.shape[2:] != (3,) or len(labels) != position.shape[1]:
        raise InputError(
            f"{len(labels)} names and positions of shape {position.shape} do not belong together; "
            "(T, J, 3) are needed.",
            path=path,
        )
    rate = stated or options.rate or _CUSTOM
    note = f"no frame rate in the file: taken as {_CUSTOM:g} (--rate tells another)"
    raw = RawMarkers(
        path=path, content=content, format="keypoints", fps=rate, labels=tuple(labels),
        position=position, unit=None, up=None, usual_up="y",
        notes=() if stated or options.rate else (note,),
    )  # fmt: skip
    found = finish(raw, unit=options.unit, up=options.up, names=options.names)
    return found if options.subject is None else markers_of(found, options.subject)


def _named(position: Floats, path: str | Path) -> Sequence[str]:
    """Names for so many points; of two sets that fit, that whose bones keep their length."""
    sets = _BY_COUNT.get(position.shape[1])
    if sets is None:
        known = ", ".join(str(n) for n in sorted(_BY_COUNT))
        raise InputError(
            f"an array of {position.shape[1]} points names no joints; known are sets of {known}.",
            path=path,
        )
    return min(sets, key=lambda names: _unevenness(names, position))


def _unevenness(names: Sequence[str], position: Floats) -> float:
    """By how much left and right bones differ and change, as a share of their length."""
    place = {re.sub(r"[^a-z]", "", name.lower()): i for i, name in enumerate(names)}
    shares = []
    for a, b in _BONES:
        both = []
        for side in (("l", "left"), ("r", "right")):
            ends = [next((place[s + p] for s in side if s + p in place), None) for p in (a, b)]
            if None in ends:
                return float("inf")
            both.append(np.linalg.norm(position[:, ends[0]] - position[:, ends[1]], axis=1))
        lengths = np.stack(both)
        mean = float(np.nanmean(lengths))
        shares.append(float(np.nanstd(lengths)) / max(mean, 1e-12))
    return float(np.mean(shares))


Read = tuple[Sequence[str], Floats, float | None]


def _from_json(content: bytes, path: str | Path) -> Read:
    try:
        loaded = json.loads(decoded(content))
    except json.JSONDecodeError as error:
        raise InputError(f"broken JSON: {error.msg}.", path=path, line=error.lineno) from error
    except RecursionError as error:
        raise InputError("the JSON is nested too deeply.", path=path) from error
    stated, names, frames = None, None, loaded
    if isinstance(loaded, dict):
        rate = next((loaded[key] for key in _RATE_KEYS if key in loaded), None)
        stated = float(rate) if isinstance(rate, int | float) and 0.1 <= rate <= 1e5 else None
        names = next((loaded[key] for key in _NAME_KEYS if key in loaded), None)
        frames = next((loaded[key] for key in _FRAME_KEYS if key in loaded), None)
    if not isinstance(frames, list) or not frames:
        raise InputError("the file needs a list of frames, 'frames'.", path=path)
    named = [_frame(frame, number, path) for number, frame in enumerate(frames)]
    if isinstance(named[0], dict):
        labels = list(dict.fromkeys(name for f in named if isinstance(f, dict) for name in f))
        rows = [[f.get(n, [np.nan] * 3) for n in labels] for f in named if isinstance(f, dict)]
    else:
        labels, rows = names, named  # type: ignore[assignment]
    try:
        position = np.array(
            [[[np.nan if v is None else v for v in point[:3]] for point in row] for row in rows],
            dtype=np.float64,
        )
    except (ValueError, TypeError) as error:
        raise InputError("the frames are no regular lists of [x, y, z].", path=path) from error
    if position.ndim != 3 or position.shape[2] != 3:
        raise InputError(f"the frames have the shape {position.shape}.", path=path)
    if isinstance(labels, list) and all(isinstance(name, str) for name in labels) and labels:
        return labels, position, stated
    return _named(position, path), position, stated


def _frame(frame: Any, number: int, path: str | Path) -> dict[str, Any] | list[Any]:
    """One frame's points: by name, or in a list; either may be wrapped."""
    for key in ("keypoints", "joints", "points", "landmarks", "markers", "pose_landmarks"):
        if isinstance(frame, dict) and isinstance(frame.get(key), list | dict):
            frame = frame[key]
            break
    if isinstance(frame, dict):
        points = {n: _point(p) for n, p in frame.items() if isinstance(p, list | dict)}
        if points:
            return points
    if isinstance(frame, list) and frame:
        return [_point(point) for point in frame]
    raise InputError("a frame holds no points.", path=path, frame=number)


def _point(point: Any) -> Any:
    if isinstance(point, dict):
        return [point.get(axis) for axis in "xyz"]
    return point


def _from_table(content: bytes, path: str | Path) -> Read:
    """A table with a header of NAME_x, NAME_y, NAME_z; frame and time may stand beside them."""
    text = decoded(content)
    separator = ";" if text[:2000].count(";") > text[:2000].count(",") else ","
    rows = csv.reader(io.StringIO(text), delimiter=separator)
    try:
        header = [cell.strip() for cell in next(rows)]
        columns = _columns(header)
        if not columns:
            raise InputError(
                "no column is named as NAME_x, NAME_y, NAME_z; this is no table of key points.",
                path=path,
                line=1,
            )
        if len(columns) > _MOST_POINTS:
            raise UnsafeInputError(f"the table names {len(columns)} points.", path=path)
        order = [i for axes in columns.values() for i in axes]
        time = next(
            (i for i, n in enumerate(header) if n.lower() in ("time", "t", "seconds")), None
        )
        values, times = [], []
        for number, row in enumerate(rows, start=2):
            if not any(cell.strip() for cell in row):
                continue
            values.append([_number(row, i, path, number) for i in order])
            if time is not None:
                times.append(_number(row, time, path, number))
            if len(values) * len(order) > _MOST_VALUES:
                raise UnsafeInputError("the table is absurdly long.", path=path, line=number)
    except csv.Error as error:
        raise InputError(f"the table is damaged: {error}.", path=path) from error
    if not values:
        raise InputError("the table has a header and no frame.", path=path, line=2)
    step = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    position = np.array(values).reshape(len(values), -1, 3)
    return list(columns), position, 1 / step if step > 1e-5 else None


def _columns(header: Sequence[str]) -> dict[str, list[int]]:
    """The columns of each point's x, y and z."""
    found: dict[str, dict[str, int]] = {}
    for i, name in enumerate(header):
        match = _AXIS.match(name)
        if match:
            found.setdefault(match[1], {})[match[2].lower()] = i
    return {n: [axes[a] for a in "xyz"] for n, axes in found.items() if axes.keys() >= set("xyz")}


def _number(row: Sequence[str], i: int, path: str | Path, line: int) -> float:
    cell = row[i].strip() if i < len(row) else ""
    try:
        return float(cell) if cell else float("nan")
    except ValueError as error:
        raise InputError(f"{cell[:40]!r} is not a number.", path=path, line=line) from error
