"""Our own npz."""

from __future__ import annotations

import json

import numpy as np

from physretarget.archives.arrays import Members
from physretarget.clip.raw import Raw, rows_of
from physretarget.errors import InputError


def read(members: Members, *, sha256: str) -> Raw:
    """Read what :meth:`physretarget.clip.Clip.save` wrote."""
    path = members.path
    try:
        meta = json.loads(_text(members, "meta") or "{}")
    except (json.JSONDecodeError, RecursionError) as error:
        raise InputError("'meta' is not JSON text.", path=path) from error
    if not isinstance(meta, dict):
        raise InputError("'meta' must be a JSON object.", path=path)
    active = None
    if "contact_active" in members:
        array = members["contact_active"]
        if array.dtype != np.bool_ or array.ndim != 2:
            raise InputError("'contact_active' must be 2-dimensional booleans.", path=path)
        active = array.copy()
    return Raw(
        format="physretarget",
        path=path,
        sha256=sha256,
        rows=rows_of(members.frames("qpos", ndim=2)),
        rooted=False,  # without a character nothing is known about the columns
        joints=members.strings("joint_names") or None,
        order="wxyz",
        time=members.floats("time", ndim=1),
        contact_points=members.strings("contact_points") if "contact_points" in members else (),
        contact_active=active,
        model_name=_text(members, "model_name"),
        model_sha256=_text(members, "model_sha256"),
        meta=meta,
        notes=members.strings("notes") if "notes" in members else (),
    )


def _text(members: Members, name: str) -> str:
    if name not in members:
        return ""
    values = members.strings(name)
    return values[0] if values else ""
