"""Where the bodies of a tree are, and how each degree of freedom moves them, in whole batches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from physretarget.kinematics.rotations import (
    Floats,
    normalized,
    quat_conjugate,
    quat_multiply,
    quat_normalized,
)
from physretarget.kinematics.tree import Ints, Tree

_FRAMES = 1024
"""Poses of so many frames at a time are kept in memory."""


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


def rises(tree: Tree, pose: Pose, qpos: Floats, frame: Ints, body: Ints, local: Floats) -> Floats:
    """(N, nv) by how much each degree of freedom raises the points ``local`` (N, 3) of bodies
    (N,) in frames (N,): rows of their Jacobians. ``pose`` must be ``forward(tree, qpos)``."""
    some, place = np.unique(frame, return_inverse=True)
    part = Pose(pose.position[some], pose.rotation[some])
    angular, anchor, linear = (each[place] for each in screws(tree, part, qpos[some]))
    at = pose.position[frame, body] + (pose.rotation[frame, body] @ local[..., None])[..., 0]
    arm = at[:, None] - anchor
    up = linear[..., 2] + angular[..., 0] * arm[..., 1] - angular[..., 1] * arm[..., 0]
    return np.asarray(up * tree.carries[tree.dof_body][:, body].T)
