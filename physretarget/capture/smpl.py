"""SMPL, SMPL-H and SMPL-X parameters: joint rotations, on a skeleton of our own proportions.

The body models are licensed and are not needed: their first 22 joints turn as told, about the
joints of the reference actor in their rest pose, which is a T. Shapes (betas) are left out, so that
only proportions are ours. Known are the archives of AMASS (``poses`` and ``trans``, or SMPL-X's
``root_orient`` and ``pose_body``), AIST++ (``smpl_poses``, ``smpl_trans``), OMOMO and GVHMR
(``global_orient``, ``body_pose``, ``transl``).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from physretarget.archives import open_archive
from physretarget.capture.actor import SEGMENT, ActorShape
from physretarget.capture.reader import ReadOptions
from physretarget.capture.recording import Floats, JointRecording, sha256_of
from physretarget.capture.skeleton import Raw, chain_positions, finish
from physretarget.errors import InputError

_JOINTS = (
    ("pelvis", -1), ("left_hip", 0), ("right_hip", 0), ("spine1", 0), ("left_knee", 1),
    ("right_knee", 2), ("spine2", 3), ("left_ankle", 4), ("right_ankle", 5), ("spine3", 6),
    ("left_foot", 7), ("right_foot", 8), ("neck", 9), ("left_collar", 9), ("right_collar", 9),
    ("head", 12), ("left_shoulder", 13), ("right_shoulder", 14), ("left_elbow", 16),
    ("right_elbow", 17), ("left_wrist", 18), ("right_wrist", 19),
)  # fmt: skip
"""Name and parent of SMPL's joints 0 to 21, as published with it; hands follow."""
_BODY = len(_JOINTS)
_ROOT = ("root_orient", "global_orient")
_POSES = ("poses", "smpl_poses", "fullpose", "pose")
_TRANSLATION = ("trans", "smpl_trans", "transl", "root_trans", "translation")
_RATES = ("mocap_framerate", "mocap_frame_rate", "fps", "framerate", "frame_rate", "mocap_fps")
_NESTED = ("smpl_params_global", "smpl_params", "smplx", "smpl", "params")
_SCALES = ("smpl_scaling",)  # AIST++ counts translations in units of this
_CUSTOM = 30.0  # frames/s of files that state none: video's
_MOST = 1e6


def read(path: str | Path, options: ReadOptions) -> JointRecording:
    """Read a motion of SMPL's parameters.

    Args:
        path: An npz, or a pickle of arrays and plain containers.
        options: What the file does not say; ``rate`` where it states none.

    Raises:
        InputError: The file holds no such motion.
        UnsafeInputError: It would run code, or claims absurd sizes.
    """
    content = Path(path).read_bytes()
    values = _flat(open_archive(content, path))
    turns, place = _rotations(values, path), _translation(values, path)
    if len(turns) != len(place):
        raise InputError(
            f"{len(turns)} poses and {len(place)} translations do not belong together.", path=path
        )
    rate, notes = _rate(values, options.rate)
    offsets = _offsets()
    frames = len(turns)
    local = []
    for j, (_, parent) in enumerate(_JOINTS):
        at = place if parent < 0 else np.tile(offsets[j], (frames, 1))
        local.append((at, Rotation.from_rotvec(turns[:, j]).as_matrix()))
    position, rotation = chain_positions([p for _, p in _JOINTS], local, frames)
    raw = Raw(
        path=str(path),
        sha256=sha256_of(content),
        format="smpl",
        fps=rate,
        names=tuple(name for name, _ in _JOINTS),
        parents=tuple(parent for _, parent in _JOINTS),
        position=position,
        rotation=rotation,
        end_sites={"head_end": (15, np.array([0.0, 0.20, 0.02]))},
        notes=(*notes, "bones have the reference actor's lengths: the file has rotations alone"),
    )
    return finish(raw, unit=options.unit or "m", up=options.up, names=options.names)


def _flat(values: Mapping[Any, Any]) -> Mapping[Any, Any]:
    """The parameters themselves, out of the dictionary that some tools put them in."""
    for key in _NESTED:
        inner = values.get(key)
        if isinstance(inner, Mapping):
            return {**values, **inner}
    only = list(values.values())
    if only and all(isinstance(value, Mapping) for value in only):
        first: Mapping[Any, Any] = only[0]
        return first  # a collection of motions under their names
    return values


def _first(values: Mapping[Any, Any], names: tuple[str, ...]) -> Any:
    return next((values[name] for name in names if name in values), None)


