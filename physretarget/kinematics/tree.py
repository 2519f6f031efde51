"""An articulated tree: bodies, joints, and the vectors of their values and rates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from physretarget.kinematics.rotations import (
    Floats,
    quat_conjugate,
    quat_multiply,
    quat_normalized,
    quat_to_rotvec,
    rotvec_slope,
    rotvec_to_quat,
)

Ints = NDArray[np.int64]
JointKind = Literal["free", "ball", "hinge", "slide"]

_QPOS = {"free": 7, "ball": 4, "hinge": 1, "slide": 1}
_DOFS = {"free": 6, "ball": 3, "hinge": 1, "slide": 1}


@dataclass(frozen=True, eq=False)
class Joint:
    """One joint of a body, in MuJoCo's terms.

    ``qpos`` and ``dof`` are the first addresses in qpos and in the velocity vector; ``axis``
    (3,) is a unit vector and ``anchor`` (3,) a point, both in the body's frame; ``reference``
    is the value of qpos at which a hinge or slide displaces nothing.
    """

    kind: JointKind
    body: int
    qpos: int
    dof: int
    axis: Floats
    anchor: Floats
    reference: float = 0.0


@dataclass(frozen=True, eq=False)
class JointTables:
    """Joints as arrays, so that all of one kind are computed at once.

    ``hinges``, ``slides``, ``quats`` and ``frees`` index the joints that turn about an axis,
    slide along one, turn by a quaternion (free joints do) and are free. Of all joints: ``body``
    (nj,), ``last`` (nj,) the last joint of the same body, ``at`` (nj,) the address in qpos,
    ``reference`` (nj,), ``axis`` and ``anchor`` (nj, 3), ``shifts`` (nj,) whether it moves its
    body's origin along. For each degree of freedom:
    ``dof_joint`` (nv,), ``dof_axis`` (nv, 3) in the body's frame and ``dof_turns`` (nv,), 1 if
    it turns about that axis, 0 if it moves along it.
    """

    hinges: Ints
    slides: Ints
    quats: Ints
    frees: Ints
    body: Ints
    last: Ints
    at: Ints
    reference: Floats
    axis: Floats
    anchor: Floats
    shifts: NDArray[np.bool_]
    dof_joint: Ints
    dof_axis: Floats
    dof_turns: Floats


def _joint_tables(joints: Sequence[Joint]) -> JointTables:
    kinds = np.array([joint.kind for joint in joints], dtype="U5")
    body = np.array([joint.body for joint in joints], dtype=np.int64)
    axes = {"free": np.tile(np.eye(3), (2, 1)), "ball": np.eye(3)}
    turns = {"free": [0, 0, 0, 1, 1, 1], "ball": [1, 1, 1], "hinge": [1], "slide": [0]}
    dof_axis = [axes.get(joint.kind, joint.axis[None]) for joint in joints]
    return JointTables(
        hinges=np.flatnonzero(kinds == "hinge"),
        slides=np.flatnonzero(kinds == "slide"),
        quats=np.flatnonzero((kinds == "free") | (kinds == "ball")),
        frees=np.flatnonzero(kinds == "free"),
        body=body,
        last=np.searchsorted(body, body, side="right") - 1,
        at=np.array([joint.qpos for joint in joints], dtype=np.int64),
        reference=np.array([joint.reference for joint in joints]),
        axis=np.array([joint.axis for joint in joints]).reshape(-1, 3),
        anchor=np.array([joint.anchor for joint in joints]).reshape(-1, 3),
        shifts=np.array(
            [joint.kind == "slide" or bool(joint.anchor.any()) for joint in joints], dtype=bool
        ),
        dof_joint=np.repeat(np.arange(len(joints)), [_DOFS[joint.kind] for joint in joints]),
        dof_axis=np.concatenate([np.zeros((0, 3)), *dof_axis]),
        dof_turns=np.concatenate([np.zeros(0), *(turns[joint.kind] for joint in joints)]),
    )


@dataclass(frozen=True, eq=False)
class Tree:
    """Bodies and joints; body 0 is the world and parents come before their children.

    ``offset`` (nb, 3) and ``rotation`` (nb, 4) place each body in its parent's frame at
    zero. ``joints`` are ordered by body and, within a body, as they are applied.
    """

    parent: Ints
    offset: Floats
    rotation: Floats
    joints: tuple[Joint, ...]

    @property
    def nb(self) -> int:
        """The number of bodies, the world included."""
        return len(self.parent)

    @cached_property
    def nq(self) -> int:
        """The length of qpos."""
        return sum(_QPOS[joint.kind] for joint in self.joints)

    @cached_property
    def nv(self) -> int:
        """The number of degrees of freedom."""
        return sum(_DOFS[joint.kind] for joint in self.joints)

    @cached_property
    def joints_of(self) -> tuple[tuple[Joint, ...], ...]:
        """The joints of each body, in order."""
        return tuple(tuple(j for j in self.joints if j.body == b) for b in range(self.nb))

    @cached_property
    def tables(self) -> JointTables:
        """The joints as arrays."""
        return _joint_tables(self.joints)

    @cached_property
    def rounds(self) -> tuple[Ints, ...]:
        """Indices of the first joints of all bodies, then of the second ones, and so on."""
        body = self.tables.body
        place = np.arange(len(body)) - np.searchsorted(body, body)
        return tuple(np.flatnonzero(place == k) for k in range(place.max(initial=-1) + 1))

    @cached_property
    def levels(self) -> tuple[Ints, ...]:
        """Bodies by the number of their ancestors: all of one level are placed at once."""
        depth = self.carries.sum(axis=0)
        return tuple(np.flatnonzero(depth == k) for k in range(2, depth.max() + 1))

    @cached_property
    def carries(self) -> NDArray[np.bool_]:
        """(nb, nb): whether body ``i`` is body ``j`` itself or one of its ancestors."""
        table = np.eye(self.nb, dtype=bool)
        for body in range(1, self.nb):
            table[:, body] |= table[:, self.parent[body]]
        return table

    @cached_property
    def dof_body(self) -> Ints:
        """(nv,): the body that each degree of freedom moves."""
        body = np.zeros(self.nv, dtype=np.int64)
        for joint in self.joints:
            body[joint.dof : joint.dof + _DOFS[joint.kind]] = joint.body
        return body

    @cached_property
    def scalars(self) -> tuple[Ints, Ints]:
        """Addresses in qpos and in the velocity vector of all that simply adds up."""
        pairs = []
        for joint in self.joints:
            count = {"free": 3, "ball": 0, "hinge": 1, "slide": 1}[joint.kind]
            pairs += [(joint.qpos + i, joint.dof + i) for i in range(count)]
        table = np.array(pairs, dtype=np.int64).reshape(-1, 2)
        return table[:, 0], table[:, 1]

    @cached_property
    def quats(self) -> tuple[Ints, Ints]:
        """Addresses (n, 4) in qpos and (n, 3) in the velocity vector of every quaternion."""
        shift = {"free": 3, "ball": 0}
        first = [
            (joint.qpos + shift[joint.kind], joint.dof + shift[joint.kind])
            for joint in self.joints
            if joint.kind in shift
        ]
        table = np.array(first, dtype=np.int64).reshape(-1, 2)
        return table[:, :1] + np.arange(4), table[:, 1:] + np.arange(3)

    def neutral(self) -> Floats:
        """qpos (nq,) with every joint at zero displacement; a free joint at its body's offset."""
        qpos = np.zeros(self.nq)
        qpos[self.quats[0][:, 0]] = 1.0
        for joint in self.joints:
            if joint.kind == "free":
                qpos[joint.qpos : joint.qpos + 3] = self.offset[joint.body]
                qpos[joint.qpos + 3 : joint.qpos + 7] = self.rotation[joint.body]
            elif joint.kind != "ball":
                qpos[joint.qpos] = joint.reference
        return qpos


