"""mjlab's and BeyondMimic's npz: fps, joint_pos, body_pos_w, body_quat_w; holosoma's export.

mjlab orders joints and bodies as the model does; Isaac Lab (BeyondMimic's original) orders
them breadth-first. Files seldom say which. With the model at hand the body positions in the
file decide: forward kinematics under the right order reproduces them.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.clip.arrays import Members
from physretarget.clip.core import Floats
from physretarget.clip.raw import JointOrder, Layout, Raw, Told
from physretarget.errors import InputError

# Files are float32 and models differ by rounding; the wrong order is off by centimetres.
_AGREE = 2e-3
_PROBED_FRAMES = 32


def read(members: Members, *, sha256: str, character: Layout | None, told: Told) -> Raw:
    """Read root and joints; settle the joint order by name, by word or by kinematics."""
    path = members.path
    joints = members.floats("joint_pos", ndim=2)
    names = members.strings("joint_names") if "joint_names" in members else None
    notes: list[str] = []
    if "body_pos_w" not in members or "body_quat_w" not in members:
        raise InputError("a motion npz needs body_pos_w and body_quat_w for its root.", path=path)
    bodies = members.floats("body_pos_w", ndim=3)
    rotations = members.floats("body_quat_w", ndim=3)
    if not (bodies.shape[:2] == rotations.shape[:2] and len(bodies) == len(joints)):
        raise InputError(
            f"joint_pos {joints.shape}, body_pos_w {bodies.shape} and body_quat_w "
            f"{rotations.shape} do not belong together.",
            path=path,
        )
    if names is not None and joints.shape[1] == len(names) + 7:
        values = joints  # holosoma exports the whole qpos under this name
    else:
        root = _root_index(members)
        values = np.concatenate([bodies[:, root], rotations[:, root], joints], axis=1)
        if names is None and character is not None:
            values = _ordered(values, bodies, character, told, path, notes)
    return Raw(
        format="mjlab npz", path=path, sha256=sha256, values=values, joints=names, order="wxyz",
        fps=members.scalar("fps") if "fps" in members else None, notes=tuple(notes),
    )  # fmt: skip


def _root_index(members: Members) -> int:
    names = members.strings("body_names") if "body_names" in members else ()
    return 1 if names[:1] == ("world",) else 0


def _ordered(
    values: Floats, bodies: Floats, character: Layout, told: Told, path: str, notes: list[str]
) -> Floats:
    tree = character.tree
    if values.shape[1] != tree.nq:
        return values  # the mismatch is reported with both numbers later
    orders: dict[JointOrder, NDArray[np.int64]] = {
        "model": np.arange(tree.nq),
        "breadth-first": _breadth_first(tree),
    }
    if told.joint_order is not None:
        notes.append(f"Joint order {told.joint_order} as told.")
        return values[:, orders[told.joint_order]]
    if (orders["model"] == orders["breadth-first"]).all():
        return values
    fits = {name: _misfit(values[:, o], bodies, tree) for name, o in orders.items()}
    best = min(fits, key=lambda name: fits[name])
    if fits[best] > _AGREE or sum(v <= _AGREE for v in fits.values()) != 1:
        listed = ", ".join(f"{name} {v * 1000:.1f} mm" for name, v in fits.items())
        raise InputError(
            "the file names no joints and its body positions do not settle their order "
            f"(worst body against the model's kinematics: {listed}): "
            "give the joint order, model or breadth-first.",
            path=path,
        )
    notes.append(
        f"Joint order {best} was found by comparing body positions with the model's kinematics "
        f"(worst {fits[best] * 1000:.2f} mm)."
    )
    return values[:, orders[best]]


def _breadth_first(tree: kinematics.Tree) -> NDArray[np.int64]:
    """For each qpos coordinate of the model, its column in a breadth-first file."""
    children: dict[int, list[int]] = {}
    for body in range(1, tree.nb):
        children.setdefault(int(tree.parent[body]), []).append(body)
    visited, queue = [], deque([0])
    while queue:
        body = queue.popleft()
        visited.append(body)
        queue.extend(children.get(body, []))
    width = {"free": 7, "ball": 4, "hinge": 1, "slide": 1}
    addresses = [
        joint.qpos + i
        for body in visited
        for joint in tree.joints_of[body]
        for i in range(width[joint.kind])
    ]
    columns = np.empty(tree.nq, dtype=np.int64)
    columns[addresses] = np.arange(tree.nq)
    return columns


def _misfit(qpos: Floats, bodies: Floats, tree: kinematics.Tree) -> float:
    """Worst distance (m) of a body in the file to the nearest body of the model."""
    frames = np.unique(np.linspace(0, len(qpos) - 1, _PROBED_FRAMES).astype(int))
    if not np.isfinite(qpos[frames]).all() or not np.isfinite(bodies[frames]).all():
        return float("inf")
    ours = kinematics.forward(tree, qpos[frames]).position
    apart = np.linalg.norm(bodies[frames][:, :, None] - ours[:, None], axis=-1)
    return float(apart.min(axis=2).max())
