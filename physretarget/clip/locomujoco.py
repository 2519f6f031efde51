"""LocoMuJoCo's trajectory npz: qpos, qvel, frequency, joint_names, split_points."""

from __future__ import annotations

from physretarget.clip.arrays import Members
from physretarget.clip.raw import Raw, rows_of


def read(members: Members, *, sha256: str) -> Raw:
    """Read a LocoMuJoCo trajectory; its qpos is MuJoCo's, so quaternions are wxyz."""
    notes: tuple[str, ...] = ()
    qpos, wanted = members.frames("qpos", ndim=2), None
    if "split_points" in members:
        splits = members["split_points"].ravel()
        if splits.size > 2 and splits.dtype.kind in "iu":
            # Several recordings in a row: a jump between two of them is not a teleport.
            first = max(int(splits[1]), 1)
            notes = (
                f"The file holds {splits.size - 1} trajectories; the first ({first} frames) "
                "is read.",
            )
            wanted = first
    return Raw(
        format="LocoMuJoCo npz",
        path=members.path,
        sha256=sha256,
        rows=rows_of(qpos, frames=wanted),
        joints=members.strings("joint_names") if "joint_names" in members else None,
        order="wxyz",
        fps=members.scalar("frequency"),
        notes=notes,
    )
