"""Legs that are too short for their steps, soles that would roll, feet that swing."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from physretarget import kinematics
from physretarget.contact import ContactSettings, Phases, adjust
from physretarget.contact.sole import allowed_tilt, make_sole, with_underside
from physretarget.ground.undersides import lowest_heights, solids
from physretarget.mjcf import Character

NAMES = ("left_heel", "left_toe", "right_heel", "right_toe")
FPS = 60.0


def lowest(character: Character, qpos: np.ndarray) -> np.ndarray:
    """(T,) height of the lowest point of the feet; the shanks are thicker than they should be."""
    feet = [character.model.body(f"{side}_foot").id for side in ("left", "right")]
    pose = kinematics.forward(character.tree, qpos)
    return lowest_heights(solids(character, feet), pose).min(axis=1) - character.floor_height


def moving(character: Character, frames: int, speed: float, roll: float = 0.0) -> np.ndarray:
    time = np.arange(frames) / FPS
    qpos = np.tile(character.reference_qpos, (frames, 1))
    qpos[:, 0] += speed * time
    for side in ("left", "right"):
        at = character.model.joint(f"{side}_ankle_x").qposadr[0]
        qpos[:, at] += roll * np.sin(9.0 * time)
    return qpos


def test_a_foot_lets_go_where_the_legs_do_not_reach(legs: Character, walk) -> None:
    time, active = walk
    qpos = moving(legs, len(time), speed=2.0)  # steps of 1 m on legs of 0.38 m
    phases = Phases(NAMES, active, time)
    freely = adjust(legs, qpos, time, phases)
    doggedly = adjust(legs, qpos, time, phases, settings=ContactSettings(releases=0))
    assert any("shortened" in note for note in freely.notes)
    assert any("out of reach" in note for note in doggedly.notes)
    assert not any("out of reach" in note for note in freely.notes)
    stood = [sum(s.end - s.start for s in r.stances) for r in (freely, doggedly)]
    assert stood[0] < stood[1]
    assert freely.slide_max_m < 0.002
    assert freely.sink_max_m < 0.005
    assert lowest(legs, freely.qpos).min() > -0.01


def test_stances_within_reach_stay_as_they_are(legs: Character, walk) -> None:
    time, active = walk
    qpos = moving(legs, len(time), speed=0.15)
    phases = Phases(NAMES, active, time)
    one = adjust(legs, qpos, time, phases)
    other = adjust(legs, qpos, time, phases, settings=ContactSettings(releases=0))
    np.testing.assert_array_equal(one.qpos, other.qpos)


def test_feet_do_not_roll_through_the_floor(legs: Character, walk) -> None:
    """Heel and toe lie on one line: nothing but the foot's shape forbids to roll about it."""
    time, active = walk
    qpos = moving(legs, len(time), speed=0.15, roll=0.6)
    assert lowest(legs, qpos).min() < -0.012
    result = adjust(legs, qpos, time, Phases(NAMES, active, time))
    assert lowest(legs, result.qpos).min() > -0.01


def test_swinging_feet_pass_clear_of_the_floor(legs: Character, walk) -> None:
    time, active = walk
    qpos = moving(legs, len(time), speed=0.5)
    settings = ContactSettings()
    result = adjust(legs, qpos, time, Phases(NAMES, active, time), settings=settings)
    pose = kinematics.forward(legs.tree, result.qpos)
    points = kinematics.points(pose, legs.contacts.body, legs.contacts.local)
    for body in ("left_foot", "right_foot"):
        stances = [s for s in result.stances if s.body == body]
        mine = legs.contacts.body == legs.model.body(body).id
        for before, after in pairwise(stances):
            middle = (before.last + after.first) // 2
            assert points[middle, mine, 2].min() > 0.6 * settings.swing_height * legs.height


def test_a_small_step_is_a_shuffle(legs: Character, walk) -> None:
    time, active = walk
    qpos = moving(legs, len(time), speed=0.02)
    low, high = (
        adjust(
            legs, qpos, time, Phases(NAMES, active, time), settings=ContactSettings(swing_share=s)
        )
        for s in (0.2, 50.0)
    )
    rises = []
    for result in (low, high):
        pose = kinematics.forward(legs.tree, result.qpos)
        points = kinematics.points(pose, legs.contacts.body, legs.contacts.local)
        rises.append(points[..., 2].max())
    assert rises[0] < 0.5 * rises[1]


@pytest.mark.parametrize("planted", [(True, True), (True, False), (False, True)])
def test_the_underside_bounds_the_tilt(legs: Character, planted: tuple[bool, bool]) -> None:
    body = legs.model.body("left_foot").id
    mine = np.flatnonzero(legs.contacts.body == body)
    bare = make_sole(body, mine, legs.contacts.local[mine], ("left", "left"), np.eye(3))
    sole = with_underside(bare, solids(legs, [body]), 0.003)
    assert len(sole.under) == 4  # the corners of the foot's box
    wanted = np.random.default_rng(0).uniform(-0.4, 0.4, (50, 3)) * [1, 1, 0]
    mask = np.tile(planted, (50, 1))
    found = allowed_tilt(sole, wanted, mask)
    pivot = sole.foot[planted.index(True)]
    arm = np.concatenate([sole.foot, sole.print]) - pivot
    lift = found[:, :1] * arm[:, 1] - found[:, 1:2] * arm[:, 0]
    assert lift.min() > -1e-7
    if all(planted):
        np.testing.assert_allclose(found, 0.0, atol=1e-9)
        assert np.abs(allowed_tilt(bare, wanted, mask)).max() > 0.1
    else:
        assert np.abs(found).max() > 0.05, "it may still roll over its heel or toe"


def test_what_rocks_on_its_edges_has_no_underside(box: Character) -> None:
    mine = np.arange(4)
    sides = ("left", "left", "right", "right")
    bare = make_sole(1, mine, box.contacts.local, sides, np.eye(3))
    assert with_underside(bare, solids(box, [1]), 0.003) is bare
    single = make_sole(1, mine[:1], box.contacts.local[:1], sides[:1], np.eye(3))
    assert with_underside(single, solids(box, [1]), 0.003) is single


def test_the_faster_the_walk_the_shorter_it_stands(legs: Character, walk) -> None:
    time, active = walk
    stood = []
    for speed in (1.0, 1.6, 2.0):
        qpos = moving(legs, len(time), speed)
        result = adjust(legs, qpos, time, Phases(NAMES, active, time))
        assert not any("out of reach" in note for note in result.notes)
        assert result.active.any(axis=1).mean() > 0.5
        stood.append(sum(stance.end - stance.start for stance in result.stances))
    assert stood[0] > stood[1] > stood[2]
