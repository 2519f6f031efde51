"""A box on a stalk that leans by two hinges: the smallest thing with a balance to keep."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from physretarget.mjcf import Character

XML = """<mujoco model="stalk"><option gravity="0 0 -9.81"/><worldbody>
<geom name="floor" type="plane" size="5 5 .1" friction="1"/>
<body name="foot"><freejoint/>
<geom type="box" size=".1 .08 .02" pos="0 0 .02" mass="1"/>
<site name="contact_a" pos=".1 .08 0"/><site name="contact_b" pos=".1 -.08 0"/>
<site name="contact_c" pos="-.1 .08 0"/><site name="contact_d" pos="-.1 -.08 0"/>
<body name="stalk" pos="0 0 .04">
<joint name="pitch" axis="0 1 0" range="-80 80"/><joint name="roll" axis="1 0 0" range="-80 80"/>
<geom type="capsule" size=".02" fromto="0 0 0 0 0 .4" mass=".5"/>
<geom type="box" size=".06 .06 .06" pos="0 0 .45" mass="2"/>
</body></body></worldbody></mujoco>"""


@pytest.fixture(scope="module")
def stalk() -> Character:
    return Character.from_xml(XML)


@pytest.fixture
def standing() -> Callable[..., tuple[np.ndarray, np.ndarray, np.ndarray]]:
    return _standing


def _standing(seconds: float = 2.0, fps: float = 60.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """qpos (T, 9) upright on all four points, time (T,), active (T, 4)."""
    time = np.arange(round(seconds * fps)) / fps
    qpos = np.zeros((len(time), 9))
    qpos[:, 3] = 1.0
    return qpos, time, np.ones((len(time), 4), dtype=bool)
