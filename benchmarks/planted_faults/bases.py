"""Clean clips that faults are planted into, at any frame rate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from benchmarks.planted_faults import puppets
from benchmarks.simulations.judge import Take, simulated
from benchmarks.simulations.models import g1_file
from physretarget.clip import Clip, load_clip
from physretarget.mjcf import Character
from physretarget.mjcf.dynamics import lowpass
from physretarget.options.judging import Profile

Array = NDArray[np.float64]

SECONDS = 3.0


@dataclass(frozen=True, eq=False)
class Base:
    """A clean motion.

    Attributes:
        name: what it is.
        character: whose.
        qpos: frames per second → (T, nq).
        profile: the validator's, for this kind of character.
        joint: name of a joint that faults of joints are planted into.
    """

    name: str
    character: Character
    qpos: Callable[[float], Array]
    joint: str
    profile: Profile = "animation"

    @property
    def joint_at(self) -> int:
        """Where that joint is in qpos."""
        return int(self.character.model.joint(self.joint).qposadr[0])


def clip_of(character: Character, qpos: Array, fps: float) -> Clip:
    """A clip of these poses."""
    return Clip(
        qpos=qpos, time=np.arange(len(qpos)) / fps, joint_names=character.joint_names,
        model_name=character.name, model_sha256=character.sha256,
    )  # fmt: skip


def times(fps: float, seconds: float = SECONDS) -> Array:
    return np.arange(round(seconds * fps) + 1) / fps


@cache
def six_legs_walk() -> Base:
    return Base(
        "six legs, walk", puppets.six_legs(), lambda fps: puppets.walk(times(fps)), "left_0_hip"
    )


@cache
def lamp_acting() -> Base:
    """The lamp looks around and nods, its base at rest."""
    character = puppets.lamp()

    def qpos(fps: float) -> Array:
        t = times(fps)
        poses = np.tile(character.reference_qpos, (len(t), 1))
        for name, size, pace in (
            ("base_yaw", 0.4, 2.0), ("elbow_pitch", 0.15, 3.1), ("head_pitch", 0.3, 4.0),
            ("head_yaw", 0.4, 2.7),
        ):  # fmt: skip
            poses[:, character.model.joint(name).qposadr[0]] += size * np.sin(pace * t)
        return poses

    return Base("lamp, acting", character, qpos, "head_yaw")


@cache
def played(subject: str, scenario: str, seed: int, joint: str = "") -> Base | None:
    """What MuJoCo simulated; None without the body's file."""
    if subject == "g1" and g1_file() is None:
        return None
    simulation = simulated(Take(subject, scenario, seed, 0))

    def qpos(fps: float) -> Array:
        return simulation.qpos[:: round(simulation.subject.steps / fps)]

    return Base(f"{subject}, {scenario}", simulation.subject.character, qpos, joint)


def hop() -> Base:
    """A hop that MuJoCo simulated, with its flight."""
    base = played("four legs", "hop", 4, "left_0_hip")
    assert base is not None
    return base


@cache
def g1(name: str) -> Base | None:
    """A generated clip of the G1, cleaned; None without the data.

    Cleaned: low-passed at 6 Hz, lifted by the median depth of its soles (they stand 2 to 3 cm in
    the floor), and on a spline through its 30 frames/s.
    """
    file = g1_file()
    if file is None:
        return None
    character = Character.load(file)
    clip = load_clip(
        Path(file).with_name(f"g1_{name}.csv"), character=character, fps=30, quat="wxyz"
    )
    smooth = lowpass(character, clip.qpos, 30, 6.0)
    smooth[:, 2] -= np.median(puppets.g1_clearance(character, smooth))
    spline = CubicSpline(clip.time, smooth)

    def qpos(fps: float) -> Array:
        poses = np.array(spline(times(fps, min(SECONDS, clip.duration))))
        poses[:, 3:7] /= np.linalg.norm(poses[:, 3:7], axis=1, keepdims=True)
        return poses

    return Base(f"G1, {name}", character, qpos, "left_elbow_joint", "robot")


def walks() -> list[Base]:
    return [b for b in (six_legs_walk(), g1("walk")) if b is not None]


def all_bases() -> list[Base]:
    return [b for b in (six_legs_walk(), lamp_acting(), g1("walk"), g1("wave")) if b is not None]


def statues() -> list[puppets.Statue]:
    found = [puppets.biped_statue(), puppets.lamp_statue()]
    walk = g1("walk")
    return found + ([puppets.g1_statue(walk.character)] if walk else [])


def crane(limit: float) -> Character:
    """A heavy box with one bar that a motor holds level: 1 kg m of load against ``limit`` N m."""
    return Character.from_xml(
        f"""<mujoco model="crane"><compiler angle="radian" autolimits="true"/>
  <worldbody><geom name="floor" type="plane" size="9 9 .1"/>
    <body name="box" pos="0 0 .2"><freejoint name="root"/>
      <geom type="box" size=".3 .3 .2" mass="30"/>
      <body pos="0 0 .3"><joint name="bar" axis="0 1 0" range="-2 2"
            actuatorfrcrange="-{limit} {limit}"/>
        <geom type="sphere" size=".05" pos=".5 0 0" mass="2" contype="0" conaffinity="0"/>
      </body></body></worldbody></mujoco>""",
        name="crane",
    )


def yaw(angle: float) -> Array:
    """The quaternion (4,) of a turn about the vertical (rad)."""
    quat = np.zeros(4)
    mujoco.mju_axisAngle2Quat(quat, np.array([0.0, 0.0, 1.0]), angle)
    return quat
