from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, partial

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from physretarget.clip import Clip
from physretarget.mjcf import Character

Array = NDArray[np.float64]

LEG = """
<body name="{side}_thigh" pos="0 {y} 0">
  <joint name="{side}_hip" type="hinge" axis="0 1 0" range="-120 120"/>
  <geom type="capsule" fromto="0 0 -.04 0 0 -.26" size=".04" mass="3"/>
  <body name="{side}_shank" pos="0 0 -.3">
    <joint name="{side}_knee" type="hinge" axis="0 1 0" range="-5 140"/>
    <geom type="capsule" fromto="0 0 -.04 0 0 -.22" size=".03" mass="2"/>
    <body name="{side}_foot" pos="0 0 -.3">
      <joint name="{side}_ankle" type="hinge" axis="0 1 0" range="-70 70"/>
      <geom type="box" size=".12 .05 .015" pos="0 0 -.025" mass="1"/>
    </body>
  </body>
</body>"""

BIPED = f"""
<mujoco model="biped">
  <compiler angle="degree"/>
  <option timestep=".0005" integrator="implicitfast"/>
  <default><geom friction="1 .01 .001" solref=".01 1"/>
    <joint damping="1" armature=".01" actuatorfrcrange="-400 400"/></default>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 .1"/>
    <body name="torso" pos="0 0 .64">
      <freejoint name="root"/>
      <geom type="box" size=".08 .12 .2" pos="0 0 .24" mass="20"/>
      {LEG.format(side="left", y=0.1)}
      {LEG.format(side="right", y=-0.1)}
    </body>
  </worldbody>
  <actuator>
    {
    "".join(
        f'<position joint="{side}_{joint}" kp="2500" kv="60"/>'
        for side in ("left", "right")
        for joint in ("hip", "knee", "ankle")
    )
}
  </actuator>
  <keyframe><key name="home" qpos="0 0 .64 1 0 0 0 0 0 0 0 0 0"/></keyframe>
</mujoco>"""


@pytest.fixture(scope="session")
def biped() -> Character:
    """A 32 kg robot with two flat feet that stands at qpos0."""
    return Character.from_xml(BIPED, name="biped")


def crouch(t: float) -> float:
    """Half the knee angle (rad) that the robot is told at time t: squat, then hop."""
    if t < 1.5:
        return 0.25 + 0.2 * (1 - np.cos(2 * np.pi * min(t, 1.5) / 1.5)) / 2
    if t < 2.0:
        return 0.25 + 0.5 * (1 - np.cos(np.pi * (t - 1.5) / 0.5)) / 2
    if t < 2.12:
        return 0.75 - 0.7 * (t - 2.0) / 0.12
    return 0.05 + 0.35 * min((t - 2.12) / 0.25, 1.0)


def simulated(character: Character, fps: float = 100.0, seconds: float = 3.2) -> Clip:
    """What MuJoCo makes of it: squat, hop, landing."""
    model = character.model
    data = mujoco.MjData(model)
    data.qpos[:] = model.key_qpos[0]
    told = crouch(0.0)
    pose = np.array([-told, 2 * told, -told] * 2)
    data.qpos[7:] = pose
    data.qpos[2] = 0.04 + 0.6 * np.cos(told)
    every = round(1 / fps / model.opt.timestep)
    steps = round(seconds / model.opt.timestep)
    qpos = []
    settle = round(0.4 / model.opt.timestep)
    for step in range(-settle, steps):
        told = crouch(max(step, 0) * model.opt.timestep)
        data.ctrl[:] = np.array([-told, 2 * told, -told] * 2)
        if step >= 0 and step % every == 0:
            qpos.append(data.qpos.copy())
        mujoco.mj_step(model, data)
    return clip_of(character, np.array(qpos), fps)


def clip_of(character: Character, qpos: Array, fps: float) -> Clip:
    """A clip of these poses."""
    return Clip(
        qpos=qpos,
        time=np.arange(len(qpos)) / fps,
        joint_names=character.joint_names,
        model_name=character.name,
        model_sha256=character.sha256,
    )


@pytest.fixture(scope="session")
def hop_at(biped: Character) -> Callable[[float], Clip]:
    """The simulated clip at a frame rate."""
    return lru_cache(partial(simulated, biped))


@pytest.fixture(scope="session")
def hop(biped: Character) -> Clip:
    """The simulated clip: nothing in it is against physics."""
    return simulated(biped)


@pytest.fixture(scope="session")
def standing(biped: Character) -> Clip:
    """A second of standing still."""
    return clip_of(biped, np.tile(biped.reference_qpos, (101, 1)), 100.0)


@pytest.fixture
def changed():  # type: ignore[no-untyped-def]
    """A copy of a clip with its qpos passed through a function of (qpos, time)."""

    def change(clip: Clip, how) -> Clip:  # type: ignore[no-untyped-def]
        return replace(clip, qpos=how(clip.qpos.copy(), clip.time))

    return change
