"""LocoMuJoCo's trajectory npz: qpos, qvel, frequency, joint_names, split_points.

Its first datasets have one array for each joint instead, named ``q_JOINT``, at 500 Hz cut to 100.
"""

from __future__ import annotations

import numpy as np

from physretarget.archives.arrays import Frames, Members, as_floats
from physretarget.clip.raw import Raw, rows_of
from physretarget.errors import InputError


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


def read_columns(members: Members, *, sha256: str) -> Raw:
    """Read a dataset of one array for each joint; the joints are put in order by their names.

    Args:
        members: The arrays of the npz.
        sha256: The file's hash.

    Raises:
        InputError: The arrays differ in length, or one is no column.
    """
    names = [name for name in members if name.startswith("q_")]
    columns = []
    for name in names:
        array = np.asarray(members[name])
        columns.append(as_floats(array.reshape(len(array), -1) if array.ndim else array,
                                 name=name, ndim=2, path=members.path))  # fmt: skip
    lengths = {len(column) for column in columns}
    if len(lengths) != 1:
        raise InputError(
            f"the arrays {', '.join(names[:4])} … have {len(lengths)} different lengths.",
            path=members.path,
        )
    rate = next((members.scalar(n) for n in ("frequency", "fps") if n in members), None)
    return Raw(
        format="LocoMuJoCo npz",
        path=members.path,
        sha256=sha256,
        rows=rows_of(*(Frames.of(column) for column in columns)),
        joints=tuple(name.removeprefix("q_") for name in names),
        rooted=False,
        order="wxyz",
        fps=rate,
    )
