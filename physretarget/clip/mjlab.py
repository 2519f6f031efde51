"""mjlab's and BeyondMimic's npz: fps, joint_pos, body_pos_w, body_quat_w; holosoma's export.

mjlab orders joints and bodies as the model does; Isaac Lab (BeyondMimic's original) orders
them breadth-first. Files seldom say which. With the model at hand the body positions in the
file decide: forward kinematics under the right order reproduces them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.archives.arrays import Frames, Members
from physretarget.clip.core import Floats
from physretarget.clip.raw import Layout, Raw, Told, rows_of
from physretarget.clip.scratch import Rows
from physretarget.errors import InputError
from physretarget.kinematics.order import breadth_first, breadth_first_bodies
from physretarget.options.motion import JointOrder

# Files are float32 and models differ by rounding; the wrong order is off by centimetres.
_AGREE = 2e-3
_PROBED_FRAMES = 32


def read(members: Members, *, sha256: str, character: Layout | None, told: Told) -> Raw:
    """Read root and joints; settle the joint order by name, by word or by kinematics."""
    path = members.path
    joints = members.frames("joint_pos", ndim=2)
    names = members.strings("joint_names") if "joint_names" in members else None
    notes: list[str] = []
    if "body_pos_w" not in members or "body_quat_w" not in members:
        raise InputError("a motion npz needs body_pos_w and body_quat_w for its root.", path=path)
    bodies = members.frames("body_pos_w", ndim=3)
    rotations = members.frames("body_quat_w", ndim=3)
    _check_shapes(joints.shape, bodies.shape, rotations.shape, path)
    columns = None
    if names is not None and joints.shape[1] == len(names) + 7:
        rows = rows_of(joints)  # holosoma exports the whole qpos under this name
    else:
        root = _root_index(members, bodies.shape[1], path)
        rows = rows_of(_body(bodies, root), _body(rotations, root), joints)
        if names is None and character is not None and rows.width == character.tree.nq:
            columns = _order(rows, bodies, character, told, path, notes)
    if columns is not None:
        rows = Rows((part[:, columns] for _, part in rows.parts()), rows.width)
    return Raw(
        format="mjlab npz", path=path, sha256=sha256, rows=rows, joints=names, order="wxyz",
        fps=members.scalar("fps") if "fps" in members else None, notes=tuple(notes),
    )  # fmt: skip


def _check_shapes(
    joints: tuple[int, ...], bodies: tuple[int, ...], rotations: tuple[int, ...], path: str
) -> None:
    fits = bodies[:2] == rotations[:2] and bodies[0] == joints[0] and bodies[1] > 0
    if not fits or bodies[2] != 3 or rotations[2] != 4:
        raise InputError(
            f"joint_pos {joints}, body_pos_w {bodies} and body_quat_w {rotations} do not belong "
            "together: (T, n), (T, bodies, 3) and (T, bodies, 4) are needed.",
            path=path,
        )


def _body(array: Frames, body: int) -> Frames:
    """(T, n) of one body out of (T, bodies, n)."""
    return Frames(
        (array.shape[0], array.shape[2]), lambda: (part[:, body] for part in array.parts())
    )


def _root_index(members: Members, bodies: int, path: str) -> int:
    names = members.strings("body_names") if "body_names" in members else ()
    root = 1 if names[:1] == ("world",) else 0
    if root >= bodies:
        raise InputError("the file has no body but the world.", path=path)
    return root


def _order(
    rows: Rows, bodies: Frames, character: Layout, told: Told, path: str, notes: list[str]
) -> NDArray[np.int64] | None:
    """For each coordinate of the model, the file's column; None where they are as in the model."""
    tree = character.tree
    orders: dict[JointOrder, NDArray[np.int64]] = {
        "model": np.arange(tree.nq),
        "breadth-first": breadth_first(tree),
    }
    if told.joint_order is not None:
        notes.append(f"Joint order {told.joint_order} as told.")
        return orders[told.joint_order]
    if (orders["model"] == orders["breadth-first"]).all():
        return None
    wanted = np.unique(np.linspace(0, len(rows) - 1, _PROBED_FRAMES).astype(int))
    qpos = np.concatenate([rows.between(t, t + 1) for t in wanted])
    probed = _picked(bodies, wanted)
    fits = {name: _misfit(qpos[:, o], probed, tree) for name, o in orders.items()}
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
    _note_bodies(qpos[:, orders[best]], probed, tree, notes)
    return orders[best]


def _note_bodies(qpos: Floats, bodies: Floats, tree: kinematics.Tree, notes: list[str]) -> None:
    """Say so where the file's bodies are in breadth-first order: nothing but the root is read of
    them, and who takes them for the model's order has every limb elsewhere."""
    ours = kinematics.forward(tree, qpos).position
    level = breadth_first_bodies(tree)
    first = tree.nb - bodies.shape[1]  # 1 where the world is left out
    if first not in (0, 1) or (level == np.arange(tree.nb)).all():
        return
    apart = {
        name: float(np.linalg.norm(bodies - ours[:, order[first:]], axis=-1).max())
        for name, order in (("model", np.arange(tree.nb)), ("breadth-first", level))
    }
    if apart["breadth-first"] <= _AGREE < apart["model"]:
        notes.append(
            "Its bodies are in breadth-first order, not in the model's (by body positions, up to "
            f"{apart['model'] * 1000:.0f} mm apart)."
        )
    elif min(apart.values()) > _AGREE:
        notes.append(
            "Its bodies are in neither the model's order nor a breadth-first one: their positions "
            f"lie up to {min(apart.values()) * 1000:.0f} mm from the bodies of that number."
        )


def _picked(array: Frames, wanted: NDArray[np.int64]) -> Floats:
    """The wanted frames of an array."""
    found, first = [], 0
    for part in array.parts():
        mine = wanted[(wanted >= first) & (wanted < first + len(part))]
        found.append(part[mine - first])
        first += len(part)
    return np.concatenate(found)


def _misfit(qpos: Floats, bodies: Floats, tree: kinematics.Tree) -> float:
    """Worst distance (m) of a body in the file to the nearest body of the model."""
    if not np.isfinite(qpos).all() or not np.isfinite(bodies).all():
        return float("inf")
    ours = kinematics.forward(tree, qpos).position
    apart = np.linalg.norm(bodies[:, :, None] - ours[:, None], axis=-1)
    return float(apart.min(axis=2).max())
