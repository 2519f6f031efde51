"""The least share of its motors' torque with which a frame can be explained.

How the floor's force spreads over the points that touch is not seen in a clip; neither is what
bodies press on each other, what a stop takes, or how much a joint's own friction and damping
help. Of all that is possible the kindest is asked for, a linear programme in the forces along the
edges of friction pyramids:

    minimise s,  s lower <= torque - help - sum_p J_p^T f_p <= s upper,

with the floor's wrench fixed at what explains the frame.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from physretarget.ground.support import Support
from physretarget.mjcf import Character, RootWrench
from physretarget.mjcf.audit import audit
from physretarget.validation.torque import TorqueLimits

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]
Series = dict[str, NDArray[np.generic]]

_EDGES = 8
_AROUND = (np.arange(_EDGES) + 0.5) * 2 * np.pi / _EDGES
# Pyramids stand around their cones, so that what a cone can, its pyramid can.
_COMPASS = np.stack([np.cos(_AROUND), np.sin(_AROUND)], axis=1) / np.cos(np.pi / _EDGES)
# Bodies of the character this near press on each other, m.
_PRESSING = 0.002
# A joint this near the end of its range (what KIN001 calls calibration), or beyond it, leans on its
# stop; how far stops yield is KIN001's matter.
STOP_RAD, STOP_M = 0.0087, 0.001


@dataclass(frozen=True, eq=False)
class Loads:
    """What joints bear in F frames.

    Attributes:
        qpos: (F, nq).
        torque: (F, nv) that moves the bodies, contacts left out; N m or N.
        passive: (F, nv) share of it that the file's springs and dampers have.
        held: (F, nv) share of it that the floor has, as ``force`` (F, n, 3) N at ``support``.
        com: (F, 3) centre of mass (m), from which the support's arms count.
    """

    qpos: Floats
    torque: Floats
    passive: Floats
    held: Floats
    force: Floats
    support: Support
    com: Floats


def unsupported(qpos: Floats, needs: RootWrench) -> Loads:
    """Loads of a base that the world holds, with nothing on the floor."""
    frames = len(qpos)
    none = np.zeros((frames, 0))
    support = Support(
        np.zeros((frames, 0, 3)), np.zeros((frames, 0, 3)), none.astype(np.int64), none,
        np.zeros((frames, 0, 2)), none.astype(bool), none.astype(np.int64),
        np.zeros(0, dtype=np.int64), np.zeros(frames, dtype=bool), 0.0,
    )  # fmt: skip
    return Loads(
        qpos, needs.joint_torque, needs.passive, np.zeros_like(needs.passive),
        np.zeros((frames, 0, 3)), support, needs.com,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class LeastTorque:
    """A model prepared: ``model`` in which its own bodies alone collide, from a small gap on.

    ``helps`` (nv,) whether the file's springs and dampers are a mechanism's own, not the gains of a
    controller, and so take load off the motor; ``loss`` (nv,) its dry friction.
    """

    character: Character
    limits: TorqueLimits
    model: mujoco.MjModel
    helps: Bools
    loss: Floats

    @classmethod
    def build(cls, character: Character) -> LeastTorque | None:
        """Prepare a model; None where no torque is limited."""
        limits = TorqueLimits.build(character)
        if not limits.any:
            return None
        model = copy.copy(character.model)
        outside = ~np.isin(model.geom_bodyid, character.bodies)
        model.geom_contype[outside] = 0
        model.geom_conaffinity[outside] = 0
        model.geom_margin[:] = 0.5 * _PRESSING
        gains = {f.name for f in audit(character) if f.key == "pd_gains"}
        helps = np.ones(model.nv, dtype=bool)
        for joint, name in enumerate(character.joint_names):
            helps[model.jnt_dofadr[joint]] = name not in gains
        return cls(character, limits, model, helps, np.array(model.dof_frictionloss))

    def judge(self, loads: Loads) -> Series:
        """The series of the chunk: ``torque_ratio`` (F,) and the ``torque_dof`` (F,) of it."""
        share, dof = self.shares(loads)
        return {"torque_ratio": share, "torque_dof": dof}

    def shares(self, loads: Loads) -> tuple[Floats, Ints]:
        """(F,) the least share of its limit that the worst joint needs, and its dof (F,)."""
        low, high = self._rooms(loads)
        bare = (loads.torque - loads.held)[:, self.limited]
        every = np.maximum((bare + low) / self.lower, (bare - high) / self.upper)
        worst = every.argmax(axis=1)
        share = np.maximum(every[np.arange(len(every)), worst], 0.0)
        for t in np.flatnonzero(share > 1):
            share[t], worst[t] = self._kindest(loads, int(t), low[t], high[t])
        return share, self.limited[worst]

    @property
    def limited(self) -> Ints:
        """Degrees of freedom (L,) whose torque is limited."""
        return np.flatnonzero(np.isfinite(self.limits.upper))

    @property
    def lower(self) -> Floats:
        """(L,) their limits, below zero."""
        return self.limits.lower[self.limited]

    @property
    def upper(self) -> Floats:
        """(L,) their limits, above zero."""
        return self.limits.upper[self.limited]

    def _rooms(self, loads: Loads) -> tuple[Floats, Floats]:
        """(F, L) how far below zero and above it others than motors can go, infinite on stops."""
        own = np.where(self.helps, loads.passive, 0.0)
        low, high = self.loss + np.maximum(-own, 0), self.loss + np.maximum(own, 0)
        for joint in self.character.tree.joints:
            if joint.kind in ("hinge", "slide"):
                near = STOP_RAD if joint.kind == "hinge" else STOP_M
                least, most = _swept(loads.qpos[:, joint.qpos])
                # At the lower end a stop pushes up.
                high[least < self.character.lower[joint.qpos] + near, joint.dof] = np.inf
                low[most > self.character.upper[joint.qpos] - near, joint.dof] = np.inf
        return low[:, self.limited], high[:, self.limited]

    def _kindest(self, loads: Loads, t: int, low: Floats, high: Floats) -> tuple[float, int]:
        """Solve the linear programme of frame ``t``: the share, and which of the limited needs it.

        Unknowns: forces along rays of the floor, forces along rays of its own contacts, the share.
        Forces count in body weights, torques in limits.
        """
        data = mujoco.MjData(self.model)
        data.qpos[:] = loads.qpos[t]
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_comPos(self.model, data)
        weight = self.character.weight
        floor, wrenches = self._floor(data, loads, t)
        turns = weight * np.concatenate([floor, self._own(data)])[:, self.limited]
        bare = loads.torque[t, self.limited]
        above, below = np.isfinite(high), np.isfinite(low)
        rows = np.concatenate([
            (np.c_[-turns.T, -self.upper] / self.upper[:, None])[above],
            (np.c_[turns.T, self.lower] / -self.lower[:, None])[below],
        ])  # fmt: skip
        bounds = np.concatenate([
            ((high - bare) / self.upper)[above], ((bare + low) / -self.lower)[below]
        ])  # fmt: skip
        if not len(rows):
            return 0.0, 0
        force = loads.force[t] / weight
        wrench = np.r_[force.sum(axis=0), np.cross(loads.support.arm[t], force).sum(axis=0)]
        equal = np.zeros((6, len(turns) + 1))
        equal[:, : len(wrenches)] = wrenches.T
        found = linprog(
            np.r_[np.zeros(len(turns)), 1.0], rows, bounds, equal, wrench, method="highs",
            options={"presolve": False},
        )  # fmt: skip
        if found.x is None:  # The fit's own forces are within the pyramids: only by rounding.
            return np.inf, 0
        which = np.concatenate([np.flatnonzero(above), np.flatnonzero(below)])
        return float(found.x[-1]), int(which[np.abs(found.ineqlin.marginals).argmax()])

    def _floor(self, data: mujoco.MjData, loads: Loads, t: int) -> tuple[Floats, Floats]:
        """(R, nv) what unit rays of the floor do to joints, and their wrenches about the CoM."""
        points = np.flatnonzero(loads.support.mask[t])
        arm = loads.support.arm[t, points]
        jacobian = np.zeros((len(points), 3, self.model.nv))
        for k, point in enumerate(points):
            body = int(loads.support.body[t, point])
            mujoco.mj_jac(self.model, data, jacobian[k], None, loads.com[t] + arm[k], body)
        rays = np.ones((len(points), _EDGES, 3))
        rays[..., :2] = loads.support.friction[t, points][:, None, None] * _COMPASS
        wrenches = np.concatenate([rays, np.cross(arm[:, None], rays)], axis=2)
        return (rays @ jacobian).reshape(-1, self.model.nv), wrenches.reshape(-1, 6)

    def _own(self, data: mujoco.MjData) -> Floats:
        """(R, nv) what unit rays between bodies of the character that touch do to its joints."""
        mujoco.mj_collision(self.model, data)
        columns = [np.zeros((0, self.model.nv))]
        first, second = np.zeros((2, 3, self.model.nv))
        for contact in data.contact:
            bodies = self.model.geom_bodyid[contact.geom]
            mujoco.mj_jac(self.model, data, first, None, contact.pos, int(bodies[0]))
            mujoco.mj_jac(self.model, data, second, None, contact.pos, int(bodies[1]))
            frame = contact.frame.reshape(3, 3)
            rays = frame[0] + contact.friction[0] * _COMPASS @ frame[1:]
            columns.append(rays @ (second - first))
        return np.concatenate(columns)


def _swept(value: Floats) -> tuple[Floats, Floats]:
    """(F,) the least and the greatest value (F,) that a coordinate may have had since the frame
    before and until the next: a stop that it meets between two frames shows in both.

    It goes on from the frame before it as it came, and comes to the next as it goes on from there.
    """
    if len(value) < 2:
        return value, value
    step = np.diff(value)
    came, goes = np.r_[step[0], step], np.r_[step, step[-1]]
    ways = np.stack([value, value - came, value + goes, value + came, value - goes])
    return ways.min(axis=0), ways.max(axis=0)
