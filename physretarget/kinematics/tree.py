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
    quat_to_matrix,
    quat_to_rotvec,
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

    @cached_property
    def cross(self) -> tuple[Floats, Floats]:
        """The matrix (3, 3) of the cross product with the axis, and its square."""
        x, y, z = normalized(self.axis)
        across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        return across, across @ across


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
    frames = len(qpos)
    position = np.zeros((frames, tree.nb, 3))
    rotation = np.zeros((frames, tree.nb, 3, 3))
    rotation[:, 0] = np.eye(3)
    zero = quat_to_matrix(quat_normalized(tree.rotation))
    for body in range(1, tree.nb):
        joints, up = tree.joints_of[body], tree.parent[body]
        if joints and joints[0].kind == "free":
            start = joints[0].qpos
            position[:, body] = qpos[:, start : start + 3]
            rotation[:, body] = quat_to_matrix(quat_normalized(qpos[:, start + 3 : start + 7]))
            continue
        place = position[:, up] + rotation[:, up] @ tree.offset[body]
        turn = rotation[:, up] @ zero[body]
        for joint in joints:
            if joint.kind == "slide":
                shift = qpos[:, joint.qpos, None] - joint.reference
                place = place + shift * (turn @ joint.axis)
                continue
            turned = turn @ _joint_rotation(joint, qpos)
            if joint.anchor.any():
                place = place + (turn - turned) @ joint.anchor
            turn = turned
        position[:, body], rotation[:, body] = place, turn
    return Pose(position, rotation)


def points(pose: Pose, body: Ints | Sequence[int], local: Floats) -> Floats:
    """World positions (T, K, 3) of points fixed at ``local`` (K, 3) in bodies ``body`` (K,)."""
    index = np.asarray(body, dtype=np.int64)
    turned = np.matmul(pose.rotation[:, index], local[..., None])[..., 0]
    placed: Floats = pose.position[:, index] + turned
    return placed


def screws(tree: Tree, pose: Pose, qpos: Floats) -> tuple[Floats, Floats, Floats]:
    """How each degree of freedom moves the bodies that it carries.

    Returns, each (T, nv, 3) in the world: the angular velocity, a point on its axis, and the
    linear velocity of that point. A carried point ``p`` moves at
    ``linear + angular × (p - anchor)``.
    """
    frames = len(qpos)
    angular = np.zeros((frames, tree.nv, 3))
    anchor = np.zeros((frames, tree.nv, 3))
    linear = np.zeros((frames, tree.nv, 3))
    for body, joints in enumerate(tree.joints_of):
        place, turn = pose.position[:, body], pose.rotation[:, body]
        # The pose is the state after all joints of the body: walk back through them.
        for joint in reversed(joints):
            dofs = slice(joint.dof, joint.dof + _DOFS[joint.kind])
            if joint.kind == "slide":
                along = turn @ joint.axis
                linear[:, joint.dof] = along
                place = place - (qpos[:, joint.qpos, None] - joint.reference) * along
                continue
            pivot = place + turn @ joint.anchor if joint.anchor.any() else place
            if joint.kind == "hinge":
                angular[:, joint.dof] = turn @ joint.axis
                anchor[:, joint.dof] = pivot
            else:
                if joint.kind == "free":
                    linear[:, dofs.start : dofs.start + 3] = np.eye(3)
                    dofs = slice(dofs.start + 3, dofs.stop)
                axes = pose.rotation[:, body]
                angular[:, dofs] = np.swapaxes(axes, 1, 2)
                anchor[:, dofs] = pivot[:, None]
            if joint is not joints[0]:
                turn = turn @ np.swapaxes(_joint_rotation(joint, qpos), 1, 2)
                place = pivot - turn @ joint.anchor
    return angular, anchor, linear


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


def _joint_rotation(joint: Joint, qpos: Floats) -> Floats:
    """Rotation matrices (T, 3, 3) of a ball or hinge joint."""
    if joint.kind == "ball":
        return quat_to_matrix(quat_normalized(qpos[:, joint.qpos : joint.qpos + 4]))
    angle = (qpos[:, joint.qpos] - joint.reference)[:, None, None]
    across, twice = joint.cross
    turn: Floats = np.sin(angle) * across + (1.0 - np.cos(angle)) * twice  # Rodrigues
    return turn + np.eye(3)
