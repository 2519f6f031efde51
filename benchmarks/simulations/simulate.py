"""MuJoCo plays, and what it knows about the floor's force is written down.

One simulation in steps of 1/3000 s or less gives the clips of all frame rates. Beside every frame
stands the true wrench of the floor: the generalised constraint force of the free root, to which
forces within the body (limits, contacts of its own parts) contribute nothing.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from benchmarks.simulations.models import Subject
from benchmarks.simulations.scenarios import Play
from physretarget.clip import Clip

Array = NDArray[np.float64]

_GRAVITY = 9.81
RATES = (30, 60, 250, 500)
"""Frames per second at which clips are sampled; all divide the steps."""


@dataclass(frozen=True)
class Touch:
    """One contact of the body with the floor.

    Attributes:
        geom: its name, or its number.
        depth: m in the floor; negative above it.
        normal, tangential: force (N).
    """

    geom: str
    depth: float
    normal: float
    tangential: float


@dataclass(frozen=True, eq=False)
class Simulation:
    """One simulation, step by step.

    Attributes:
        subject: what was simulated.
        qpos: (S, nq).
        force, moment: (S, 3) what the floor does to the body, N and N m about the centre of
            mass, world axes.
        torque: (S, nv) of the motors, N m or N.
        touches: step → contacts with the floor, at the steps that are frames at some rate.
        defect: BW, and BW h, by which the body breaks Newton's laws, see :func:`_defect`.
        unstable: MuJoCo's own warning, empty where there was none.
    """

    subject: Subject
    qpos: Array
    force: Array
    moment: Array
    torque: Array
    touches: dict[int, tuple[Touch, ...]]
    defect: float = 0.0
    unstable: str = ""

    def clip(self, fps: int) -> Clip:
        """The clip at this frame rate."""
        character = self.subject.character
        qpos = self.qpos[:: self.subject.steps // fps]
        return Clip(
            qpos=qpos,
            time=np.arange(len(qpos)) / fps,
            joint_names=character.joint_names,
            model_name=character.name,
            model_sha256=character.sha256,
        )

    def true_force(self, fps: int, frame: int) -> tuple[Array, Array]:
        """The floor's force (3,) in N at a frame, and its mean as the frames can see it.

        The second difference of positions is the acceleration averaged with a triangle over the
        frames before and after, and so is the force that it stands for.
        """
        every = self.subject.steps // fps
        middle = frame * every
        steps = np.arange(max(middle - every, 0), min(middle + every, len(self.force)))
        weights = every - np.abs(steps - middle) + 1e-9
        return self.force[middle], weights @ self.force[steps] / weights.sum()


def simulate(subject: Subject, play: Play) -> Simulation:
    """Let MuJoCo play."""
    model, steps = _model(subject), subject.steps
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = play.qpos, play.qvel
    mujoco.mj_normalizeQuat(model, data.qpos)
    inertia, limit = _free_inertia(model, play.qpos), _torque_limit(model)
    springs = inertia * play.stiffness**2
    dampers = 2 * inertia * play.stiffness
    way = np.zeros(model.nv)
    joints = slice(6, model.nv)
    count = round(play.seconds * steps) + 1
    settle = round(play.settle * steps)
    qpos, force = np.empty((count, model.nq)), np.empty((count, 3))
    moment, torque = np.empty((count, 3)), np.empty((count, model.nv))
    com, spin = np.empty((count, 3)), np.empty((count, 3))
    touches: dict[int, tuple[Touch, ...]] = {}
    root = subject.character.root_body
    for step in range(-settle, count):
        if step == 0 and play.kick is not None:
            data.qvel += play.kick
        wanted = play.target(max(step, 0) / steps)
        mujoco.mj_differentiatePos(model, way, 1.0, data.qpos, wanted)
        motors = (springs * way - dampers * data.qvel).clip(-limit, limit)
        data.qfrc_applied[joints] = motors[joints]
        if step >= 0:
            qpos[step] = data.qpos
        mujoco.mj_step(model, data)
        if step >= 0:
            force[step], moment[step] = _floor_wrench(data, root)
            torque[step], com[step] = motors, data.subtree_com[root]
            mujoco.mj_subtreeVel(model, data)  # of the beginning of the step, as are all others
            spin[step] = data.subtree_angmom[root]
            if any(step % (steps // rate) == 0 for rate in RATES):
                touches[step] = _touches(model, data)
    weight, height = subject.character.weight, subject.character.com_height
    needed = np.diff(com, n=2, axis=0) * steps**2 / _GRAVITY + [0, 0, 1]
    turned = np.diff(spin, axis=0) * steps - moment[:-1]
    defect = max(
        _defect(needed - force[1:-1] / weight, steps), _defect(turned / (weight * height), steps)
    )
    return Simulation(subject, qpos, force, moment, torque, touches, defect, _warning(data))


def _defect(beyond: Array, steps: int) -> float:
    """The greatest mean over 1/250 s of what a body does (S, 3) beyond what the floor does to it.

    In finite steps a limb at 100 rad/s, thrown by bodies that start within each other, does not
    keep to Newton's laws: such a simulation is no truth to judge by.
    """
    width = steps // 250
    total = np.cumsum(beyond, axis=0)
    return float(np.linalg.norm((total[width:] - total[:-width]) / width, axis=1).max())


def _model(subject: Subject) -> mujoco.MjModel:
    """A copy in the subject's steps; the G1's springs and dampers are a controller's gains."""
    model = copy(subject.model)
    model.opt.timestep = 1 / subject.steps
    if subject.name == "g1":
        model.jnt_stiffness[:] = 0
        model.dof_damping[:] = np.minimum(model.dof_damping, 0.02)
    return model


