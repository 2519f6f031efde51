"""What is done to a body before MuJoCo takes over: where it starts, and what its joints want.

Every scenario is a function of a subject and a random generator. Nothing pushes a body while it
is recorded: a push is an initial velocity. Motors are springs and dampers between the joints and
a target that moves; a limp joint has none.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache

import mujoco
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from benchmarks.simulations.models import SHIPPED, Subject
from physretarget.demo import models_folder
from physretarget.keyposes import load_keyposes
from physretarget.mjcf import Character

Array = NDArray[np.float64]
Target = Callable[[float], Array]


@dataclass(frozen=True, eq=False)
class Play:
    """How a simulation begins and what the motors want.

    Attributes:
        qpos, qvel: (nq,), (nv,) at time 0.
        target: time (s) → (nq,) pose that the motors want.
        stiffness: (nv,) natural frequency of the motor of each degree of freedom (rad/s); 0: limp.
        settle: s that pass before the recording starts.
        kick: (nv,) added to the velocity when it starts.
        seconds: of the recording.
    """

    qpos: Array
    qvel: Array
    target: Target
    stiffness: Array
    seconds: float
    settle: float = 0.0
    kick: Array | None = None


def stand(subject: Subject, rng: Generator) -> Play:
    """A pose held: a key pose, or the reference pose with every joint moved a little."""
    pose = _key_pose(subject, rng) if rng.random() < 0.5 else None
    pose = _varied(subject, rng, 0.15) if pose is None else pose
    return _held(subject, rng, on_floor(subject, pose, rng.uniform(-0.0005, 0.002)))


def push(subject: Subject, rng: Generator) -> Play:
    """Standing, then a velocity of the whole body at once."""
    play = _held(subject, rng, on_floor(subject, _varied(subject, rng, 0.1)), settle=0.4)
    speed = rng.uniform(0.2, 1.0) * np.sqrt(9.81 * subject.character.height)
    return _kicked(subject, play, rng, 0.5 * speed, turn=rng.normal(0, 1.0, 3))


def drop(subject: Subject, rng: Generator) -> Play:
    """Let go above the floor, tilted."""
    pose = turned(subject, _varied(subject, rng, 0.1), rng, rng.uniform(0, 0.6))
    return _held(subject, rng, on_floor(subject, pose, rng.uniform(0.1, 0.7) * _size(subject)))


def fall(subject: Subject, rng: Generator) -> Play:
    """A stiff body that topples."""
    pose = turned(subject, _varied(subject, rng, 0.1), rng, rng.uniform(0.2, 1.0))
    play = _held(subject, rng, on_floor(subject, pose, 0.001))
    return _kicked(subject, play, rng, 0.0, turn=rng.normal(0, 1.0, 3) * [1, 1, 0.2])


def ragdoll(subject: Subject, rng: Generator) -> Play:
    """No motors at all, from any orientation."""
    pose = turned(subject, _varied(subject, rng, 0.3), rng, rng.uniform(0, np.pi))
    pose = on_floor(subject, pose, rng.uniform(0.0, 0.5) * _size(subject))
    qvel = rng.normal(0, 1.0, subject.model.nv)
    qvel[:3] *= 0.5
    none = np.zeros(subject.model.nv)
    return Play(pose, qvel, lambda t: pose, none, _seconds(rng))


def hop(subject: Subject, rng: Generator) -> Play:
    """A crouch and a quick stretch; the landing is part of it."""
    model, rest = subject.model, subject.character.reference_qpos.copy()
    deep, high = rest.copy(), rest.copy()
    share, over = rng.uniform(0.5, 1.0), rng.uniform(0.0, 0.2)
    for name, value in subject.crouch.items():
        joint = model.joint(name)
        at, (low, top) = int(joint.qposadr[0]), joint.range
        deep[at] = np.clip(rest[at] + share * value, low, top)
        high[at] = np.clip(rest[at] - over * value, low, top)
    times = np.cumsum([0.1, 0.35, 0.1, rng.uniform(0.06, 0.14), 0.05, 0.3])
    poses = np.stack([rest, deep, deep, high, high, rest])

    def target(t: float) -> Array:
        i = int(np.searchsorted(times, t).clip(1, len(times) - 1))
        part = np.clip((t - times[i - 1]) / (times[i] - times[i - 1]), 0, 1)
        pose: Array = poses[i - 1] + (poses[i] - poses[i - 1]) * part * part * (3 - 2 * part)
        return pose

    start = on_floor(subject, rest)
    motors = _motors(subject, 2 * np.pi * rng.uniform(12, 30))
    return Play(start, np.zeros(model.nv), target, motors, rng.uniform(1.8, 2.4), settle=0.2)


def skid(subject: Subject, rng: Generator) -> Play:
    """On the floor with a speed along it, or spinning on the spot."""
    play = _held(subject, rng, on_floor(subject, _varied(subject, rng, 0.1)), settle=0.3)
    turn = np.array([0, 0, rng.normal(0, 4.0)])
    return _kicked(subject, play, rng, rng.uniform(0.5, 3.0), turn=turn)


def roll(subject: Subject, rng: Generator) -> Play:
    """On wheels, or as a ball, with the spin that goes with the speed, or nearly."""
    play = _held(subject, rng, on_floor(subject, subject.character.reference_qpos), settle=0.3)
    speed = rng.uniform(0.3, 2.0)
    kick = np.zeros(subject.model.nv)
    kick[0] = speed
    spin = speed / subject.radius * rng.uniform(0.8, 1.2)
    for name in subject.spin:
        kick[subject.model.joint(name).dofadr[0]] = spin
    if not subject.spin:
        kick[4] = spin
    return replace(play, kick=kick)


def swing(subject: Subject, rng: Generator) -> Play:
    """Some joints are let go away from where they would hang; the rest hold their pose."""
    pose = _varied(subject, rng, 0.6)
    play = _held(subject, rng, on_floor(subject, pose))
    motors = play.stiffness * (rng.random(len(play.stiffness)) > 0.4)
    return replace(play, stiffness=motors)


def dance(subject: Subject, rng: Generator) -> Play:
    """Every joint follows a wave of its own; what the floor makes of it is not asked."""
    model, rest = subject.model, subject.character.reference_qpos.copy()
    lower, upper = _limits(subject)
    half = np.minimum(np.minimum(rest - lower, upper - rest), 0.5).clip(0)
    wave = rng.uniform(0, 0.8, model.nq) * half
    pace, phase = 2 * np.pi * rng.uniform(0.4, 2.5, model.nq), rng.uniform(0, 6.3, model.nq)

    def target(t: float) -> Array:
        pose: Array = rest + min(max(t, 0.0) / 0.5, 1.0) * wave * np.sin(pace * t + phase)
        return pose

    motors = _motors(subject, 2 * np.pi * rng.uniform(8, 20))
    return Play(on_floor(subject, rest), np.zeros(model.nv), target, motors, _seconds(rng), 0.2)


SCENARIOS: Mapping[str, Callable[[Subject, Generator], Play]] = {
    f.__name__: f for f in (stand, push, drop, fall, ragdoll, hop, skid, roll, swing, dance)
}


def fits(subject: Subject, scenario: str) -> bool:
    """Whether the body can do that: who has no crouch cannot hop, who is not round not roll."""
    return {"hop": bool(subject.crouch), "roll": subject.radius > 0}.get(scenario, True)


def on_floor(subject: Subject, qpos: Array, gap: float = 0.0) -> Array:
    """The pose lifted or lowered until what may collide is ``gap`` m above the floor."""
    model = subject.model
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    floor = model.geom("floor").id
    ends = np.zeros(6)
    solid = [
        g for g in range(model.ngeom)
        if model.geom_bodyid[g] != 0
        and (model.geom_contype[g] & model.geom_conaffinity[floor]
             or model.geom_contype[floor] & model.geom_conaffinity[g])
    ]  # fmt: skip
    lowest = min(mujoco.mj_geomDistance(model, data, floor, g, 10.0, ends) for g in solid)
    moved = np.array(qpos, dtype=float)
    moved[2] += gap - lowest
    return moved


def turned(subject: Subject, qpos: Array, rng: Generator, angle: float) -> Array:
    """The root turned by ``angle`` (rad) about a random horizontal axis, heading at random."""
    way = rng.uniform(0, 2 * np.pi)
    tilt, yaw, both, pose = np.zeros(4), np.zeros(4), np.zeros(4), np.array(qpos, dtype=float)
    mujoco.mju_axisAngle2Quat(tilt, np.array([np.cos(way), np.sin(way), 0.0]), angle)
    mujoco.mju_axisAngle2Quat(yaw, np.array([0.0, 0.0, 1.0]), rng.uniform(0, 2 * np.pi))
    mujoco.mju_mulQuat(both, tilt, yaw)
    mujoco.mju_mulQuat(pose[3:7], both, qpos[3:7])
    return pose


def _size(subject: Subject) -> float:
    return max(subject.character.height, 0.1)


def _seconds(rng: Generator) -> float:
    return float(rng.uniform(1.2, 2.0))


def _limits(subject: Subject) -> tuple[Array, Array]:
    """(nq,) limits of the joints; the free root and wheels have none, and get their own pose."""
    character = subject.character
    rest = character.reference_qpos
    lower = np.where(np.isfinite(character.lower), character.lower, rest - 1.0)
    upper = np.where(np.isfinite(character.upper), character.upper, rest + 1.0)
    lower[:7] = upper[:7] = rest[:7]
    return lower, upper


def _varied(subject: Subject, rng: Generator, size: float) -> Array:
    """The reference pose with joints moved by up to ``size`` of the way to their limits."""
    lower, upper = _limits(subject)
    rest = subject.character.reference_qpos.copy()
    way = rng.uniform(-1, 1, len(rest)) * size
    return np.where(way > 0, rest + way * (upper - rest), rest + way * (rest - lower))


def _motors(subject: Subject, stiffness: float) -> Array:
    """The same stiffness for all joints but the root's and wheels."""
    motors = np.full(subject.model.nv, stiffness)
    motors[:6] = 0.0
    for name in subject.spin:
        motors[subject.model.joint(name).dofadr[0]] = 0.0
    return motors


def _held(subject: Subject, rng: Generator, pose: Array, settle: float = 0.0) -> Play:
    motors = _motors(subject, 2 * np.pi * rng.uniform(6, 30))
    qvel = np.zeros(subject.model.nv)
    return Play(pose, qvel, lambda t: pose, motors, _seconds(rng), settle)


def _kicked(subject: Subject, play: Play, rng: Generator, speed: float, turn: Array) -> Play:
    """The play with a velocity of the whole body at its start, ``turn`` in rad/s."""
    way = rng.uniform(0, 2 * np.pi)
    kick = np.zeros(subject.model.nv)
    kick[:3] = speed * np.cos(way), speed * np.sin(way), 0.0
    kick[3:6] = turn
    return replace(play, kick=kick)


@cache
def _key_poses(name: str) -> tuple[Array, ...]:
    character = Character.load(models_folder() / f"{name}.xml")
    file = models_folder() / f"{name}.keyposes.toml"
    return tuple(p.qpos for p in load_keyposes([file], character).poses)


def _key_pose(subject: Subject, rng: Generator) -> Array | None:
    if subject.name not in SHIPPED:
        return None
    poses = _key_poses(subject.name)
    return poses[rng.integers(len(poses))]
