"""An articulated tree and its batched kinematics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from physretarget.kinematics.rotations import (
    Floats,
    normalized,
    quat_conjugate,
    quat_multiply,
    quat_normalized,
    quat_to_rotvec,
    rotvec_to_quat,
)

Ints = NDArray[np.int64]
JointKind = Literal["free", "ball", "hinge", "slide"]

_QPOS = {"free": 7, "ball": 4, "hinge": 1, "slide": 1}
_DOFS = {"free": 6, "ball": 3, "hinge": 1, "slide": 1}
_FRAMES = 1024


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


@dataclass(frozen=True, eq=False)
class Pose:
    """World positions (T, nb, 3) and rotation matrices (T, nb, 3, 3) of all bodies."""

    position: Floats
    rotation: Floats


def forward(tree: Tree, qpos: Floats) -> Pose:
    """Place every body of ``tree`` for each row of ``qpos`` (T, nq)."""
    tables, frames = tree.tables, len(qpos)
    quat = np.repeat(quat_normalized(tree.rotation).T[:, :, None], frames, axis=2)
    place = np.repeat(tree.offset.T[:, :, None], frames, axis=2)
    quat[:, 0], place[:, 0] = np.array([[1.0], [0.0], [0.0], [0.0]]), 0.0  # the world
    after, at = _joint_frames(tree, qpos)
    last = np.unique(tables.last)
    quat[:, tables.body[last]], place[:, tables.body[last]] = after[:, last], at[:, last]
    for bodies in tree.levels:
        quat[:, bodies] = _products(quat[:, tree.parent[bodies]], quat[:, bodies])
    rotation = _matrices(quat)
    position = _turned(rotation[:, :, tree.parent], place)
    for bodies in tree.levels:
        position[:, bodies] += position[:, tree.parent[bodies]]
    return Pose(position.transpose(2, 1, 0), rotation.transpose(3, 2, 0, 1))


def points(pose: Pose, body: Ints | Sequence[int], local: Floats) -> Floats:
    """World positions (T, K, 3) of points fixed at ``local`` (K, 3) in bodies ``body`` (K,)."""
    index = np.asarray(body, dtype=np.int64)
    turned = np.matmul(pose.rotation[:, index], local[..., None])[..., 0]
    placed: Floats = pose.position[:, index] + turned
    return placed


def trajectories(tree: Tree, qpos: Floats, body: Ints | Sequence[int], local: Floats) -> Floats:
    """World positions (T, K, 3) of points fixed at ``local`` (K, 3) in bodies, in poses (T, nq).

    :func:`points` of :func:`forward`, some frames at a time: poses of all bodies take more memory
    than a long clip itself.
    """
    found = np.empty((len(qpos), len(body), 3))
    for at in range(0, len(qpos), _FRAMES):
        part = slice(at, at + _FRAMES)
        found[part] = points(forward(tree, qpos[part]), body, local)
    return found


def screws(tree: Tree, pose: Pose, qpos: Floats) -> tuple[Floats, Floats, Floats]:
    """How each degree of freedom moves the bodies that it carries.

    Returns, each (T, nv, 3) in the world: the angular velocity, a point on its axis, and the
    linear velocity of that point. A carried point ``p`` moves at
    ``linear + angular × (p - anchor)``.
    """
    tables = tree.tables
    after, place = _joint_frames(tree, qpos)
    # A quaternion's rates are about the axes of the body as all of its joints leave it.
    seen = after.copy()
    seen[:, tables.quats] = after[:, tables.last[tables.quats]]
    up = tree.parent[tables.body]
    carrier = pose.rotation.transpose(2, 3, 1, 0)[:, :, up]
    pivot = place + _turned(_matrices(after), tables.anchor.T[:, :, None])
    pivot = pose.position.transpose(2, 1, 0)[:, up] + _turned(carrier, pivot)
    joint = tables.dof_joint
    axis = _turned(_matrices(seen)[:, :, joint], tables.dof_axis.T[:, :, None])
    axis = _turned(carrier[:, :, joint], axis)
    for i in tables.frees:  # which moves along the axes of the world
        first = tree.joints[i].dof
        axis[:, first : first + 3] = np.eye(3)[:, :, None]
    turns = tables.dof_turns[:, None]
    angular, anchor, linear = turns * axis, turns * pivot[:, joint], (1.0 - turns) * axis
    return angular.transpose(2, 1, 0), anchor.transpose(2, 1, 0), linear.transpose(2, 1, 0)


def jacobian(
    tree: Tree, pose: Pose, qpos: Floats, body: Ints | Sequence[int], local: Floats
) -> Floats:
    """Derivatives (T, 3K, nv) of ``points(pose, body, local)`` by each degree of freedom.

    ``pose`` must be ``forward(tree, qpos)``. Twin of MuJoCo's ``mj_jac``.
    """
    index = np.asarray(body, dtype=np.int64)
    angular, anchor, linear = screws(tree, pose, qpos)
    at = points(pose, index, local)
    arm = at[:, :, None] - anchor[:, None]
    velocity = linear[:, None] + np.cross(angular[:, None], arm)
    velocity *= tree.carries[np.ix_(tree.dof_body, index)].T[None, :, :, None]
    return np.swapaxes(velocity, 2, 3).reshape(len(qpos), 3 * len(index), tree.nv)


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


# Below, components come first and frames last, (4, n, T), which NumPy runs through fastest.


def _joint_frames(tree: Tree, qpos: Floats) -> tuple[Floats, Floats]:
    """Where each joint leaves its body, in the parent's frame, before the body's next joint.

    Quaternions (4, nj, T) and positions (3, nj, T).
    """
    tables = tree.tables
    turn, slide = _joint_motions(tree, qpos)
    after, place = np.empty_like(turn), np.empty_like(slide)
    for k, joints in enumerate(tree.rounds):
        if k:
            before, place[:, joints] = after[:, joints - 1], place[:, joints - 1]
        else:
            body = tables.body[joints]
            before = quat_normalized(tree.rotation[body]).T[:, :, None]
            place[:, joints] = tree.offset[body].T[:, :, None]
        after[:, joints] = _products(before, turn[:, joints])
        some = tables.shifts[joints]
        if some.any():  # seldom: then the anchor stays where the slide takes it
            moved = joints[some]
            anchor = tables.anchor[moved].T[:, :, None]
            place[:, moved] += _turned(_matrices(before[:, some]), anchor + slide[:, moved])
            place[:, moved] -= _turned(_matrices(after[:, moved]), anchor)
    for i in tables.frees:  # says itself where its body is in the world
        at = tables.at[i]
        after[:, i], place[:, i] = turn[:, i], qpos[:, at : at + 3].T
    return after, place


def _joint_motions(tree: Tree, qpos: Floats) -> tuple[Floats, Floats]:
    """What each joint turns, (4, nj, T), and slides, (3, nj, T), by itself."""
    tables = tree.tables
    value = (qpos[:, tables.at] - tables.reference).T
    turn, slide = np.zeros((4, *value.shape)), np.zeros((3, *value.shape))
    turn[0] = 1.0
    half, axis = 0.5 * value[tables.hinges], normalized(tables.axis[tables.hinges])
    turn[0, tables.hinges] = np.cos(half)
    turn[1:, tables.hinges] = np.sin(half) * axis.T[:, :, None]
    turn[:, tables.quats] = quat_normalized(qpos[:, tree.quats[0]]).transpose(2, 1, 0)
    slide[:, tables.slides] = value[tables.slides] * tables.axis[tables.slides].T[:, :, None]
    return turn, slide


def _products(left: Floats, right: Floats) -> Floats:
    """Hamilton products of quaternions (4, n, T)."""
    every = (left[:, None] * right).reshape(16, -1)
    product: Floats = (_PRODUCT @ every).reshape(right.shape)
    return product


def _matrices(quat: Floats) -> Floats:
    """Rotation matrices (3, 3, n, T) of unit quaternions (4, n, T)."""
    every = (quat[:, None] * quat).reshape(16, -1)
    matrix: Floats = (_MATRIX @ every).reshape(3, 3, *quat.shape[1:])
    return matrix


def _turned(matrix: Floats, vector: Floats) -> Floats:
    """Vectors (3, n, T) turned by matrices (3, 3, n, T)."""
    turned: Floats = matrix[:, 0] * vector[0] + matrix[:, 1] * vector[1] + matrix[:, 2] * vector[2]
    return turned


def _product_table() -> Floats:
    """(4, 16): the components of a product from the products of all components."""
    unit = np.eye(4)
    return quat_multiply(unit[:, None], unit).reshape(16, 4).T


def _matrix_table() -> Floats:
    """(9, 16): a unit quaternion's matrix from the products of its components.

    A vector v turns into the vector part of ``q v q*``.
    """
    unit = np.eye(4)
    turned = quat_multiply(
        quat_multiply(unit[:, None, None], unit[1:]), quat_conjugate(unit)[None, :, None]
    )
    # turned[i, j, k]: the share of q_i q_j in what becomes of the axis k, a column.
    return turned[..., 1:].transpose(3, 2, 0, 1).reshape(9, 16)


_PRODUCT = _product_table()
_MATRIX = _matrix_table()
