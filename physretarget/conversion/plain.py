"""csv and npy: numbers and nothing else."""

from __future__ import annotations

import io

import numpy as np

from physretarget.clip import Clip
from physretarget.errors import UsageError
from physretarget.mjcf import Character

ROOT = ("root_x", "root_y", "root_z")


def npy_bytes(clip: Clip) -> bytes:
    """The qpos array, quaternions wxyz."""
    content = io.BytesIO()
    np.lib.format.write_array(
        content, np.ascontiguousarray(clip.qpos, dtype="<f8"), version=(1, 0), allow_pickle=False
    )
    return content.getvalue()


def csv_text(clip: Clip, character: Character | None, *, to_quat: str, header: bool) -> str:
    """Rows as in the retargeted LAFAN1 files; every number comes back exactly as it was.

    Raises:
        UsageError: the quaternion order is unknown, or the clip has no free joint at its root
            or ball joints after it, for which such files have no place.
    """
    if to_quat not in ("wxyz", "xyzw"):
        raise UsageError(f"quaternion order {to_quat!r} was given: use wxyz or xyzw.")
    names = _joints(clip, character)
    columns = list(range(clip.qpos.shape[1]))
    if to_quat == "xyzw":
        columns[3:7] = [4, 5, 6, 3]
    values = clip.qpos[:, columns]
    lines = []
    if header:
        values = np.column_stack([clip.time, values])
        lines.append(",".join(["time_s", *ROOT, *(f"root_q{c}" for c in to_quat), *names]))
    lines += [",".join(repr(float(v)) for v in row) for row in values]
    return "\n".join(lines) + "\n"


def _joints(clip: Clip, character: Character | None) -> tuple[str, ...]:
    """Names of the joints behind the root, one column each."""
    if character is not None:
        kinds = [joint.kind for joint in character.tree.joints]
        fits = kinds[:1] == ["free"] and not {"free", "ball"} & set(kinds[1:])
        names = character.joint_names[1:]
    else:
        names = clip.joint_names[1:] or tuple(f"joint_{i}" for i in range(clip.qpos.shape[1] - 7))
        fits = clip.qpos.shape[1] == 7 + len(names)
    if not fits:
        raise UsageError(
            "A csv holds a free root and joints of one coordinate each; this clip has others: "
            "write npz, bvh or glb."
        )
    return names
