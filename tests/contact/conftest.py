"""Small characters to plant: a box with two links, and one on two legs."""

from __future__ import annotations

import numpy as np
import pytest

from physretarget.mjcf import Character

TIES = "".join(
    f'<text name="contact_{side}_{part}" data="{side}_{part}"/>'
    for side in ("left", "right")
    for part in ("toe", "heel")
)
CUSTOM = f"""<custom><numeric name="front" data="1 0 0"/><numeric name="up" data="0 0 1"/>
{TIES}</custom>"""

BOX = f"""<mujoco model="box"><worldbody>
<geom name="floor" type="plane" size="5 5 .1"/>
<body name="base" pos="0 0 0">
  <freejoint/>
  <geom type="box" size=".1 .08 .02" pos="0 0 .02" mass="2"/>
  <site name="contact_left_toe" pos=".1 .08 0"/><site name="contact_left_heel" pos="-.1 .08 0"/>
  <site name="contact_right_toe" pos=".1 -.08 0"/>
  <site name="contact_right_heel" pos="-.1 -.08 0"/>
  <body name="arm" pos="0 0 .04"><joint name="pitch" axis="0 1 0" range="-90 90"/>
    <geom type="capsule" fromto="0 0 0 0 0 .2" size=".02" mass=".5"/>
    <body name="head" pos="0 0 .2"><joint name="nod" axis="0 1 0" range="-90 90"/>
      <geom type="capsule" fromto="0 0 0 0 0 .2" size=".03" mass=".5"/></body></body>
</body></worldbody>{CUSTOM}</mujoco>"""


def _leg(side: str, y: float) -> str:
    return f"""<body name="{side}_leg" pos="0 {y} 0">
  <joint name="{side}_hip_x" axis="1 0 0" range="-60 60"/>
  <joint name="{side}_hip_y" axis="0 1 0" range="-90 90"/>
  <joint name="{side}_hip_z" axis="0 0 1" range="-60 60"/>
  <geom type="capsule" fromto="0 0 0 0 0 -.2" size=".03" mass=".5"/>
  <body name="{side}_shank" pos="0 0 -.2"><joint name="{side}_knee" axis="0 1 0" range="0 140"/>
    <geom type="capsule" fromto="0 0 0 0 0 -.18" size=".03" mass=".4"/>
    <body name="{side}_foot" pos="0 0 -.18">
      <joint name="{side}_ankle_y" axis="0 1 0" range="-60 60"/>
      <joint name="{side}_ankle_x" axis="1 0 0" range="-40 40"/>
      <geom type="box" size=".08 .03 .01" pos=".03 0 -.01" mass=".2"/>
      <site name="contact_{side}_toe" pos=".11 0 -.02"/>
      <site name="contact_{side}_heel" pos="-.05 0 -.02"/></body></body></body>"""


LEGS = f"""<mujoco model="legs"><worldbody>
<geom name="floor" type="plane" size="5 5 .1"/>
<body name="trunk" pos="0 0 .38"><freejoint/>
  <geom type="box" size=".06 .1 .1" pos="0 0 .1" mass="4"/>
  {_leg("left", 0.08)}{_leg("right", -0.08)}
</body></worldbody>{CUSTOM}
<keyframe><key name="stand" qpos="0 0 .38 1 0 0 0  0 -.3 0 .6 -.3 0  0 -.3 0 .6 -.3 0"/></keyframe>
</mujoco>"""

NAMES = ("left_heel", "left_toe", "right_heel", "right_toe")


@pytest.fixture(scope="session")
def box() -> Character:
    return Character.from_xml(BOX)


@pytest.fixture(scope="session")
def legs() -> Character:
    return Character.from_xml(LEGS)


@pytest.fixture(scope="session")
def walk() -> tuple[np.ndarray, np.ndarray]:
    """Times (T,) and planted (T, 4) of NAMES: 3 s at 60 fps, one step per half second."""
    time = np.arange(180) / 60

    def foot(phase: np.ndarray) -> list[np.ndarray]:
        return [phase < 0.4, (phase > 0.06) & (phase < 0.6)]

    return time, np.stack([*foot(time % 1.0), *foot((time + 0.5) % 1.0)], axis=1)


SWIVEL = BOX.replace(
    '<joint name="pitch" axis="0 1 0" range="-90 90"/>',
    '<joint name="turn" axis="0 0 1" range="-150 150"/><joint name="pitch" axis="0 1 0" '
    'range="-90 90"/>',
)


@pytest.fixture(scope="session")
def swivel() -> Character:
    """The box, with an arm that turns about the vertical."""
    return Character.from_xml(SWIVEL)
