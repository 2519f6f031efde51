"""From a file of any known format to a clip."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

from physretarget.clip import gmr, locomujoco, mjlab, own, plain, table
from physretarget.clip.arrays import MAX_BYTES, Members, as_floats, read_npy
from physretarget.clip.core import Clip
from physretarget.clip.raw import JointOrder, Layout, Raw, Told, finish, order_of
from physretarget.errors import InputError

CLIP_SUFFIXES = (".npz", ".npy", ".csv", ".pkl")


def load_clip(
    path: str | os.PathLike[str],
    *,
    character: Layout | None = None,
    fps: float | None = None,
    quat: str | None = None,
    joint_order: JointOrder | None = None,
) -> Clip:
    """Read a clip, ours or another tool's.

    With a ``character`` the joints are checked and ordered by name, quaternions found and
    repaired. ``fps``, ``quat`` ("wxyz" or "xyzw") and ``joint_order`` say what a file does
    not. Raises InputError for anything that cannot be used, UnsafeInputError for a file that
    tries to run code or claims absurd sizes.
    """
    told = Told(fps=fps, quat=order_of(quat), joint_order=joint_order)
    source = Path(path)
    suffix = source.suffix.lower()
    if suffix not in CLIP_SUFFIXES:
        raise InputError(
            f"'{suffix or source.name}' is no clip format: {', '.join(CLIP_SUFFIXES)} are.",
            path=source,
        )
    content = _content(source)
    raw = _read(content, suffix, str(source), character, told)
    return finish(raw, character, told)


def _content(source: Path) -> bytes:
    try:
        size = source.stat().st_size
        if size > MAX_BYTES:
            raise InputError(f"has {size} bytes, at most {MAX_BYTES} are read.", path=source)
        content = source.read_bytes()
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}.", path=source) from error
    if not content:
        raise InputError("the file is empty.", path=source)
    return content


def _read(content: bytes, suffix: str, path: str, character: Layout | None, told: Told) -> Raw:
    digest = hashlib.sha256(content).hexdigest()
    if suffix == ".csv":
        return table.read(content, path=path, sha256=digest)
    if suffix == ".pkl":
        return gmr.read(content, path=path, sha256=digest)
    if suffix == ".npy":
        values = as_floats(
            read_npy(content, size=len(content), path=path), name="qpos", ndim=2, path=path
        )
        return plain.from_qpos(values, path=path, sha256=digest)
    members = Members(content, path=path)
    if {"qpos", "time", "meta", "joint_names"} <= set(members):
        return own.read(members, sha256=digest)
    if {"qpos", "frequency"} <= set(members):
        return locomujoco.read(members, sha256=digest)
    if "joint_pos" in members:
        return mjlab.read(members, sha256=digest, character=character, told=told)
    if "qpos" in members:
        return plain.read(members, sha256=digest)
    if {"root_pos", "root_rot", "dof_pos"} <= set(members):
        return gmr.from_mapping(dict(members), path=path, sha256=digest, format="GMR npz")
    raise InputError(
        f"the npz holds {', '.join(sorted(members)[:8]) or 'nothing'}, a clip needs 'qpos' or "
        "'joint_pos' or 'root_pos', 'root_rot', 'dof_pos'.",
        path=path,
    )
