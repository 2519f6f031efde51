from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from physretarget import ik, kinematics
from physretarget.errors import InputError
from physretarget.features import features, local_frame
from physretarget.mjcf import Character

ARM = """<mujoco model="arm"><worldbody>
<body name="base" pos="0 0 .1"><freejoint/><geom type="box" size=".1 .08 .02" mass="2"/>
  <body name="lower" pos="0 0 .02"><joint name="yaw" axis="0 0 1" range="-80 80"/>
    <joint name="pitch" axis="0 1 0" range="-60 60"/>
    <geom type="capsule" fromto="0 0 0 0 0 .2" size=".02" mass=".5"/>
    <body name="upper" pos="0 0 .2"><joint name="nod" type="ball"/>
      <geom type="capsule" fromto="0 0 0 .1 0 .1" size=".03" mass=".5"/></body></body>
</body></worldbody>
<custom><numeric name="front" data="1 0 0"/><numeric name="up" data="0 0 1"/></custom></mujoco>"""


@pytest.fixture(scope="module")
def arm() -> Character:
    return Character.from_xml(ARM)


def motion(character: Character, frames: int) -> np.ndarray:
    """Poses within the limits that change smoothly, at x = y = 0 with heading zero."""
    phase = np.linspace(0, 6, frames)
    speed = 1.0 + np.arange(character.tree.nv) % 5
    step = 0.3 * np.sin(np.outer(phase, speed))
    step[:, :2], step[:, 5] = 0.0, 0.0
    qpos = kinematics.integrate(
        character.tree, np.tile(character.reference_qpos, (frames, 1)), step
    )
    qpos = np.clip(qpos, character.lower, character.upper)
    return ik.facing_forward(character, qpos)


def test_poses_come_back_from_their_own_features(arm):
    wanted = motion(arm, 80)
    found = ik.solve(arm, features(arm, wanted))
    assert found.residual_rms.max() < 1e-4
    np.testing.assert_allclose(kinematics.difference(arm.tree, wanted, found.qpos), 0, atol=1e-3)
    np.testing.assert_array_equal(found.qpos[:, :2], 0.0)


def test_limits_hold_where_the_features_ask_for_more(arm):
    wanted = motion(arm, 5)
    wanted[:, arm.tree.joints[2].qpos] = np.radians(100.0)
    found = ik.solve(arm, features(arm, wanted))
    at = arm.tree.joints[2].qpos
    assert (found.qpos[:, at] <= arm.upper[at] + 1e-12).all()
    assert found.residual_rms.max() > 0.005


def test_heading_is_zero_even_for_features_that_no_pose_has(arm):
    rng = np.random.default_rng(0)
    asked = features(arm, motion(arm, 40))
    found = ik.solve(arm, asked + 0.02 * rng.standard_normal(asked.shape))
    pose = kinematics.forward(arm.tree, found.qpos)
    root = arm.root_body
    frame = local_frame(pose.position[:, root], pose.rotation[:, root], arm.front, arm.up)
    np.testing.assert_allclose(frame.yaw, 0.0, atol=1e-9)
    again = ik.facing_forward(arm, found.qpos)
    np.testing.assert_allclose(again, found.qpos, atol=1e-9)


def test_quaternions_do_not_flip(arm):
    wanted = motion(arm, 60)
    start = wanted.copy()
    start[::2, 3:7] *= -1.0
    found = ik.solve(arm, features(arm, wanted), start=start)
    ball = arm.tree.joints[-1].qpos
    for part in (slice(3, 7), slice(ball, ball + 4)):
        assert np.sum(found.qpos[1:, part] * found.qpos[:-1, part], axis=1).min() > 0.9


def test_small_changes_of_the_features_change_the_pose_little(arm):
    wanted = motion(arm, 30)
    asked = features(arm, wanted)
    here = ik.solve(arm, asked, start=wanted)
    there = ik.solve(arm, asked + 1e-5, start=wanted)
    assert np.abs(kinematics.difference(arm.tree, here.qpos, there.qpos)).max() < 1e-2


def test_features_of_another_character_are_refused(arm):
    with pytest.raises(InputError, match="columns"):
        ik.solve(arm, np.zeros((3, 5)))
    asked = features(arm, motion(arm, 9))
    asked[4, 2] = np.nan
    with pytest.raises(InputError, match="frame 4"):
        ik.solve(arm, asked)


def test_the_lamp_is_solved_too():
    lamp = Character.load(Path(__file__).parents[1] / "models" / "lamp.xml")
    wanted = motion(lamp, 60)
    found = ik.solve(lamp, features(lamp, wanted))
    assert found.residual_rms.max() < 0.002 * lamp.height


def test_features_of_no_pose_do_not_make_the_pose_leap():
    """Markers of a lamp turned inside out by degrees: no pose has them, the answer is smooth."""
    lamp = Character.load(Path(__file__).parents[1] / "models" / "lamp.xml")
    asked = features(lamp, motion(lamp, 120)).reshape(120, -1, 3)
    share = 0.5 - 0.5 * np.cos(np.linspace(0, 2 * np.pi, 120))[:, None]
    asked[..., 2] += share * (0.3 - 2 * asked[..., 2])
    asked = asked.reshape(120, -1)

    def answer(steadiness: float) -> tuple[float, float]:
        settings = ik.IkSettings(steadiness=steadiness)
        found = ik.solve(lamp, asked, settings=settings)
        step = kinematics.difference(lamp.tree, found.qpos[:-1], found.qpos[1:])
        return float(np.abs(step).max()), float(np.sqrt(np.mean(found.residual_rms**2)))

    loose, best = answer(0.0)
    steady, rms = answer(ik.IkSettings().steadiness)
    assert loose > 0.5, "the case is worth testing"
    assert steady < 0.6 * loose
    assert rms < 1.2 * best
