from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from physretarget.mjcf import Character
from physretarget.replay import Forces, Mark, Scene, figure

HOPPER = """
<mujoco model="hopper">
  <asset>
    <material name="paint" rgba="0.9 0.1 0.1 1" emission="1"/>
    <mesh name="wedge" vertex="0 0 0  0.1 0 0  0 0.1 0  0 0 0.1"/>
  </asset>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 0.1"/>
    <body name="trunk" pos="0 0 0.5">
      <freejoint/>
      <geom name="plain" type="box" size="0.1 0.05 0.2" mass="2"/>
      <geom name="painted" type="sphere" size="0.06" pos="0 0 0.3" material="paint" mass="1"/>
      <geom name="unseen" type="sphere" size="0.5" group="3" mass="0"/>
      <geom name="speck" type="sphere" size="0.0001" mass="0"/>
      <body name="leg" pos="0 0 -0.2">
        <joint name="hip" type="hinge" axis="0 1 0"/>
        <geom name="shin" type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03" rgba="0 0 1 0.5"/>
        <geom type="mesh" mesh="wedge" mass="0.1"/>
        <site name="contact_toe" pos="0 0 -0.3"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


@dataclass(frozen=True, eq=False)
class Motion:
    character: Character
    qpos: np.ndarray
    time: np.ndarray


@pytest.fixture(scope="session")
def motion() -> Motion:
    character = Character.from_xml(HOPPER, name="hopper")
    time = np.arange(40) / 20.0
    qpos = np.zeros((40, character.model.nq))
    qpos[:, 0] = time
    qpos[:, 2] = 0.5 + 0.2 * np.abs(np.sin(3 * time))
    half = 1.7 * time
    qpos[:, 3], qpos[:, 6] = np.cos(half), np.sin(half)
    qpos[:, 7] = 0.4 * np.sin(2 * time)
    # The same rotation with the other sign: what comes out of many files.
    qpos[20:, 3:7] *= -1
    return Motion(character, qpos, time)


@pytest.fixture
def scene(motion: Motion) -> Scene:
    frames = len(motion.time)
    origin = np.zeros((frames, 1, 3))
    vector = np.tile([0.0, 0.0, 1.0], (frames, 1, 1))
    vector[5] = np.nan
    active = np.zeros((frames, 1), dtype=bool)
    active[10:20] = True
    return Scene(
        title="hop </script><script>alert(1)</script>",
        time=motion.time,
        figures=(
            figure(motion.character, motion.qpos, name="<img src=x>", offset=(0, 1, 0)),
            figure(
                motion.character,
                motion.qpos,
                name="lower",
                contact_active=active,
                forces=Forces(origin, vector),
            ),
        ),
        marks=(Mark("DYN001", "error", "too <b>bold</b>", 4, 9, 6),),
        layout="split",
    )


@pytest.fixture(scope="session")
def backend() -> str:
    from physretarget.gl import NoRenderingError, choose_backend

    try:
        return choose_backend()
    except NoRenderingError as error:
        pytest.skip(str(error))
