"""Bodies of all kinds walk: the trunk keeps its posture, feet stand, joints do not leap."""

from __future__ import annotations

import numpy as np
import pytest

from physretarget import kinematics
from physretarget.contact import Contacted, ContactSettings, Phases, adjust
from physretarget.contact.leg import commands_foot
from physretarget.contact.soles import sole_of, standing_bodies
from physretarget.mjcf import Character

NAMES = ("left_heel", "left_toe", "right_heel", "right_toe")


def model(name: str, trunk: str, ties: dict[str, str]) -> Character:
    told = "".join(f'<text name="contact_{site}" data="{tie}"/>' for site, tie in ties.items())
    return Character.from_xml(
        f"""<mujoco model="{name}"><default><geom density="400"/></default><worldbody>
        <geom name="floor" type="plane" size="5 5 .1"/>{trunk}</worldbody><custom>
        <numeric name="front" data="1 0 0"/><numeric name="up" data="0 0 1"/>{told}</custom>
        </mujoco>"""
    )


def bird(*, whole: bool = False) -> Character:
    """Two legs of four joints, without hip yaw and ankle roll; ``whole`` ones have six."""

    def leg(side: str, y: float) -> str:
        yaw = f'<joint name="{side}_yaw" axis="0 0 1" range="-45 45"/>' if whole else ""
        roll = f'<joint name="{side}_ankle_roll" axis="1 0 0" range="-35 35"/>' if whole else ""
        return f"""<body name="{side}_thigh" pos="0 {y} 0">{yaw}
          <joint name="{side}_roll" axis="1 0 0" range="-40 40"/>
          <joint name="{side}_pitch" axis="0 1 0" range="-90 60"/>
          <geom type="capsule" fromto="0 0 0 .06 0 -.12" size=".025"/>
          <body name="{side}_shank" pos=".06 0 -.12">
            <joint name="{side}_knee" axis="0 1 0" range="-60 70"/>
            <geom type="capsule" fromto="0 0 0 -.09 0 -.12" size=".015"/>
            <body name="{side}_foot" pos="-.09 0 -.12">
              <joint name="{side}_ankle" axis="0 1 0" range="-70 70"/>{roll}
              <geom type="capsule" fromto="-.03 0 -.012 .1 0 -.012" size=".012"/>
              <geom type="capsule" fromto="0 0 -.012 .08 .03 -.012" size=".012"/>
              <geom type="capsule" fromto="0 0 -.012 .08 -.03 -.012" size=".012"/>
              <site name="contact_{side}_toe" pos=".1 0 -.024"/>
              <site name="contact_{side}_heel" pos="-.03 0 -.024"/></body></body></body>"""

    trunk = f"""<body name="trunk" pos="0 0 .264"><freejoint/>
      <geom type="ellipsoid" size=".14 .09 .09" pos="0 0 .06"/>
      {leg("left", 0.07)}{leg("right", -0.07)}
      <body name="neck" pos=".1 0 .1"><joint name="neck" axis="0 1 0" range="-50 60"/>
        <geom type="capsule" fromto="0 0 0 .05 0 .16" size=".025"/></body></body>"""
    return model("bird", trunk, {name: name for name in NAMES})


def crawler(pairs: int) -> Character:
    """Legs of three joints on points, in two groups that take turns as an insect's do."""
    legs, ties = "", {}
    for i, x in enumerate(np.linspace(0.18, -0.18, pairs)):
        for k, out in enumerate((1, -1)):
            name, side = f"{'lr'[k]}{i}", ("left", "right")[(i + k) % 2]
            legs += f"""<body pos="{x} {0.07 * out} 0">
              <joint name="{name}_swing" axis="0 0 1" range="-40 40"/>
              <joint name="{name}_lift" axis="{out} 0 0" range="-40 60"/>
              <geom type="capsule" fromto="0 0 0 0 {0.1 * out} .04" size=".014"/>
              <body name="{name}_shin" pos="0 {0.1 * out} .04">
                <joint name="{name}_knee" axis="{out} 0 0" range="-50 60"/>
                <geom type="capsule" fromto="0 0 0 0 {0.04 * out} -.15" size=".01"/>
                <site name="contact_{name}" pos="0 {0.04 * out} -.16"/></body></body>"""
            ties[name] = f"{side}_toe" if i < pairs / 2 else f"{side}_heel"
    trunk = f"""<body name="trunk" pos="0 0 .12"><freejoint/>
      <geom type="box" size=".22 .06 .03"/>{legs}</body>"""
    return model(f"crawler{pairs}", trunk, ties)


