from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from physretarget.capture.actor import SEGMENT, ActorShape
from physretarget.errors import InputError
from physretarget.kinematics import integrate
from physretarget.mjcf import (
    Character,
    actor_character,
    derivatives,
    momentum,
)
from physretarget.momentum import _integrated, place, scales

Array = NDArray[np.float64]

HOPPER = """
<mujoco model="hopper">
  <worldbody>
    <geom type="plane" size="0 0 1"/>
    <body name="base" pos="0 0 {base}">
      <freejoint/>
      <geom type="cylinder" size="{radius} {base}"/>
      <body name="arm" pos="0 0 {base}">
        <joint name="hip" axis="0 1 0" range="-2 2" limited="true"/>
        <joint name="side" axis="1 0 0" range="-2 2" limited="true"/>
        <geom type="capsule" fromto="0 0 0 0 0 {arm}" size="{base}"/>
        <body name="head" pos="0 0 {arm}">
          <joint name="neck" type="ball"/>
          <geom type="box" pos="{base} 0 0" size="{radius} {base} {base}"/>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def hopper(size: float = 1.0) -> Character:
    return Character.from_xml(
        HOPPER.format(base=0.03 * size, radius=0.1 * size, arm=0.3 * size), name="hopper"
    )


@pytest.fixture(scope="module")
def actor() -> Character:
    return actor_character(ActorShape.reference())


def walk(
    actor: Character, *, seconds: float = 4.0, fps: float = 60.0, curve: float = 0.0
) -> tuple[Array, Array]:
    """The actor strides at 1.2 m/s with swinging limbs, on a circle of rate `curve` (rad/s)."""
    time = np.arange(round(seconds * fps)) / fps
    beat = 2 * np.pi * 0.9 * time
    step = np.zeros((len(time), actor.model.nv))

    def swing(name: str, axis: int, angle: Array) -> None:
        step[:, 3 + 3 * SEGMENT[name] + axis] = angle

    for side, sign in (("left", 1.0), ("right", -1.0)):
        swing(f"{side}_thigh", 1, -0.4 * sign * np.sin(beat))
        swing(f"{side}_shank", 1, 0.3 - 0.3 * np.cos(beat + sign))
        swing(f"{side}_upper_arm", 1, 0.4 * sign * np.sin(beat))
    qpos = integrate(actor.tree, np.tile(actor.reference_qpos, (len(time), 1)), step)
    yaw = curve * time
    qpos[:, 3:7] = 0.0
    qpos[:, 3], qpos[:, 6] = np.cos(yaw / 2), np.sin(yaw / 2)
    if curve:
        qpos[:, 0], qpos[:, 1] = 1.2 / curve * np.sin(yaw), 1.2 / curve * (1 - np.cos(yaw))
    else:
        qpos[:, 0] = 1.2 * time
    qpos[:, 2] += 0.02 * np.cos(2 * beat)
    return qpos, time


def nodding(character: Character, time: Array) -> Array:
    qpos = np.tile(character.reference_qpos, (len(time), 1))
    qpos[:, 7] = 0.4 * np.sin(5 * time)
    qpos[:, 8] = 0.3 * np.sin(3 * time + 1)
    return qpos


@pytest.mark.parametrize("curve", [0.0, 0.7])
@pytest.mark.parametrize("fps", [30.0, 60.0, 120.0])
def test_momentum_follows_its_target(actor: Character, curve: float, fps: float) -> None:
    actor_qpos, time = walk(actor, fps=fps, curve=curve)
    character = hopper()
    placed = place(character, nodding(character, time), actor, actor_qpos, time)
    assert placed.error < 0.02
    target, got = placed.target[:, 1], placed.achieved[:, 1]
    assert np.sqrt(np.mean((got - target) ** 2)) < 0.02 * np.abs(placed.target[:, 0]).mean()
    turn, turned = placed.target_angular[:, 2], placed.achieved_angular[:, 2]
    assert np.sqrt(np.mean((turned - turn) ** 2)) < 0.02 * np.sqrt(np.mean(turn**2))
    # Recomputed here, from the result alone.
    mine = momentum(character, placed.qpos, derivatives(character, placed.qpos, time)[0])
    forward = np.cos(placed.yaw) * mine.linear[:, 0] + np.sin(placed.yaw) * mine.linear[:, 1]
    np.testing.assert_allclose(forward, placed.achieved[:, 0], atol=1e-12)


def test_a_walk_goes_forward(actor: Character) -> None:
    actor_qpos, time = walk(actor)
    character = hopper()
    standing = np.tile(character.reference_qpos, (len(time), 1))
    placed = place(character, standing, actor, actor_qpos, time)
    size = placed.scales.size[0]
    assert 0.05 < size < 0.5
    assert placed.position[-1, 0] == pytest.approx(size * 1.2 * time[-1], rel=0.02)
    assert abs(placed.position[-1, 1]) < 0.1 * placed.position[-1, 0]
    np.testing.assert_allclose(placed.qpos[:, 2], standing[:, 2], atol=1e-12)


def test_the_actor_on_itself_is_itself(actor: Character) -> None:
    actor_qpos, time = walk(actor, curve=0.7)
    placed = place(actor, actor_qpos, actor, actor_qpos, time)
    np.testing.assert_allclose(placed.qpos[:, :2], actor_qpos[:, :2], atol=2e-3)
    np.testing.assert_allclose(placed.qpos[:, 3:7], actor_qpos[:, 3:7], atol=2e-3)
    np.testing.assert_allclose(placed.qpos[:, 7:], actor_qpos[:, 7:])


def test_speed_grows_with_size(actor: Character) -> None:
    """A model twice as large in all directions goes twice as far, at eight times the mass."""
    actor_qpos, time = walk(actor)
    small, large = (
        place(each, np.tile(each.reference_qpos, (len(time), 1)), actor, actor_qpos, time)
        for each in (hopper(1.0), hopper(2.0))
    )
    assert large.position[-1, 0] == pytest.approx(2 * small.position[-1, 0], rel=1e-3)
    np.testing.assert_allclose(large.target[:, 0], 16 * small.target[:, 0], rtol=1e-6)
    np.testing.assert_allclose(large.yaw, small.yaw, atol=1e-3)


def test_scales_of_a_model_with_itself_are_one(actor: Character) -> None:
    inertia = np.tile(np.diag([3.0, 2.0, 1.0]), (5, 1, 1))
    same = scales(actor, inertia, actor, inertia)
    assert same.mass == 1.0
    np.testing.assert_array_equal(same.size, 1.0)
    np.testing.assert_array_equal(same.inertia, 1.0)


def test_heading_from_the_actor(actor: Character) -> None:
    actor_qpos, time = walk(actor, curve=0.7)
    character = hopper()
    placed = place(character, nodding(character, time), actor, actor_qpos, time, heading="actor")
    np.testing.assert_allclose(placed.yaw, 0.7 * time, atol=1e-9)
    assert placed.error < 0.02


def test_heading_and_place_of_the_mapped_pose_do_not_matter(actor: Character) -> None:
    actor_qpos, time = walk(actor)
    character = hopper()
    qpos = nodding(character, time)
    moved = qpos.copy()
    moved[:, :2] += np.column_stack([np.sin(time), time])
    moved[:, 3:7] = 0.0
    moved[:, 3], moved[:, 6] = np.cos(time), np.sin(time)
    one = place(character, qpos, actor, actor_qpos, time)
    other = place(character, moved, actor, actor_qpos, time)
    np.testing.assert_allclose(one.qpos[:, :2], other.qpos[:, :2], atol=1e-9)
    np.testing.assert_allclose(one.yaw, other.yaw, atol=1e-9)


@pytest.mark.parametrize("frames", [1, 2, 3, 4])
def test_short_clips(actor: Character, frames: int) -> None:
    actor_qpos, time = walk(actor)
    character = hopper()
    qpos = nodding(character, time[:frames])
    placed = place(character, qpos, actor, actor_qpos[:frames], time[:frames])
    assert placed.qpos.shape == qpos.shape
    assert np.isfinite(placed.qpos).all()


def test_what_cannot_be_placed(actor: Character) -> None:
    actor_qpos, time = walk(actor, seconds=0.5)
    character = hopper()
    with pytest.raises(InputError, match="poses"):
        place(character, nodding(character, time)[1:], actor, actor_qpos, time)
    fixed = replace(character, has_root=False)
    with pytest.raises(InputError, match="free joint"):
        place(fixed, nodding(character, time), actor, actor_qpos, time)


def test_integration_is_the_inverse_of_central_differences() -> None:
    time = np.arange(300) / 30.0
    path = np.column_stack([np.sin(2 * np.pi * 3 * time), time**2 - np.cos(5 * time)])
    path -= path[0]
    rate = np.gradient(path, 1 / 30, axis=0, edge_order=2)
    np.testing.assert_allclose(_integrated(rate, 1 / 30), path, atol=0.02)
    noise = np.random.default_rng(0).normal(size=3000)
    wander = _integrated(noise, 1.0)
    plain = np.cumsum(noise)
    # White noise is the worst case: no oscillation between even and odd frames may build up.
    jitter = np.abs(np.diff(wander, 2)).mean()
    assert jitter < 6 * np.abs(np.diff(plain, 2)).mean()