def integrate(tree: Tree, qpos: Floats, step: Floats) -> Floats:
    """Move ``qpos`` (T, nq) along ``step`` (T, nv). Twin of MuJoCo's ``mj_integratePos``."""
    moved = np.array(qpos)
    at, dof = tree.scalars
    moved[:, at] += step[:, dof]
    at, dof = tree.quats
    moved[:, at] = quat_multiply(quat_normalized(qpos[:, at]), rotvec_to_quat(step[:, dof]))
    return moved


def difference(tree: Tree, start: Floats, end: Floats) -> Floats:
    """The step (T, nv) from ``start`` to ``end`` (T, nq), twin of ``mj_differentiatePos``."""
    step = np.empty((max(len(start), len(end)), tree.nv))
    at, dof = tree.scalars
    step[:, dof] = end[:, at] - start[:, at]
    at, dof = tree.quats
    turn = quat_multiply(quat_conjugate(quat_normalized(start[:, at])), quat_normalized(end[:, at]))
    step[:, dof] = quat_to_rotvec(turn)
    return step


@dataclass(frozen=True, eq=False)
class StepSlopes:
    """Derivative (T, nv, nv) of a step by a further step, all but blocks of three ±1.

    ``sign`` of the plain degrees of freedom; ``dofs`` (n, 3) of the quaternions, with their
    ``blocks`` (T, n, 3, 3).
    """

    sign: float
    dofs: Ints
    blocks: Floats

    def times(self, rows: Floats) -> Floats:
        """Rows (T, k, nv) times the derivative."""
        product = self.sign * rows
        for i, dofs in enumerate(self.dofs):
            product[..., dofs] = rows[..., dofs] @ self.blocks[:, i]
        return product


def difference_slopes(tree: Tree, start: Floats, end: Floats) -> tuple[StepSlopes, StepSlopes]:
    """Derivatives of ``difference(tree, start, end)`` by steps of ``start`` and of ``end``."""
    at, dofs = tree.quats
    turn = quat_multiply(quat_conjugate(quat_normalized(start[:, at])), quat_normalized(end[:, at]))
    blocks = rotvec_slope(quat_to_rotvec(turn))
    return StepSlopes(-1.0, dofs, -blocks.swapaxes(-1, -2)), StepSlopes(1.0, dofs, blocks)
