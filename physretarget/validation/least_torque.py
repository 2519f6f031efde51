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
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.sparse import block_diag

from physretarget.ground.support import Support
from physretarget.mjcf import Character, RootWrench
from physretarget.mjcf.audit import audit
from physretarget.validation.torque import TorqueLimits

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class TorqueShare:
    """The share of its limit that the worst joint needs at least.

    Attributes:
        share: (F,) 1.
        dof: (F,) the joint's degree of freedom.
    """

    share: Floats
    dof: Ints


_EDGES = 8
# Frames whose programmes are solved in one call.
_AT_ONCE = 16
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

    def judge(self, loads: Loads) -> TorqueShare:
        """The least share of the frames' worst joints."""
        low, high = self._rooms(loads)
        bare = (loads.torque - loads.held)[:, self.limited]
        every = np.maximum((bare + low) / self.lower, (bare - high) / self.upper)
        worst = every.argmax(axis=1)
        share = np.maximum(every[np.arange(len(every)), worst], 0.0)
        over = np.flatnonzero(share > 1)
        data = mujoco.MjData(self.model)
        for first in range(0, len(over), _AT_ONCE):
            frames = over[first : first + _AT_ONCE]
            programmes = [self._programme(data, loads, int(t), low[t], high[t]) for t in frames]
            share[frames], worst[frames] = _least(programmes)
        return TorqueShare(share, self.limited[worst])

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

    def _programme(
        self, data: mujoco.MjData, loads: Loads, t: int, low: Floats, high: Floats
    ) -> _Programme:
        """The linear programme of frame ``t``."""
        data.qpos[:] = loads.qpos[t]
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_comPos(self.model, data)
        weight = self.character.weight
        floor, wrenches = self._floor(data, loads, t)
        turns = weight * np.concatenate([floor, self._own(data)])[:, self.limited]
        bare = loads.torque[t, self.limited]
        above, below = np.flatnonzero(np.isfinite(high)), np.flatnonzero(np.isfinite(low))
        slopes = np.concatenate([
            (turns / self.upper).T[above], (turns / self.lower).T[below]
        ])  # fmt: skip
        bare = np.concatenate([
            ((bare - high) / self.upper)[above], ((bare + low) / self.lower)[below]
        ])  # fmt: skip
        force = loads.force[t] / weight
        wrench = np.r_[force.sum(axis=0), np.cross(loads.support.arm[t], force).sum(axis=0)]
        equal = np.zeros((6, len(turns)))
        equal[:, : len(wrenches)] = wrenches.T
        return _Programme(slopes, bare, equal, wrench, np.concatenate([above, below]))

    def _floor(self, data: mujoco.MjData, loads: Loads, t: int) -> tuple[Floats, Floats]:
        """(R, nv) what unit rays of the floor do to joints, and their wrenches about the CoM."""
        points = np.flatnonzero(loads.support.mask[t])
        arm, owner = loads.support.arm[t, points], loads.support.body[t, points]
        rays = np.ones((len(points), _EDGES, 3))
        rays[..., :2] = loads.support.friction[t, points][:, None, None] * _COMPASS
        turns = np.zeros((len(points), _EDGES, self.model.nv))
        along, about = np.zeros((2, 3, self.model.nv))
        for body in np.unique(owner).tolist():
            mine = owner == body
            mujoco.mj_jacBody(self.model, data, along, about, body)
            place = loads.com[t] + arm[mine] - data.xpos[body]
            turns[mine] = rays[mine] @ along + np.cross(place[:, None], rays[mine]) @ about
        wrenches = np.concatenate([rays, np.cross(arm[:, None], rays)], axis=2)
        return turns.reshape(-1, self.model.nv), wrenches.reshape(-1, 6)

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


@dataclass(frozen=True, eq=False)
class _Programme:
    """One frame's programme in the forces x >= 0 along R rays, in body weights:

    minimise s >= 0, bare - slopes x <= s, equal x = wrench.

    ``slopes`` (m, R) and ``bare`` (m,) are shares of limits, ``which`` (m,) of the limited degrees
    of freedom they belong to.
    """

    slopes: Floats
    bare: Floats
    equal: Floats
    wrench: Floats
    which: Ints

    def reached(self) -> tuple[_Programme, float, int]:
        """What the rays change; the rest is a bound of the share (0 for none), and whose it is."""
        some = (self.slopes != 0).any(axis=1)
        part = replace(self, slopes=self.slopes[some], bare=self.bare[some], which=self.which[some])
        if some.all():
            return part, 0.0, 0
        worst = int(np.where(some, -np.inf, self.bare).argmax())
        return part, max(float(self.bare[worst]), 0.0), int(self.which[worst])


def _least(programmes: list[_Programme]) -> tuple[Floats, Ints]:
    """(F,) shares of some frames, and which of the limited needs each (F,).

    Solved is the dual, whose unknowns are as few as a frame's joints: their weights l >= 0, that of
    the bound among them, and the wrench's n,

        maximise bare l + wrench n,  sum l = 1,  slopes^T l + equal^T n <= 0.

    Frames have nothing in common but the call: its preparation costs more than such a programme.
    Where one has no solution the others are solved without it.
    """
    parts = [p.reached() for p in programmes]
    free, most = (-np.inf, np.inf), (0.0, np.inf)
    bounds = [b for p, _, _ in parts for b in [most] * (len(p.bare) + 1) + [free] * 6]
    found = linprog(
        -np.concatenate([np.r_[p.bare, fixed, p.wrench] for p, fixed, _ in parts]),
        block_diag(
            [np.c_[p.slopes.T, np.zeros(p.slopes.shape[1]), p.equal.T] for p, _, _ in parts],
            format="csc",
        ),
        np.zeros(sum(p.slopes.shape[1] for p, _, _ in parts)),
        block_diag(
            [np.r_[np.ones(len(p.bare) + 1), np.zeros(6)][None] for p, _, _ in parts], format="csc"
        ),
        np.ones(len(parts)), bounds=bounds, method="highs", options={"presolve": False},
    )  # fmt: skip
    if found.x is None:  # The fit's own forces are within the pyramids: only by rounding.
        if len(programmes) == 1:
            return np.array([np.inf]), np.zeros(1, dtype=np.int64)
        alone = [_least([p]) for p in programmes]
        return np.concatenate([s for s, _ in alone]), np.concatenate([w for _, w in alone])
    shares, which = np.zeros(len(parts)), np.zeros(len(parts), dtype=np.int64)
    ends = np.cumsum([len(p.bare) + 7 for p, _, _ in parts])[:-1]
    for k, ((p, fixed, whose), x) in enumerate(zip(parts, np.split(found.x, ends), strict=True)):
        shares[k] = np.r_[p.bare, fixed, p.wrench] @ x
        which[k] = np.r_[p.which, whose][x[:-6].argmax()]
    return shares, which
