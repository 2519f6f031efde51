"""Poses put down, and start poses whose limbs act for the actor's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physretarget.capture.actor import SEGMENTS
from physretarget.demo import models_folder
from physretarget.keyposes import (
    KeyPose,
    KeyPoseSet,
    actor_character_of_reference,
    check,
    load_keyposes,
    plant,
    propose,
    settled,
)
from physretarget.keyposes.limbs import limbs_of
from physretarget.keyposes.settle import Pull, pulled
from physretarget.kinematics import forward, points
from physretarget.mjcf import Character

CREATURE = """<mujoco><compiler angle="degree" autolimits="true"/>
<worldbody><geom type="plane" size="5 5 .1"/><body name="shell" pos="0 0 .2"><freejoint/>
  <geom type="box" size=".12 .1 .04" mass="2"/><site name="marker_a" pos=".1 0 0"/>
  {legs}
  <body name="claw" pos=".12 .08 0"><joint name="claw_pitch" axis="0 1 0" range="-90 90"/>
    <joint name="claw_yaw" axis="0 0 1" range="-90 90"/>
    <geom type="capsule" fromto="0 0 0 .15 .05 0" size=".02" mass=".1"/></body>
  <body name="tail" pos="-.12 0 0"><joint name="tail_yaw" axis="0 0 1" range="-40 40"/>
    <geom type="capsule" fromto="0 0 0 -.2 0 0" size=".02" mass=".1"/></body>
</body></worldbody></mujoco>"""
LEG = """<body name="leg_{n}" pos="{x} {y} 0">
  <joint name="leg_{n}_roll" axis="1 0 0" range="-80 80"/>
  <joint name="leg_{n}_pitch" axis="0 1 0" range="-80 80"/>
  <geom type="capsule" fromto="0 0 0 0 {out} -.18" size=".02" mass=".2"/>
  <site name="contact_{n}" pos="0 {out} -.2"/></body>"""


@pytest.fixture(scope="module")
def creature() -> Character:
    """A box on two legs, with one claw on its left and a tail."""
    legs = "".join(
        LEG.format(n=n, x=0, y=y, out=y / 2) for n, y in (("left", 0.1), ("right", -0.1))
    )
    return Character.from_xml(CREATURE.format(legs=legs))


def test_limbs_are_told_by_where_they_reach(creature: Character) -> None:
    """The claw is the left arm, what hangs down are legs, the tail is none."""
    names = {creature.model.body(limb.last).name: limb.name for limb in limbs_of(creature)}
    assert names == {"leg_left": "left_leg", "leg_right": "right_leg", "claw": "left_arm"}


@pytest.mark.parametrize("name", ["penguin", "squirrel"])
def test_arms_and_legs_of_the_shipped_ones(name: str) -> None:
    character = Character.load(models_folder() / f"{name}.xml")
    assert [limb.name for limb in limbs_of(character)] == [
        "left_arm", "right_arm", "left_leg", "right_leg",
    ]  # fmt: skip


def raised(side: str, degrees: float) -> np.ndarray:
    """The reference actor standing, an arm raised sidewards from hanging."""
    pose = np.array(actor_character_of_reference().reference_qpos)
    half = np.radians(degrees) / 2 * (1 if side == "left" else -1)
    at = 3 + 4 * SEGMENTS.index(f"{side}_upper_arm")
    pose[at : at + 4] = [np.cos(half), np.sin(half), 0.0, 0.0]
    return pose


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_raised_arm_raises_the_flipper_of_its_side(side: str) -> None:
    penguin = Character.load(models_folder() / "penguin.xml")
    limb = next(each for each in limbs_of(penguin) if each.name == f"{side}_arm")

    def height(actor: np.ndarray) -> float:
        pose = forward(penguin.tree, propose(penguin, actor)[None])
        tip = points(pose, np.array([limb.last]), limb.tip[None])[0, 0]
        return float(tip[2] - pose.position[0, limb.first, 2])

    assert height(raised(side, 80.0)) > height(raised(side, 0.0)) + 0.04


def sunk(keyposes: KeyPoseSet, character: Character, by: float) -> KeyPoseSet:
    at = character.root_qpos + 2
    lowered = []
    for pose in keyposes.poses:
        qpos = pose.qpos.copy()
        qpos[at] -= by
        lowered.append(replace(pose, qpos=qpos))
    return replace(keyposes, poses=tuple(lowered))


@pytest.mark.parametrize("name", ["penguin", "squirrel"])
def test_sunk_poses_are_put_down(name: str) -> None:
    character = Character.load(models_folder() / f"{name}.xml")
    whole = load_keyposes(models_folder() / f"{name}.keyposes.toml", character)
    some = replace(whole, poses=whole.poses[::4])
    bad = sunk(some, character, 0.03)
    wrong = [sum(r.severity == "error" for r in check(s, character)) for s in (some, bad)]
    assert wrong[0] == 0
    assert wrong[1] > len(some) / 2
    assert not [r for r in check(plant(bad, character), character) if r.severity == "error"]


def test_what_is_down_stays_as_it_is() -> None:
    lamp = Character.load(models_folder() / "lamp.xml")
    poses = load_keyposes(models_folder() / "lamp.keyposes.toml", lamp)
    for before, after in zip(poses.poses, plant(poses, lamp).poses, strict=True):
        np.testing.assert_allclose(after.qpos, before.qpos, atol=1e-9)


def test_a_held_joint_is_not_moved(creature: Character) -> None:
    joint = next(j for j, n in zip(creature.tree.joints, creature.joint_names, strict=True)
                 if n == "leg_left_roll")  # fmt: skip
    low = np.array(creature.reference_qpos)
    low[creature.root_qpos + 2] -= 0.05
    low[joint.qpos] = 0.3
    found = settled(creature, low, held=[joint.dof])
    assert found[joint.qpos] == pytest.approx(0.3)
    pose = KeyPose(name="p", source="", sha256="", time=0.0, qpos=found,
                   actor_qpos=actor_character_of_reference().reference_qpos)  # fmt: skip
    alone = KeyPoseSet(character_name=creature.name, character_sha256="", license="", poses=(pose,))
    assert not [r for r in check(alone, creature) if "into the floor" in r.message]


def test_no_hand_is_stronger_than_the_floor(creature: Character) -> None:
    """However far a part is pulled, what is planted stays, and nothing goes below."""
    qpos = settled(creature, creature.reference_qpos)
    claw = next(b for b in creature.bodies.tolist() if creature.model.body(b).name == "claw")
    for _ in range(20):
        qpos = pulled(creature, qpos, [Pull(claw, np.zeros(3), np.array([0.5, 0.0, -3.0]))])
    data = forward(creature.tree, qpos[None])
    assert data.position[0, 1:, 2].min() > 0.0