def snake() -> Character:
    """Seven links on the floor; every second one follows a foot."""
    links = ""
    for i in reversed(range(6)):
        links = f"""<body name="link{i}" pos="-.1 0 0">
          <joint name="yaw{i}" axis="0 0 1" range="-50 50"/>
          <joint name="pitch{i}" axis="0 1 0" range="-40 40"/>
          <geom type="capsule" fromto="0 0 0 -.1 0 0" size=".025"/>
          <site name="contact_{i}" pos="-.05 0 -.025"/>{links}</body>"""
    trunk = f"""<body name="head" pos="0 0 .025"><freejoint/>
      <geom type="capsule" fromto="0 0 0 -.1 0 0" size=".025"/>
      <site name="contact_head" pos="-.05 0 -.025"/>{links}</body>"""
    ties = {"head": "left_toe", "1": "right_toe", "3": "left_heel", "5": "right_heel"}
    return model("snake", trunk, ties)


def cart() -> Character:
    """A base on two wheels and two castors that no foot is tied to: it rolls."""
    wheels = "".join(
        f"""<body name="wheel{k}" pos="0 {y} 0"><joint name="wheel{k}" axis="0 1 0"/>
        <geom type="cylinder" size=".06 .015" euler="90 0 0"/></body>"""
        for k, y in enumerate((0.1, -0.1))
    )
    trunk = f"""<body name="base" pos="0 0 .06"><freejoint/>
      <geom type="box" size=".12 .08 .03" pos="0 0 .01"/>{wheels}
      <geom type="sphere" size=".03" pos="-.1 0 -.03"/>
      <geom type="sphere" size=".03" pos=".1 0 -.03"/>
      <site name="contact_left" pos="0 .1 -.06"/><site name="contact_right" pos="0 -.1 -.06"/>
      <body name="mast" pos="0 0 .04"><joint name="turn" axis="0 0 1" range="-100 100"/>
        <geom type="capsule" fromto="0 0 0 0 0 .2" size=".02"/></body></body>"""
    return model("cart", trunk, {})


def walking(character: Character, phases: Phases, speed: float, *, sway: float = 1.0) -> np.ndarray:
    """Poses (T, nq) of a body that strides while its feet slide, as mapped motions do.

    Steps are as long as the way that the body makes in a stance, but the feet slide by a
    fifth of it, the body bobs, and turns from side to side.
    """
    time = phases.time
    qpos = np.tile(character.reference_qpos, (len(time), 1))
    qpos[:, 0] = speed * time
    qpos[:, 2] += sway * 0.02 * character.height * np.sin(4 * np.pi * time)
    yaw, pitch = 0.1 * np.sin(2 * np.pi * time), sway * 0.05 * np.sin(4 * np.pi * time)
    turn = kinematics.rotvec_to_quat(np.stack([0 * yaw, pitch, yaw], axis=1))
    qpos[:, 3:7] = kinematics.quat_multiply(turn, qpos[:, 3:7])
    stand = kinematics.forward(character.tree, character.reference_qpos[None])
    contacts = character.contacts
    home = kinematics.points(stand, contacts.body, contacts.local)[0]
    target = np.empty((len(time), len(home), 3))
    for i, tie in enumerate(character.tied):
        side = "" if tie is None else tie.split("_")[0]
        phase = (time + (0.5 if side == "right" else 0.0)) % 1.0
        down = phase < 0.6
        swing = (phase - 0.6) / 0.4
        stride = 0.8 * 0.6 * speed
        along = np.where(down, 0.5 - phase / 0.6, 0.5 - (1 - swing) ** 2 * (1 + 2 * swing))
        target[:, i] = home[i] + qpos[:, :3] * [1, 0, 0]
        target[:, i, 0] += stride * along
        target[:, i, 2] += np.where(down, 0.0, 0.05 * character.height * np.sin(np.pi * swing))
    locked = np.zeros(character.tree.nv, dtype=bool)
    locked[:6] = True
    return kinematics.solve(
        character.tree,
        qpos,
        [kinematics.PointTargets(contacts.body, contacts.local, target)],
        lower=character.lower,
        upper=character.upper,
        locked=locked,
        prior=character.reference_qpos,
        prior_weight=1e-4,
    ).qpos


