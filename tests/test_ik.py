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


def steps(character: Character, qpos: np.ndarray) -> np.ndarray:
    """(T-1,) the largest change of a joint from frame to frame, rad."""
    change = kinematics.difference(character.tree, qpos[:-1], qpos[1:])
    return np.abs(change[:, 6:]).max(axis=1)


def test_features_of_no_pose_do_not_make_the_pose_leap():
    """Markers of a lamp turned inside out by degrees: no pose has them, the answer is smooth."""
    lamp = Character.load(Path(__file__).parents[1] / "models" / "lamp.xml")
    asked = features(lamp, motion(lamp, 120)).reshape(120, -1, 3)
    share = 0.5 - 0.5 * np.cos(np.linspace(0, 2 * np.pi, 120))[:, None]
    asked[..., 2] += share * (0.3 - 2 * asked[..., 2])
    asked = asked.reshape(120, -1)
    alone, together = ik.solve(lamp, asked), ik.follow(lamp, asked, 60.0)
    leap = steps(lamp, alone.qpos).max()
    assert leap > 0.5, "the case is worth testing"
    assert steps(lamp, together.qpos).max() < 0.4 * leap
    rms = [np.sqrt(np.mean(found.residual_rms**2)) for found in (together, alone)]
    assert rms[0] < 1.2 * rms[1]


WING = """<mujoco model="wing"><worldbody>
<body name="base" pos="0 0 .1"><freejoint/><geom type="box" size=".1 .08 .02" mass="2"/>
  <body name="wing" pos="0 0 .1"><joint name="swing" axis="0 1 0" range="-150 80"/>
    <joint name="raise" axis="1 0 0" range="-150 25"/><joint name="twist" axis="0 0 1"
    range="-70 70"/><geom type="box" pos="0 0 -.1" size=".03 .01 .1" mass=".3"/></body></body>
</worldbody>
<custom><numeric name="front" data="1 0 0"/><numeric name="up" data="0 0 1"/></custom></mujoco>"""


def wave(character: Character, fps: float) -> tuple[np.ndarray, np.ndarray]:
    """Features of a wing that waves evenly through where swing and twist share one axis, and start
    poses that are key poses on either side, as the nearest ones are.
    """
    time = np.arange(int(4 * fps) + 1) / fps
    qpos = np.tile(character.reference_qpos, (len(time), 1))
    phase = 2 * np.pi * 0.75 * time
    qpos[:, 7] = np.radians(-20 + 25 * np.sin(phase))
    qpos[:, 8] = np.radians(-88 - 30 * np.cos(phase))
    qpos[:, 9] = np.radians(20 * np.sin(0.5 * phase))
    start = qpos.copy()
    other = np.sin(2.3 * phase) > 0.0
    start[other, 7:10] = np.radians([-140.0, -70.0, 60.0])
    return features(character, qpos), start


def test_a_wave_through_a_singular_shoulder_is_smooth_at_any_frame_rate():
    wing = Character.from_xml(WING)
    paths = {}
    for fps in (24.0, 30.0, 60.0, 120.0):
        asked, start = wave(wing, fps)
        found = ik.follow(wing, asked, fps, start=start)
        rate = steps(wing, found.qpos) * fps
        assert rate.max() < 6.0  # the joints that made the wave moved at 2.6 rad/s
        assert found.residual_rms.max() < 0.02 * wing.height
        paths[fps] = found.qpos
    alone = ik.solve(wing, *wave(wing, 60.0)[:1], start=wave(wing, 60.0)[1])
    assert 60.0 * steps(wing, alone.qpos).max() > 60.0, "the case is worth testing"
    for fps, every in ((30.0, 1), (60.0, 2), (120.0, 4)):
        apart = kinematics.difference(wing.tree, paths[30.0], paths[fps][::every])
        assert np.abs(apart).max() < 0.05


def test_speed_costs_what_it_says():
    """A wing whose markers wave too fast is followed by its share of the price of motion."""
    wing = Character.from_xml(WING)
    time = np.arange(600) / 60.0
    qpos = np.tile(wing.reference_qpos, (len(time), 1))
    swing = np.radians(10.0) * np.sin(2 * np.pi * 5.0 * time)
    qpos[:, 7] = np.radians(-40.0) + swing
    asked = features(wing, qpos)
    shares = {}
    for settings in (
        ik.IkSettings(),
        ik.IkSettings(velocity_s=2e-3),
        ik.IkSettings(acceleration_s2=9e-5),
    ):
        found = ik.follow(wing, asked, 60.0, start=qpos, settings=settings).qpos[100:500, 7]
        shares[settings] = np.ptp(found) / np.ptp(swing)
    usual, slow, heavy = shares.values()
    assert 0.7 < usual < 0.97
    assert slow < usual - 0.02
    assert heavy < usual - 0.02


def test_a_clip_of_any_length_is_followed(arm):
    wanted = motion(arm, 41)
    for frames in (1, 2, 3, 5, 41):
        for fps in (10.0, 30.0, 120.0):
            found = ik.follow(arm, features(arm, wanted[:frames]), fps, start=wanted[:frames])
            assert found.qpos.shape == (frames, arm.tree.nq)
            assert np.isfinite(found.qpos).all()
            assert (found.qpos <= arm.upper + 1e-12).all()
            assert (found.qpos >= arm.lower - 1e-12).all()