def _free_inertia(model: mujoco.MjModel, qpos: Array) -> Array:
    """(nv,) what a motor feels of a body that floats: 1 / (M⁻¹)ⱼⱼ."""
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    return 1 / np.diag(np.linalg.inv(full))


def _torque_limit(model: mujoco.MjModel) -> Array:
    """(nv,) nine tenths of what the file grants a joint's motor, infinite where it says nothing."""
    limit = np.full(model.nv, np.inf)
    for joint in range(model.njnt):
        if model.jnt_actfrclimited[joint]:
            limit[model.jnt_dofadr[joint]] = 0.9 * model.jnt_actfrcrange[joint, 1]
    return limit


def _floor_wrench(data: mujoco.MjData, root: int) -> tuple[Array, Array]:
    """Force, and moment about the centre of mass, from the constraint force of the free root."""
    force = data.qfrc_constraint[:3].copy()
    about_root = data.xmat[root].reshape(3, 3) @ data.qfrc_constraint[3:6]
    return force, about_root + np.cross(data.xpos[root] - data.subtree_com[root], force)


def _touches(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[Touch, ...]:
    found = []
    wrench = np.zeros(6)
    for i in range(data.ncon):
        contact = data.contact[i]
        first, second = contact.geom
        if 0 not in (model.geom_bodyid[first], model.geom_bodyid[second]):
            continue
        geom = int(second if model.geom_bodyid[first] == 0 else first)
        mujoco.mj_contactForce(model, data, i, wrench)
        found.append(
            Touch(
                model.geom(geom).name or str(geom),
                -float(contact.dist),
                float(wrench[0]),
                float(np.hypot(wrench[1], wrench[2])),
            )
        )
    return tuple(found)


def _warning(data: mujoco.MjData) -> str:
    names = mujoco.mjtWarning
    bad = {"BADQPOS": names.mjWARN_BADQPOS, "BADQVEL": names.mjWARN_BADQVEL,
           "BADQACC": names.mjWARN_BADQACC}  # fmt: skip
    return ", ".join(name for name, i in bad.items() if data.warning[int(i)].number)