def gait(walk: tuple[np.ndarray, np.ndarray]) -> Phases:
    time, active = walk
    return Phases(NAMES, active, time)


def posture(character: Character, qpos: np.ndarray, wanted: np.ndarray) -> tuple[float, float]:
    """Farthest that the trunk leans from where it was wanted, rad, and is above or below it, m."""
    root, up = character.root_body, character.up
    upright = [kinematics.forward(character.tree, q).rotation[:, root] @ up for q in (qpos, wanted)]
    # The trunk may turn as well, and takes its lean along: only the angle to the vertical counts.
    lean = [np.arccos(np.clip(u[:, 2], -1.0, 1.0)) for u in upright]
    return float(np.abs(lean[0] - lean[1]).max()), float(np.abs(qpos[:, 2] - wanted[:, 2]).max())


def largest_step(character: Character, qpos: np.ndarray) -> float:
    step = kinematics.difference(character.tree, qpos[:-1], qpos[1:])[:, 6:]
    return float(np.abs(step).max())


def lowest_contact(character: Character, qpos: np.ndarray) -> np.ndarray:
    """(T,) height of the lowest contact point, m."""
    pose = kinematics.forward(character.tree, qpos)
    points = kinematics.points(pose, character.contacts.body, character.contacts.local)
    return points[..., 2].min(axis=1)


def assert_walks(
    character: Character, placed: np.ndarray, phases: Phases, result: Contacted, steps: float
) -> None:
    settings = ContactSettings()
    lean, rise = posture(character, result.qpos, placed)
    assert lean <= settings.trunk_tilt + 1e-6
    assert rise < 2.0 * settings.trunk_height * character.height
    asked = max(largest_step(character, placed), 0.05)
    assert largest_step(character, result.qpos) < steps * asked
    assert result.active.any(axis=1).mean() > 0.95
    assert lowest_contact(character, result.qpos).max() < 0.006  # something always stands
    assert lowest_contact(character, result.qpos).min() > -0.006


@pytest.mark.parametrize("speed", [0.15, 0.3])
@pytest.mark.parametrize("kind", ["bird", "whole bird", "four legs", "six legs", "eight legs"])
def test_legs_of_any_number_walk(walk, kind: str, speed: float) -> None:
    makers = {
        "bird": bird,
        "whole bird": lambda: bird(whole=True),
        "four legs": lambda: crawler(2),
        "six legs": lambda: crawler(3),
        "eight legs": lambda: crawler(4),
    }
    character = makers[kind]()
    phases = gait(walk)
    placed = walking(character, phases, speed)
    result = adjust(character, placed, phases.time, phases)
    assert_walks(character, placed, phases, result, 3.0)


def test_a_leg_commands_as_many_degrees_as_it_has_joints() -> None:
    for character, whole in ((bird(), False), (bird(whole=True), True), (crawler(3), True)):
        for body in standing_bodies(character).tolist():
            assert commands_foot(character, sole_of(character, body)) is whole


