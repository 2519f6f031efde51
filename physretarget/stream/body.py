"""One pose at a time: places of points, and inverse kinematics within microseconds.

The batched kinematics take a millisecond for a single frame. Here MuJoCo does the work, by a
trick: give every body the mass distribution of its targets' weights, as point masses. Then the
joint-space inertia matrix of that model is JᵀWJ, the joint forces of the pulls w (target - point)
are JᵀW (target - point), and the acceleration that MuJoCo finds from the two is the Gauss-Newton
step; armature is damping, and infinite armature a locked joint.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from physretarget.mjcf import Character, Points
from physretarget.stream.turns import Quat, matrix_quat

__all__ = ["Body", "Solver"]

Array = NDArray[np.float64]

LOCKED = 1e12
"""Armature of a degree of freedom that must not move."""
HELD = 1e-6
"""Armature of all others, as the batch path holds what no marker determines."""
_CROSS = np.zeros((9, 3))
_CROSS[[5, 6, 1], [0, 1, 2]], _CROSS[[7, 2, 3], [0, 1, 2]] = 1.0, -1.0
"""Takes a matrix a tᵀ, row by row, to a × t."""


class Body:
    """Where a model's bodies and points are in one pose."""

    def __init__(self, character: Character) -> None:
        self.character = character
        self.model = _bare(character.model)
        self.data = mujoco.MjData(self.model)
        self.root = character.root_body
        # Views into the data: asking it for them takes longer than most of what is done with them.
        self.qpos: Array = self.data.qpos
        self.place: Array = self.data.xpos
        self.turn: Array = self.data.xmat.reshape(-1, 3, 3)
        self.middle: Array = self.data.subtree_com

    def pose(self, qpos: Array) -> None:
        """Put the bodies where ``qpos`` (nq,) has them."""
        self.qpos[:] = qpos
        mujoco.mj_kinematics(self.model, self.data)

    def points(self, points: Points) -> Array:
        """World places (K, 3) of points in the present pose."""
        result: Array = np.einsum("kij,kj->ki", self.turn[points.body], points.local)
        result += self.place[points.body]
        return result

    def frame(self) -> tuple[Array, Array]:
        """Place (3,) and rotation (3, 3) of the root body."""
        return self.place[self.root], self.turn[self.root]

    def com(self, qpos: Array) -> Array:
        """Centre of mass (3,) of the character in a pose."""
        self.pose(qpos)
        mujoco.mj_comPos(self.model, self.data)
        return np.array(self.middle[self.root])


def _bare(model: mujoco.MjModel) -> mujoco.MjModel:
    """Bodies, joints and masses alone: placing geometry and sites takes most of the time."""
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.compiler.autolimits = False
    spec.compiler.boundmass, spec.compiler.boundinertia = 1e-9, 1e-12
    spec.compiler.balanceinertia = True
    spec.option.disableflags = mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    bodies = [spec.worldbody]
    for i in range(1, model.nbody):
        body = bodies[model.body_parentid[i]].add_body(
            name=f"b{i}",
            pos=model.body_pos[i],
            quat=model.body_quat[i],
            explicitinertial=True,
            mass=max(model.body_mass[i], 1e-9),
            ipos=model.body_ipos[i],
            iquat=model.body_iquat[i],
            inertia=np.maximum(model.body_inertia[i], 1e-12),
        )
        for j in range(model.body_jntadr[i], model.body_jntadr[i] + model.body_jntnum[i]):
            body.add_joint(
                name=f"j{j}",
                type=mujoco.mjtJoint(int(model.jnt_type[j])),
                pos=model.jnt_pos[j],
                axis=model.jnt_axis[j],
                ref=model.qpos0[model.jnt_qposadr[j]] if model.jnt_type[j] > 1 else 0.0,
            )
        bodies.append(body)
    bare = spec.compile()
    assert bare.nq == model.nq
    assert np.array_equal(bare.body_parentid, model.body_parentid)
    return bare


