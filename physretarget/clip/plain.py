"""Plain qpos arrays (npy, npz), holosoma's npz among them: MuJoCo's layout."""

from __future__ import annotations

from physretarget.archives.arrays import Frames, Members
from physretarget.clip.raw import Raw, rows_of

_RATES = ("fps", "frequency", "frame_rate", "framerate")
_NAMES = ("joint_names", "dof_names")
_QUAT_NOTE = "The array is a MuJoCo qpos: quaternions are taken as wxyz."


def from_qpos(values: Frames, *, path: str, sha256: str) -> Raw:
    """A bare (T, nq) array."""
    return Raw(
        format="qpos npy", path=path, sha256=sha256, rows=rows_of(values), order="wxyz",
        notes=(_QUAT_NOTE,),
    )  # fmt: skip


def read(members: Members, *, sha256: str) -> Raw:
    """An npz with qpos and, as far as present, time or a rate and joint names.

    holosoma writes qpos, fps, human_joints and cost; its qpos is MuJoCo's.
    """
    holosoma = {"human_joints", "cost"} & set(members)
    rate = next((members.scalar(n) for n in _RATES if n in members), None)
    if rate is None and "dt" in members:
        step = members.scalar("dt")
        rate = 1 / step if step else None
    names = next((members.strings(n) for n in _NAMES if n in members), None)
    return Raw(
        format="holosoma npz" if holosoma else "qpos npz",
        path=members.path,
        sha256=sha256,
        rows=rows_of(members.frames("qpos", ndim=2)),
        joints=names or None,
        order="wxyz",
        time=members.floats("time", ndim=1) if "time" in members else None,
        fps=rate,
        notes=() if holosoma else (_QUAT_NOTE,),
    )
