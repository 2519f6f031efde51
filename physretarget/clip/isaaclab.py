"""Isaac Lab's recordings: npz with joint_pos, base_pos_w, base_quat_w (wxyz) and joint_names."""

from __future__ import annotations

from physretarget.archives.arrays import Members
from physretarget.clip.raw import Raw, rows_of
from physretarget.errors import InputError

_RATES = ("fps", "frame_rate", "framerate", "frequency")


def read(members: Members, *, sha256: str) -> Raw:
    """Root and joints of a recording; joints are ordered by name, where it names them.

    Args:
        members: The arrays of the npz.
        sha256: The file's hash.

    Raises:
        InputError: The arrays do not belong together.
    """
    base, turn = (members.frames(f"base_{name}_w", ndim=2) for name in ("pos", "quat"))
    joints = members.frames("joint_pos", ndim=2)
    counts = {base.shape[0], turn.shape[0], joints.shape[0]}
    if base.shape[1] != 3 or turn.shape[1] != 4 or len(counts) != 1:
        raise InputError(
            f"base_pos_w {base.shape}, base_quat_w {turn.shape} and joint_pos {joints.shape} do "
            "not belong together: (T, 3), (T, 4) and (T, n) are needed.",
            path=members.path,
        )
    rate = next((members.scalar(name) for name in _RATES if name in members), None)
    names = members.strings("joint_names") if "joint_names" in members else None
    return Raw(
        format="Isaac Lab npz",
        path=members.path,
        sha256=sha256,
        rows=rows_of(base, turn, joints),
        joints=names,
        order="wxyz",
        fps=rate,
        time=members.floats("time", ndim=1) if "time" in members else None,
    )
