"""Legs that act for one foot of the actor take turns; feet of one body are left as they are."""

from __future__ import annotations

import numpy as np
import pytest

from physretarget.contact.order import legs_in_turn
from physretarget.contact.phases import Phases
from physretarget.kinematics import runs
from physretarget.mjcf import Character

NAMES = ("left_heel", "left_toe", "right_heel", "right_toe")


def beast(ties: dict[str, str]) -> Character:
    """A box on straight legs, each with a contact point of its own, tied as told."""
    legs = "".join(
        f"<body name='{leg}' pos='{x} {y} 0'><joint name='{leg}' axis='0 1 0'/>"
        f"<geom type='capsule' fromto='0 0 0 0 0 -.2' size='.02'/>"
        f"<site name='contact_{leg}' pos='0 0 -.22'/></body>"
        for leg, x, y in (
            ("fl", 0.1, 0.1),
            ("bl", -0.1, 0.1),
            ("fr", 0.1, -0.1),
            ("br", -0.1, -0.1),
        )
        if leg in ties
    )
    texts = "".join(f"<text name='contact_{leg}' data='{tie}'/>" for leg, tie in ties.items())
    return Character.from_xml(
        f"<mujoco><custom>{texts}</custom><worldbody><body><freejoint/>"
        f"<geom type='box' size='.1 .1 .03'/>{legs}</body></worldbody></mujoco>"
    )


FOUR = {"fl": "left_toe", "bl": "left_heel", "fr": "right_toe", "br": "right_heel"}


def walk(frames: int = 120) -> Phases:
    """Steps of a second: the heel lifts and lands before the toe, sides half a second apart."""
    t = np.arange(frames)
    active = np.ones((frames, 4), dtype=bool)
    for side, offset in ((0, 0), (2, 15)):
        phase = (t + offset) % 30
        active[:, side] = ~((phase >= 10) & (phase < 20))  # heel
        active[:, side + 1] = ~((phase >= 14) & (phase < 23))  # toe
    return Phases(NAMES, active, t / 30)


def test_some_leg_of_every_side_stands_while_the_other_side_does() -> None:
    before = walk()
    assert (~before.active[:, :2].any(axis=1)).any(), "both legs of a side were up"
    after = legs_in_turn(beast(FOUR), before)
    for side in (slice(0, 2), slice(2, 4)):
        assert after.active[:, side].any(axis=1).all()
    assert (after.active.sum(axis=1) >= 2).all()


def test_every_leg_still_takes_its_steps_in_its_order() -> None:
    before, after = walk(), legs_in_turn(beast(FOUR), walk())
    for column in range(4):
        was, now = (runs(~each.active[:, column]) for each in (before, after))
        for first, last in was:
            if first == 0 or last == 119:
                continue
            (mine,) = (one for one in now if first <= one[0] <= one[1] <= last)
            assert mine[1] - mine[0] >= 2, "a step within the time that it had"
    heel, toe = (runs(~after.active[:, column])[0] for column in (0, 1))
    assert heel[1] < toe[0], "what was lifted first lands before the next lifts"


def test_a_foot_of_one_body_is_left_alone() -> None:
    one = Character.from_xml(
        "<mujoco><custom><text name='contact_t' data='left_toe'/>"
        "<text name='contact_h' data='left_heel'/></custom><worldbody><body><freejoint/>"
        "<geom size='.1'/><body name='foot'><joint/><geom size='.05'/><site name='contact_t'/>"
        "<site name='contact_h' pos='-.1 0 0'/></body></body></worldbody></mujoco>"
    )
    before = walk()
    np.testing.assert_array_equal(legs_in_turn(one, before).active, before.active)


def test_flights_stay_flights() -> None:
    before = walk()
    before.active[40:50] = False
    after = legs_in_turn(beast(FOUR), before)
    assert not after.active[40:50].any()


def test_legs_that_act_for_the_same_point_cannot_take_turns() -> None:
    same = beast({"fl": "left_toe", "bl": "left_toe", "fr": "right_toe", "br": "right_toe"})
    before = walk()
    np.testing.assert_array_equal(legs_in_turn(same, before).active, before.active)


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_creature_with_two_legs_on_one_side_alone(side: str) -> None:
    front, back = ("fl", "bl") if side == "left" else ("fr", "br")
    other = "fr" if side == "left" else "fl"
    opposite = "right" if side == "left" else "left"
    three = beast({front: f"{side}_toe", back: f"{side}_heel", other: f"{opposite}_toe"})
    after = legs_in_turn(three, walk())
    mine = slice(0, 2) if side == "left" else slice(2, 4)
    theirs = slice(2, 4) if side == "left" else slice(0, 2)
    assert after.active[:, mine].any(axis=1).all()
    np.testing.assert_array_equal(after.active[:, theirs], walk().active[:, theirs])
