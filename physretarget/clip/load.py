"""From a file of any known format to a clip."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from physretarget.archives.arrays import MAX_BYTES, Members, npy_frames
from physretarget.clip import (
    gmr,
    isaaclab,
    lerobot,
    locomujoco,
    mjlab,
    own,
    plain,
    protomotions,
    table,
)
from physretarget.clip.core import Clip, LongClip
from physretarget.clip.raw import Layout, Raw, Told, finish, order_of
from physretarget.clip.unit import unit_scale
from physretarget.errors import InputError
from physretarget.options.motion import JointOrder

CLIP_SUFFIXES = (".npz", ".npy", ".csv", ".pkl", ".motion", ".parquet")
_POINTER = b"version https://git-lfs"


def load_clip(
    path: str | os.PathLike[str],
    *,
    character: Layout | None = None,
    fps: float | None = None,
    quat: str | None = None,
    joint_order: JointOrder | None = None,
    unit: str | None = None,
) -> Clip:
    """Read a clip, ours or another tool's.

    With a ``character`` the joints are checked and ordered by name, quaternions found and
    repaired. ``fps``, ``quat`` ("wxyz" or "xyzw"), ``joint_order`` and ``unit`` (m, cm, mm, inch or
    metres per unit, of the root's position and of slides) say what a file does not. Raises
    InputError for anything that cannot be used, UnsafeInputError for a file that tries to run code
    or claims absurd sizes.

    Args:
        path: The file.
        character: Checks and orders the joints by name, where given.
        fps: Frames per second of a file that does not say.
        quat: Order of the root's quaternion, wxyz or xyzw, likewise.
        joint_order: model or breadth-first, of joints without names.
        unit: m, cm, mm, inch or metres per unit.

    Returns:
        The clip, in MuJoCo's layout: metres, radians, wxyz.
    """
    return open_clip(
        path, character=character, fps=fps, quat=quat, joint_order=joint_order, unit=unit
    ).whole()  # fmt: skip


def open_clip(
    path: str | os.PathLike[str],
    *,
    character: Layout | None = None,
    fps: float | None = None,
    quat: str | None = None,
    joint_order: JointOrder | None = None,
    unit: str | None = None,
) -> LongClip:
    """The same as :func:`load_clip`, its poses read when asked for: for clips of any length.

    npz, npy and csv are read some frames at a time, poses of long clips set aside in a temporary
    file. A pickle is one piece and is read as such.

    Args:
        path: The file.
        character: As for ``load_clip``.
        fps: As for ``load_clip``.
        quat: As for ``load_clip``.
        joint_order: As for ``load_clip``.
        unit: As for ``load_clip``.

    Returns:
        The clip, its poses still in the file.
    """
    told = Told(fps=fps, quat=order_of(quat), joint_order=joint_order, scale=unit_scale(unit))
    source = Path(path)
    suffix = source.suffix.lower()
    if suffix not in CLIP_SUFFIXES:
        raise InputError(
            f"'{suffix or source.name}' is no clip format: {', '.join(CLIP_SUFFIXES)} are.",
            path=source,
        )
    with _opened(source) as file:
        _refuse_pointer(file, str(source))
        raw = _read(file, suffix, str(source), character, told)
        return finish(raw, character, told)


@contextmanager
def _opened(source: Path) -> Iterator[IO[bytes]]:
    try:
        file = source.open("rb")
        size = os.fstat(file.fileno()).st_size
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}.", path=source) from error
    with file:
        if size > MAX_BYTES:
            raise InputError(f"has {size} bytes, at most {MAX_BYTES} are read.", path=source)
        if size == 0:
            raise InputError("the file is empty.", path=source)
        yield file


def _refuse_pointer(file: IO[bytes], path: str) -> None:
    """What git-lfs leaves in a file's place is called what it is."""
    head = file.read(len(_POINTER))
    file.seek(0)
    if head == _POINTER:
        raise InputError(
            "is a git-lfs pointer, not the clip: fetch the file itself (git lfs pull).", path=path
        )


def _read(file: IO[bytes], suffix: str, path: str, character: Layout | None, told: Told) -> Raw:
    digest = hashlib.file_digest(file, "sha256").hexdigest()  # type: ignore[arg-type]
    size = file.tell()
    file.seek(0)
    if suffix == ".csv":
        return table.read(file, path=path, sha256=digest)
    if suffix == ".pkl":
        return gmr.read(file.read(), path=path, sha256=digest)
    if suffix == ".motion":
        return protomotions.read(file, path=path, sha256=digest)
    if suffix == ".parquet":
        return lerobot.read(file, path=path, sha256=digest)
    if suffix == ".npy":
        array = npy_frames(lambda: _from_start(file), size=size, ndim=2, path=path)
        return plain.from_qpos(array, path=path, sha256=digest)
    return _read_npz(Members(file, path=path), digest, character, told)


def _from_start(file: IO[bytes]) -> IO[bytes]:
    file.seek(0)
    return file


def _read_npz(members: Members, digest: str, character: Layout | None, told: Told) -> Raw:
    path = members.path
    if {"qpos", "time", "meta", "joint_names"} <= set(members):
        return own.read(members, sha256=digest)
    if {"qpos", "frequency"} <= set(members):
        return locomujoco.read(members, sha256=digest)
    if {"joint_pos", "base_pos_w", "base_quat_w"} <= set(members):
        return isaaclab.read(members, sha256=digest)
    if "joint_pos" in members:
        return mjlab.read(members, sha256=digest, character=character, told=told)
    if "qpos" in members:
        return plain.read(members, sha256=digest)
    if sum(name.startswith("q_") for name in members) > 1:
        return locomujoco.read_columns(members, sha256=digest)
    if {"root_pos", "root_rot", "dof_pos"} <= set(members):
        return gmr.from_mapping(members, path=path, sha256=digest, format="GMR npz")
    raise InputError(
        f"the npz holds {', '.join(sorted(members)[:8]) or 'nothing'}, a clip needs 'qpos' or "
        "'joint_pos' or 'root_pos', 'root_rot', 'dof_pos'.",
        path=path,
    )
