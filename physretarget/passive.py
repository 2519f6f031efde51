"""Limbs that the actor lacks swing by their own dynamics on the moving body.

A mapper can only guess at a tail: no joint of the actor says where it should be (Yamane 2010,
section 7, leaves such limbs open). Joints that the model names as passive are simulated instead,
with the stiffness and damping that the file gives them, while all other joints follow the clip::

    M_tt q̈_t = passive_t - bias_t - M_tp q̈_p

t are the passive degrees of freedom, p the prescribed ones; M, bias (gravity, Coriolis) and
passive forces are MuJoCo's. What results moves with the rest through all later stages, so that
momentum and inverse dynamics include what the limb does to the body.

A model names them by a custom text ``passive``: joint names, ``*`` for any ending.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from physretarget.errors import InputError
from physretarget.mjcf import Character
from physretarget.mjcf.declared import passive_joints

__all__ = [
    "Limb",
    "PassiveSettings",
    "Swung",
    "limb_of",
    "passive_features",
    "swing",
    "with_limb",
]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class PassiveSettings:
    """How the simulation runs.

    ``step``: longest time step, s; the springs and dampers are integrated implicitly, so that
    it is a matter of accuracy, not stability. ``settle``: s for which the limb hangs on the
    first pose, held still, before the clip begins. ``margin`` (rad or m) before a joint's limit
    a spring ``stop`` times as stiff as the joint's own begins to push back, damped alike: a
    hard stop would be a blow, and its force beyond anything that a frame rate can show.
    """

    step: float = 0.001
    settle: float = 3.0
    margin: float = 0.2
    stop: float = 10.0


@dataclass(frozen=True, eq=False)
class Limb:
    """The passive joints: ``names``, where they are in qpos and in the velocity vector."""

    names: tuple[str, ...]
    qpos: Ints
    dof: Ints


@dataclass(frozen=True, eq=False)
class Swung:
    """A clip whose passive joints have swung.

    ``qpos`` (T, nq); ``velocity`` (T, n) of the passive joints, rad/s or m/s; ``stopped`` (T,)
    frames in which one of them hung at its limit.
    """

    qpos: Array
    velocity: Array
    stopped: NDArray[np.bool_]

    @property
    def notes(self) -> tuple[str, ...]:
        """One sentence where limits were reached."""
        if not self.stopped.any():
            return ()
        return (
            f"The passive limb comes close to a joint limit in {int(self.stopped.sum())} frames.",
        )


def limb_of(character: Character) -> Limb | None:
    """The joints that the model's custom text ``passive`` names; None without such a text.

    Raises:
        InputError: a name fits no joint, or a joint that is neither hinge nor slide.
    """
    found = passive_joints(character)
    if not found:
        return None
    joints = [
        joint
        for name, joint in zip(character.joint_names, character.tree.joints, strict=True)
        if name in found
    ]
    for joint in joints:
        if joint.kind not in ("hinge", "slide"):
            raise InputError(
                f"a passive joint is a {joint.kind}; it must be a hinge or a slide.",
                path=character.path,
            )
    return Limb(
        names=found,
        qpos=np.array([joint.qpos for joint in joints], dtype=np.int64),
        dof=np.array([joint.dof for joint in joints], dtype=np.int64),
    )


def swing(
    character: Character,
    qpos: Array,
    time: Array,
    *,
    limb: Limb | None = None,
    settings: PassiveSettings | None = None,
) -> Swung:
    """Simulate the passive joints on the moving body.

    Args:
        character: whose ``passive`` joints swing. limb: others than those it names.
        qpos: (T, nq) the clip; what it has for the passive joints is where they are first
            sought, and nothing else. time: (T,) s, increasing.
        settings: defaults if None.

    Raises:
        InputError: the model names no passive joints.
    """
    settings = settings or PassiveSettings()
    limb = limb or limb_of(character)
    if limb is None:
        raise InputError(
            f"model {character.name!r} names no passive joints (a custom text 'passive').",
            path=character.path,
        )
    steps = max(int(np.ceil(float(np.max(np.diff(time))) / settings.step)), 1)
    moving = _Prescribed.between(character, qpos, time, steps)
    simulation = _Simulation(character, limb, qpos[0, limb.qpos], settings)
    simulation.settle(qpos[0], settings.settle)
    swung = np.array(qpos, dtype=np.float64)
    velocity = np.zeros((len(qpos), len(limb.dof)))
    stopped = np.zeros(len(qpos), dtype=bool)
    swung[0, limb.qpos] = simulation.angle
    for frame in range(1, len(qpos)):
        for k in range((frame - 1) * steps, frame * steps):
            step = float(moving.time[k + 1] - moving.time[k])
            simulation.step(moving.qpos[k], moving.qvel[k], moving.qacc[k], step)
        swung[frame, limb.qpos] = simulation.angle
        velocity[frame], stopped[frame] = simulation.speed, simulation.stopped
    return Swung(swung, velocity, stopped)


@dataclass(frozen=True, eq=False)
class _Prescribed:
    """The clip between its frames, twice continuously differentiable: cubic splines.

    ``time`` (S,), ``qpos`` (S, nq), ``qvel`` and ``qacc`` (S, nv), MuJoCo's conventions.
    """

    time: Array
    qpos: Array
    qvel: Array
    qacc: Array

    @classmethod
    def between(cls, character: Character, qpos: Array, time: Array, steps: int) -> _Prescribed:
        """``steps`` equal parts of every interval between frames; S = (T-1) steps + 1."""
        tree = character.tree
        share = np.arange(steps) / steps
        fine = (time[:-1, None] + np.diff(time)[:, None] * share).ravel()
        fine = np.append(fine, time[-1])
        all_qpos = np.zeros((len(fine), tree.nq))
        qvel, qacc = np.zeros((len(fine), tree.nv)), np.zeros((len(fine), tree.nv))
        at, dof = tree.scalars
        spline = CubicSpline(time, qpos[:, at])
        all_qpos[:, at], qvel[:, dof], qacc[:, dof] = (spline(fine, order) for order in range(3))
        for quat, turn in zip(*tree.quats, strict=True):
            rotation = RotationSpline(time, Rotation.from_quat(qpos[:, quat], scalar_first=True))
            all_qpos[:, quat] = rotation(fine).as_quat(scalar_first=True)
            qvel[:, turn], qacc[:, turn] = rotation(fine, 1), rotation(fine, 2)
        return cls(fine, all_qpos, qvel, qacc)


class _Simulation:
    """The passive joints' state, and one step of it (semi-implicit Euler)."""

    def __init__(
        self, character: Character, limb: Limb, start: Array, settings: PassiveSettings
    ) -> None:
        self.model, self.data = character.unconstrained, mujoco.MjData(character.model)
        self.limb = limb
        self.angle, self.speed = np.array(start), np.zeros(len(limb.dof))
        self.stopped = False
        joints = self.model.dof_jntid[limb.dof]
        self.stiffness = np.asarray(self.model.jnt_stiffness, dtype=np.float64).reshape(
            self.model.njnt, -1
        )[joints, 0]
        self.damping = np.asarray(self.model.dof_damping, dtype=np.float64).reshape(
            self.model.nv, -1
        )[limb.dof, 0]
        self.lower, self.upper = character.lower[limb.qpos], character.upper[limb.qpos]
        margin = np.minimum(settings.margin, 0.25 * (self.upper - self.lower))
        self.near = self.lower + margin, self.upper - margin
        self.stop = settings.stop
        self.inertia = np.zeros((self.model.nv, self.model.nv))
        self.block = np.ix_(limb.dof, limb.dof)

    def settle(self, qpos: Array, seconds: float) -> None:
        """Hang on a body that holds still."""
        still = np.zeros(self.model.nv)
        for _ in range(round(seconds / 0.01)):
            self.step(qpos, still, still, 0.01)
        self.speed[:] = 0.0

    def step(self, qpos: Array, qvel: Array, qacc: Array, step: float) -> None:
        """From one instant to the next, the body at ``qpos``, moving with ``qvel``, ``qacc``."""
        model, data, limb = self.model, self.data, self.limb
        data.qpos, data.qvel = qpos, qvel
        data.qpos[limb.qpos], data.qvel[limb.dof] = self.angle, self.speed
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_fullM(model, data, self.inertia)
        body = np.array(qacc)
        body[limb.dof] = 0.0
        force = data.qfrc_passive[limb.dof] - data.qfrc_bias[limb.dof]
        force -= self.inertia[limb.dof] @ body
        # Springs and dampers as they will be at the end of the step.
        over = self.angle - np.clip(self.angle, *self.near)
        pushing = over != 0.0
        self.stopped = bool(pushing.any())
        stop = np.where(pushing, self.stop, 0.0)
        force -= stop * (self.stiffness * over + self.damping * self.speed)
        stiffness, damping = (1.0 + stop) * self.stiffness, (1.0 + stop) * self.damping
        force -= step * stiffness * self.speed
        matrix = self.inertia[self.block]
        matrix[np.diag_indices_from(matrix)] += step * (damping + step * stiffness)
        self.speed += step * np.linalg.solve(matrix, force)
        angle = self.angle + step * self.speed
        self.angle = np.clip(angle, self.lower, self.upper)
        self.speed[angle != self.angle] = 0.0


def with_limb(character: Character, qpos: Array, other: Array) -> Array:
    """The poses ``qpos`` (T, nq) with the passive joints of ``other`` (T, nq)."""
    limb = limb_of(character)
    result = np.array(qpos, dtype=np.float64)
    if limb is not None:
        result[:, limb.qpos] = other[:, limb.qpos]
    return result


@lru_cache(maxsize=8)
def _bodies(character: Character) -> NDArray[np.bool_]:
    limb = limb_of(character)
    tree = character.tree
    carried = np.zeros(tree.nb, dtype=bool)
    if limb is not None:
        for body in np.unique(tree.dof_body[limb.dof]):
            carried |= tree.carries[body]
    return carried


def passive_features(character: Character) -> NDArray[np.bool_]:
    """(3K,) which of the character's features a passive joint moves."""
    return np.repeat(_bodies(character)[character.markers.body], 3)
