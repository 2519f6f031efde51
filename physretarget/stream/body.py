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

__all__ = ["Body", "Solver"]

Array = NDArray[np.float64]

LOCKED = 1e12
"""Armature of a degree of freedom that must not move."""
HELD = 1e-6
"""Armature of all others, as the batch path holds what no marker determines."""


class Body:
    """Where a model's bodies and points are in one pose."""

    def __init__(self, character: Character) -> None:
        self.character = character
        self.model = _bare(character.model)
        self.data = mujoco.MjData(self.model)
        self.root = character.root_body

    def pose(self, qpos: Array) -> None:
        """Put the bodies where ``qpos`` (nq,) has them."""
        self.data.qpos = qpos
        mujoco.mj_kinematics(self.model, self.data)

    def points(self, points: Points) -> Array:
        """World places (K, 3) of points in the present pose."""
        turn = self.data.xmat[points.body].reshape(-1, 3, 3)
        result: Array = np.einsum("kij,kj->ki", turn, points.local)
        result += self.data.xpos[points.body]
        return result

    def frame(self) -> tuple[Array, Array]:
        """Place (3,) and rotation (3, 3) of the root body."""
        return self.data.xpos[self.root], self.data.xmat[self.root].reshape(3, 3)

    def com(self, qpos: Array) -> Array:
        """Centre of mass (3,) of the character in a pose."""
        self.pose(qpos)
        mujoco.mj_comPos(self.model, self.data)
        return np.array(self.data.subtree_com[self.root])


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
        self.sum = np.zeros((len(self.bodies), len(points)))
        self.sum[self.which, np.arange(len(points))] = 1.0
        self.weight = np.zeros(len(points))
        self.masses: dict[tuple[int, bytes], tuple[float, Array, Array, Array]] = {}
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
        model = self.body.model
        changed = np.unique(self.which[weight != self.weight])
        self.weight = np.array(weight, dtype=np.float64)
        if not len(changed):
            return
        if not self.body.data.time:  # the character's own masses have no say here
            model.body_mass[:] = 0.0
            model.body_inertia[:] = 0.0
            self.body.data.time = 1.0
        for i in changed.tolist():
            body = self.bodies[i]
            mass, centre, inertia, quat = self._mass(i)
            model.body_mass[body], model.body_ipos[body] = mass, centre
            model.body_inertia[body], model.body_iquat[body] = inertia, quat
        self._sum_masses(model)

    def _mass(self, i: int) -> tuple[float, Array, Array, Array]:
        """Mass, centre, principal inertia and axes of the points of one body, as weighed now."""
        own = self.which == i
        w, at = self.weight[own], self.points.local[own]
        key = (i, w.tobytes())
        if key not in self.masses:
            mass = max(float(w.sum()), 1e-12)
            centre = w @ at / mass
            arm = at - centre
            spread = (arm * w[:, None]).T @ arm
            values, axes = np.linalg.eigh(np.trace(spread) * np.eye(3) - spread)
            if np.linalg.det(axes) < 0:
                axes[:, 0] *= -1.0
            quat = np.empty(4)
            mujoco.mju_mat2Quat(quat, np.ascontiguousarray(axes).ravel())
            self.masses[key] = mass, centre, np.maximum(values, 0.0), quat
        return self.masses[key]

    @staticmethod
    def _sum_masses(model: mujoco.MjModel) -> None:
        total = np.array(model.body_mass)
        for body in range(model.nbody - 1, 0, -1):
            total[model.body_parentid[body]] += total[body]
        model.body_subtreemass[:] = total

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
        for _ in range(steps or self.steps):
            if near is not None and self.prior is not None:
                mujoco.mj_differentiatePos(model, offset, 1.0, near, qpos)
                data.qfrc_applied = -self.prior * offset
            self.body.pose(qpos)
            mujoco.mj_comPos(model, data)
            place = self.body.points(self.points)
            pull = self.weight[:, None] * (target - place)
            arm = place - data.xipos[self.points.body]
            turn = np.empty_like(pull)
            turn[:, 0] = arm[:, 1] * pull[:, 2] - arm[:, 2] * pull[:, 1]
            turn[:, 1] = arm[:, 2] * pull[:, 0] - arm[:, 0] * pull[:, 2]
            turn[:, 2] = arm[:, 0] * pull[:, 1] - arm[:, 1] * pull[:, 0]
            data.xfrc_applied[self.bodies, :3] = self.sum @ pull
            data.xfrc_applied[self.bodies, 3:] = self.sum @ turn
            step = self._step(qpos)
            step *= min(1.0, self.longest / max(float(np.abs(step).max()), 1e-9))
            mujoco.mj_integratePos(model, qpos, step, 1.0)
            qpos[self.at] = np.minimum(np.maximum(qpos[self.at], self.lower), self.upper)
            if np.abs(step).max() < tolerance:
                break
        return qpos

    def _step(self, qpos: Array) -> Array:
        """The Gauss-Newton step (nv,); joints that would leave their limits stay."""
        model, data = self.body.model, self.body.data
        model.dof_armature[:] = self.armature
        for again in range(2):
            mujoco.mj_makeM(model, data)
            mujoco.mj_factorM(model, data)
            mujoco.mj_fwdAcceleration(model, data)
            step: Array = data.qacc_smooth
            force = data.qfrc_smooth[self.dof]
            value = qpos[self.at]
            stuck = ((value <= self.lower) & (force < 0)) | ((value >= self.upper) & (force > 0))
            if again or not stuck.any():
                break
            model.dof_armature[self.dof[stuck]] = LOCKED
        return step
