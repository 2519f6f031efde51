"""GMR's pickle: fps, root_pos, root_rot (xyzw), dof_pos; and PHC's and ASAP's, by other names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from physretarget.archives.arrays import Frames, Members, as_floats, texts
from physretarget.archives.joblib_pickle import MARK, unpickle_joblib
from physretarget.archives.pickles import unpickle
from physretarget.clip.raw import Raw, rows_of
from physretarget.errors import InputError


def read(content: bytes, *, path: str, sha256: str) -> Raw:
    """Read a GMR pickle without running anything of it."""
    joblib = MARK in content
    value = (unpickle_joblib if joblib else unpickle)(content, path=path)
    notes: tuple[str, ...] = ()
    if isinstance(value, dict) and value and all(isinstance(v, dict) for v in value.values()):
        # Collections keep motions under their names.
        name = next(iter(value))
        if len(value) > 1:
            notes = (f"The file holds {len(value)} motions; the first, '{name!s:.80}', is read.",)
        value = value[name]
    if not isinstance(value, dict):
        raise InputError(f"the pickle holds a {type(value).__name__}, not a dict.", path=path)
    form = "joblib pkl" if joblib else "GMR pkl"
    raw = from_mapping(_renamed(value), path=path, sha256=sha256, format=form)
    return replace(raw, notes=(*raw.notes, *notes))


def _renamed(value: dict[Any, Any]) -> dict[Any, Any]:
    """GMR's names for those of PHC and its kin (ASAP, PBHC), which mean the same."""
    named = dict(value)
    for theirs, ours in (("root_trans_offset", "root_pos"), ("dof", "dof_pos")):
        if theirs in named:
            named.setdefault(ours, named[theirs])
    return named


def from_mapping(value: Mapping[Any, Any], *, path: str, sha256: str, format: str) -> Raw:
    """A motion out of GMR's fields."""
    missing = [k for k in ("root_pos", "root_rot", "dof_pos") if k not in value]
    if missing:
        has = ", ".join(str(k) for k in list(value)[:8])
        raise InputError(f"a {format} needs '{missing[0]}', this one has {has}.", path=path)
    position, rotation, joints = (
        _frames(value, name, path) for name in ("root_pos", "root_rot", "dof_pos")
    )
    shapes = (position.shape, rotation.shape, joints.shape)
    if position.shape[1] != 3 or rotation.shape[1] != 4 or len({s[0] for s in shapes}) != 1:
        raise InputError(
            f"root_pos, root_rot, dof_pos have shapes {shapes}, (T, 3), (T, 4), (T, n) are needed.",
            path=path,
        )
    return Raw(
        format=format,
        path=path,
        sha256=sha256,
        rows=rows_of(position, rotation, joints),
        joints=_names(value),
        order="xyzw",
        fps=_rate(value.get("fps"), path),
    )


def _frames(value: Mapping[Any, Any], name: str, path: str) -> Frames:
    if isinstance(value, Members):
        return value.frames(name, ndim=2)
    return Frames.of(as_floats(value[name], name=name, ndim=2, path=path))


def _rate(value: Any, path: str) -> float | None:
    if value is None:
        return None
    array = np.asarray(value)
    if array.size != 1 or array.dtype.kind not in "iuf":
        raise InputError(f"'fps' must be one number, it is {value!r:.40}.", path=path)
    return float(array.ravel()[0])


def _names(value: Mapping[Any, Any]) -> tuple[str, ...] | None:
    for key in ("dof_names", "joint_names"):
        names = value.get(key)
        if isinstance(names, (list, tuple)):
            found = texts(np.array([*names, None], dtype=object)[:-1])
        elif isinstance(names, np.ndarray):
            found = texts(names.ravel())
        else:
            continue
        if found:
            return found
    return None