def _array(value: Any, name: str, path: str | Path) -> Floats:
    array = np.asarray(value)
    if array.dtype.kind not in "iuf" or array.size == 0:
        raise InputError(f"'{name}' holds no numbers.", path=path)
    floats = array.astype(np.float64)
    bad = ~np.isfinite(floats) | (np.abs(floats) > _MOST)
    if bad.any():
        frame = int(np.argwhere(bad)[0][0]) if floats.ndim > 1 else 0
        raise InputError(f"'{name}' holds a number that is no pose.", path=path, frame=frame)
    return floats


def _rotations(values: Mapping[Any, Any], path: str | Path) -> Floats:
    """Rotation vectors (T, 22, 3)."""
    whole = _first(values, _POSES)
    if whole is None:
        root, body = _first(values, _ROOT), _first(values, ("pose_body", "body_pose"))
        if root is None or body is None:
            has = ", ".join(str(key) for key in list(values)[:8]) or "nothing"
            raise InputError(
                "this is no motion of SMPL's: it needs 'poses', or 'root_orient' and 'pose_body'; "
                f"the file has {has}.",
                path=path,
            )
        root = _array(root, "root_orient", path)
        body = _array(body, "pose_body", path)
        frames = len(root)
        parts = [root.reshape(frames, -1, 3), body.reshape(len(body), -1, 3)]
        if len(body) != frames or parts[0].shape[1] != 1:
            raise InputError("root_orient and pose_body do not belong together.", path=path)
        vectors = np.concatenate(parts, axis=1)
    else:
        poses = _array(whole, "poses", path)
        if poses.ndim < 2 or poses[0].size % 3:
            raise InputError(f"'poses' has shape {poses.shape}, (T, 3 n) is needed.", path=path)
        vectors = poses.reshape(len(poses), -1, 3)
    if vectors.shape[1] < _BODY:
        raise InputError(
            f"the poses turn {vectors.shape[1]} joints, a body has {_BODY}.", path=path
        )
    return vectors[:, :_BODY]


def _translation(values: Mapping[Any, Any], path: str | Path) -> Floats:
    given = _first(values, _TRANSLATION)
    if given is None:
        raise InputError("the file has no translation ('trans'): feet would slide.", path=path)
    place = _array(given, "trans", path)
    if place.ndim != 2 or place.shape[1] != 3:
        raise InputError(f"'trans' has shape {place.shape}, (T, 3) is needed.", path=path)
    scale = _first(values, _SCALES)
    return place if scale is None else place / float(_array(scale, "smpl_scaling", path).ravel()[0])


def _rate(values: Mapping[Any, Any], told: float | None) -> tuple[float, tuple[str, ...]]:
    stated = _first(values, _RATES)
    array = np.asarray(stated) if stated is not None else np.zeros(0)
    if array.size == 1 and array.dtype.kind in "iuf" and 1 <= float(array.ravel()[0]) <= 1000:
        return float(array.ravel()[0]), ()
    if told is not None:
        return told, ()
    return _CUSTOM, (f"no frame rate in the file: taken as {_CUSTOM:g} (--rate tells another)",)


def _offsets() -> Floats:
    """(22, 3) joints from their parents in the T pose (y up, z forward, x left), m."""
    shape = ActorShape.reference()
    offset = shape.offset
    chest = offset[SEGMENT["chest"]][2]
    found = np.zeros((_BODY, 3))
    middle = {3: 0.6 * offset[SEGMENT["abdomen"]][2], 6: 0.4 * offset[SEGMENT["abdomen"]][2],
              9: 0.5 * chest, 12: 0.5 * chest + offset[SEGMENT["head"]][2],
              15: 0.25 * offset[SEGMENT["head"]][2]}  # fmt: skip
    for joint, height in middle.items():
        found[joint] = (0.0, height, 0.0)
    for side, sign, first in (("left", 1.0, 0), ("right", -1.0, 1)):
        thigh, shank, foot, collar, arm, fore, hand = (
            offset[SEGMENT[f"{side}_{part}"]]
            for part in ("thigh", "shank", "foot", "clavicle", "upper_arm", "forearm", "hand")
        )
        tip = shape.tip[SEGMENT[f"{side}_foot"]]
        found[1 + first] = (sign * abs(thigh[1]), thigh[2], 0.0)
        found[4 + first] = (0.0, shank[2], 0.0)
        found[7 + first] = (0.0, foot[2], 0.0)
        found[10 + first] = (0.0, 0.8 * tip[2], tip[0])
        found[13 + first] = (sign * abs(collar[1]), collar[2] + 0.5 * chest, 0.0)
        found[16 + first] = (sign * abs(arm[1]), arm[2], 0.0)
        found[18 + first] = (sign * abs(fore[2]), 0.0, 0.0)
        found[20 + first] = (sign * abs(hand[2]), 0.0, 0.0)
    return found