class Solver:
    """Brings points of a character to targets: Gauss-Newton within the joint limits."""

    def __init__(
        self, character: Character, points: Points, *, steps: int, longest: float = np.inf
    ) -> None:
        """``points`` to steer; ``steps`` at most per frame, in which no degree of freedom moves
        farther than ``longest``, rad or m.
        """
        self.longest = longest
        self.character, self.points, self.steps = character, points, steps
        self.body = Body(character)
        model = self.body.model
        model.body_simple[:] = 0
        model.body_sameframe[:] = 0
        model.opt.gravity[:] = 0.0
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
        self.bodies, self.which = np.unique(points.body, return_inverse=True)
        self.own = [np.flatnonzero(self.which == i) for i in range(len(self.bodies))]
        # Rows of weights w, and of w a with a from the centre of the body's weights to the point.
        self.sum = np.zeros((len(self.bodies), len(points)))
        self.lever = np.zeros((len(self.bodies), 3, len(points)))
        self.below = _below(model.body_parentid)
        self.weight = np.zeros(len(points))
        self.mass = np.zeros((len(self.bodies), 1))
        self.masses: dict[tuple[int, bytes], tuple[float, Array, Array, Quat]] = {}
        self.pull: Array = self.body.data.xfrc_applied
        self.centre: Array = self.body.data.xipos
        self.applied: Array = self.body.data.qfrc_applied
        self.found: Array = self.body.data.qacc_smooth
        self.force: Array = self.body.data.qfrc_smooth
        self.stiff: Array = model.dof_armature
        model.body_mass[:] = 0.0  # the character's own masses have no say here
        model.body_inertia[:] = 0.0
        self.weigh(np.ones(len(points)))
        scalars = [
            (joint.qpos, joint.dof)
            for joint in character.tree.joints
            if joint.kind in ("hinge", "slide")
        ]
        self.at = np.array([a for a, _ in scalars], dtype=np.int64)
        self.dof = np.array([d for _, d in scalars], dtype=np.int64)
        self.lower, self.upper = character.lower[self.at], character.upper[self.at]
        self.armature = np.full(model.nv, HELD)
        self.prior: Array | None = None

    def lock(self, dofs: NDArray[np.int64]) -> None:
        """Degrees of freedom that keep their values from now on."""
        self.armature[dofs] = LOCKED

    def weigh(self, weight: Array) -> None:
        """Weights (K,) from now on; bodies whose weights change get other masses."""
        differs = weight != self.weight
        if not differs.any():
            return
        model = self.body.model
        self.weight = np.array(weight, dtype=np.float64)
        for i in sorted(set(self.which[differs].tolist())):
            body, own = self.bodies[i], self.own[i]
            mass, centre, inertia, quat = self._mass(i)
            self.mass[i], self.sum[i, own] = mass, self.weight[own]
            self.lever[i][:, own] = self.weight[own] * (self.points.local[own] - centre).T
            model.body_mass[body], model.body_ipos[body] = mass, centre
            model.body_inertia[body], model.body_iquat[body] = inertia, quat
        model.body_subtreemass[:] = self.below @ model.body_mass

    def _mass(self, i: int) -> tuple[float, Array, Array, Quat]:
        """Mass, centre, principal inertia and axes of the points of one body, as weighed now."""
        w, at = self.weight[self.own[i]], self.points.local[self.own[i]]
        key = (i, w.tobytes())
        if key not in self.masses:
            mass = max(float(w.sum()), 1e-12)
            centre = w @ at / mass
            arm = at - centre
            spread = (arm * w[:, None]).T @ arm
            values, axes = np.linalg.eigh(np.trace(spread) * np.eye(3) - spread)
            if np.linalg.det(axes) < 0:
                axes[:, 0] *= -1.0
            self.masses[key] = mass, centre, np.maximum(values, 0.0), matrix_quat(axes)
        return self.masses[key]

    def hold(self, prior: Array) -> None:
        """Weights (nv,) of staying with the pose ``near`` that :meth:`solve` is given."""
        self.armature[:] = np.maximum(prior, HELD)
        self.prior = np.array(prior)

    def solve(
        self,
        qpos: Array,
        target: Array,
        *,
        near: Array | None = None,
        tolerance: float = 1e-3,
        steps: int | None = None,
    ) -> Array:
        """The pose (nq,) whose points come closest to ``target`` (K, 3), sought from ``qpos`` on.

        ``near`` (nq,) the pose that joints prefer to stay with, if any is held; ``steps`` if not
        the usual number.
        """
        model, data = self.body.model, self.body.data
        qpos = np.array(qpos)
        offset = np.zeros(model.nv)
        drawn = self.sum @ target
        twisted = (self.lever.reshape(-1, len(target)) @ target).reshape(-1, 3, 3)
        for _ in range(steps or self.steps):
            if near is not None and self.prior is not None:
                mujoco.mj_differentiatePos(model, offset, 1.0, near, qpos)
                np.multiply(-self.prior, offset, out=self.applied)
            self.body.pose(qpos)
            mujoco.mj_comPos(model, data)
            self._draw(drawn, twisted)
            step = self._step(qpos)
            size = max(float(step.max()), -float(step.min()), 1e-9)
            if size > self.longest:
                step *= self.longest / size
            mujoco.mj_integratePos(model, qpos, step, 1.0)
            value = qpos[self.at]
            np.maximum(value, self.lower, out=value)
            qpos[self.at] = np.minimum(value, self.upper, out=value)
            if min(size, self.longest) < tolerance:
                break
        return qpos

    def _draw(self, drawn: Array, twisted: Array) -> None:
        """Forces and torques of all pulls on the bodies, about the centres of their weights.

        ``drawn`` (n, 3) is Σ w t of each body's targets t, ``twisted`` (n, 3, 3) is Σ w a tᵀ.
        Of a body at c with rotation R: Σ w (t - c - R a) = Σ w t - m c, since Σ w a = 0, and for
        the same reason Σ w R a × (t - c - R a) = Σ w R a × t.
        """
        pull = np.empty((len(self.bodies), 6))
        np.subtract(drawn, self.mass * self.centre[self.bodies], out=pull[:, :3])
        lever = np.einsum("nij,njk->nik", self.body.turn[self.bodies], twisted).reshape(-1, 9)
        np.matmul(lever, _CROSS, out=pull[:, 3:])
        self.pull[self.bodies] = pull

    def _step(self, qpos: Array) -> Array:
        """The Gauss-Newton step (nv,); joints that would leave their limits stay."""
        model, data = self.body.model, self.body.data
        self.stiff[:] = self.armature
        value = qpos[self.at]
        low, high = value <= self.lower, value >= self.upper
        for again in range(2):
            mujoco.mj_makeM(model, data)
            mujoco.mj_factorM(model, data)
            mujoco.mj_fwdAcceleration(model, data)
            if again or not (low | high).any():
                break
            force = self.force[self.dof]
            stuck = (low & (force < 0)) | (high & (force > 0))
            if not stuck.any():
                break
            self.stiff[self.dof[stuck]] = LOCKED
        return self.found


def _below(parent: NDArray[np.int32]) -> Array:
    """(nb, nb) one where a body is at or below another, whose row it is."""
    below = np.eye(len(parent))
    for body in range(len(parent) - 1, 0, -1):
        below[parent[body]] += below[body]
    return below