def test_a_foot_that_cannot_turn_by_itself_pivots_at_its_place(walk) -> None:
    """Its centre stands, its sole is on the floor, the trunk is not turned for its sake."""
    character, phases = bird(), gait(walk)
    placed = walking(character, phases, 0.3)
    result = adjust(character, placed, phases.time, phases)
    pose = kinematics.forward(character.tree, result.qpos)
    for stance in result.stances:
        body = character.model.body(stance.body).id
        inside = slice(stance.first, stance.last + 1)
        sole = sole_of(character, body)
        centre = kinematics.points(pose, np.array([body]), sole.centre[None])[inside, 0, :2]
        assert np.linalg.norm(centre - stance.position, axis=1).max() < 2e-3


@pytest.mark.parametrize("pairs", [2, 3])
def test_legs_step_round_when_the_trunk_turns(pairs: int) -> None:
    """All feet of the actor stand, and yet the trunk turns by more than any leg can hold."""
    character, time = crawler(pairs), np.arange(150) / 60.0
    placed = np.tile(character.reference_qpos, (len(time), 1))
    yaw = 1.0 * (1.0 - np.cos(np.pi * time / time[-1]))
    turn = kinematics.rotvec_to_quat(yaw[:, None] * [0.0, 0.0, 1.0])
    placed[:, 3:7] = kinematics.quat_multiply(turn, placed[:, 3:7])
    phases = Phases(NAMES, np.ones((len(time), 4), dtype=bool), time)
    result = adjust(character, placed, time, phases)
    assert largest_step(character, result.qpos) < 0.45
    assert len(result.stances) > 2 * len(character.contacts)
    assert result.slide_max_m < 0.002
    # Feet stay near their places under the trunk: none is dragged along behind it.
    contacts = character.contacts
    poses = [kinematics.forward(character.tree, qpos) for qpos in (result.qpos, placed)]
    seen = []
    for pose in poses:
        root = character.root_body
        points = kinematics.points(pose, contacts.body, contacts.local)
        seen.append((points - pose.position[:, None, root]) @ pose.rotation[:, root])
    assert np.linalg.norm((seen[0] - seen[1])[..., :2], axis=-1).max() < 0.2


def test_a_foot_in_the_air_goes_where_its_trunk_goes() -> None:
    """The last stance is long over, and the trunk goes on with the other feet's correction."""
    character, time = crawler(2), np.arange(120) / 60.0
    placed = np.tile(character.reference_qpos, (len(time), 1))
    placed[:, 0] = 0.4 * time  # every foot slides
    active = np.ones((len(time), 4), dtype=bool)
    active[40:, 1] = False
    result = adjust(character, placed, time, Phases(NAMES, active, time))
    assert largest_step(character, result.qpos) < 0.2
    up = np.array([tie == "left_toe" for tie in character.tied])
    contacts = character.contacts
    pose, before = (kinematics.forward(character.tree, q) for q in (result.qpos, placed))
    points, was = (kinematics.points(p, contacts.body, contacts.local) for p in (pose, before))
    root = character.root_body
    off = points - pose.position[:, None, root] - (was - before.position[:, None, root])
    assert np.abs(off[60:, up, :2]).max() < 0.02


def test_a_snake_stays_on_the_floor(walk) -> None:
    character, phases = snake(), gait(walk)
    placed = walking(character, phases, 0.1, sway=0.0)
    result = adjust(character, placed, phases.time, phases)
    lean, _ = posture(character, result.qpos, placed)
    assert lean <= ContactSettings().trunk_tilt + 1e-6
    assert lowest_contact(character, result.qpos).max() < 0.05  # it has let go of some stances
    assert lowest_contact(character, result.qpos).min() > -0.003


def test_what_rolls_is_left_alone(walk) -> None:
    character, phases = cart(), gait(walk)
    placed = np.tile(character.reference_qpos, (len(phases.time), 1))
    placed[:, 0] = 0.5 * phases.time
    result = adjust(character, placed, phases.time, phases)
    np.testing.assert_array_equal(result.qpos, placed)
    assert not result.active.any()
