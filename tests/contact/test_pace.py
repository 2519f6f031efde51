"""Hops of a base: how long they take, how it lands, and what its burden does meanwhile."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from physretarget import kinematics
from physretarget.contact import ContactSettings, Phases, adjust
from physretarget.contact.soles import sole_of, standing_bodies
from physretarget.contact.stances import find_footings, hop_time
from physretarget.contact.track import level_ends
from physretarget.mjcf import Character

NAMES = ("left_heel", "left_toe", "right_heel", "right_toe")


@pytest.fixture(scope="module")
def lamp() -> Character:
    return Character.load(Path(__file__).parents[2] / "models" / "lamp.xml")


def travelling(character: Character, time: np.ndarray, speed: float) -> np.ndarray:
    qpos = np.tile(character.reference_qpos, (len(time), 1))
    qpos[:, 0] += speed * time
    return qpos


def horizontal_speed(character: Character, qpos: np.ndarray, time: np.ndarray, body: str):
    at = kinematics.forward(character.tree, qpos).position[:, character.model.body(body).id, 0]
    return np.gradient(at, time)


def test_what_a_base_carries_keeps_its_pace(lamp: Character, walk) -> None:
    time, active = walk
    qpos = travelling(lamp, time, 0.6)
    phases = Phases(NAMES, active, time)
    moved = adjust(lamp, qpos, time, phases).qpos
    stiff = adjust(lamp, qpos, time, phases, settings=ContactSettings(lean=0.0)).qpos
    inner = slice(30, -30)
    base = horizontal_speed(lamp, moved, time, "base")[inner]
    head = horizontal_speed(lamp, moved, time, "shade")[inner]
    block = horizontal_speed(lamp, stiff, time, "shade")[inner]
    assert base.std() > 0.4  # it stands and leaps
    assert block.std() > 0.9 * base.std()
    assert head.std() < 0.4 * base.std()
    assert head.mean() == pytest.approx(base.mean(), rel=0.1)
    # The base goes where it went, but for flights, whose centre of mass moves straight on.
    assert np.abs(moved[:, :3] - stiff[:, :3]).max() < 0.005 * lamp.height


def test_nobody_leans_farther_than_told(lamp: Character, walk) -> None:
    time, active = walk
    qpos = travelling(lamp, time, 3.0)
    phases = Phases(NAMES, active, time)
    shade = lamp.model.body("shade").id

    def top(lean: float) -> np.ndarray:
        moved = adjust(lamp, qpos, time, phases, settings=ContactSettings(lean=lean)).qpos
        return kinematics.forward(lamp.tree, moved).position[:, shade]

    away = np.linalg.norm((top(0.1) - top(0.0))[:, :2], axis=1)
    assert 0.05 * lamp.height < away.max() < 0.12 * lamp.height


def test_who_stands_still_stays_to_the_last_bit(lamp: Character) -> None:
    time = np.arange(90) / 30.0
    qpos = travelling(lamp, time, 0.0)
    result = adjust(lamp, qpos, time, Phases(NAMES, np.ones((90, 4), dtype=bool), time))
    np.testing.assert_array_equal(result.qpos[:, 7:], qpos[:, 7:])


def test_frame_rate_changes_no_lean(lamp: Character) -> None:
    heads = []
    for fps in (30, 120):
        time = np.arange(3 * fps + 1) / fps
        left = (time % 1.0) < 0.55
        right = ((time + 0.5) % 1.0) < 0.55
        active = np.stack([left, left, right, right], axis=1)
        qpos = travelling(lamp, time, 0.5)
        moved = adjust(lamp, qpos, time, Phases(NAMES, active, time)).qpos[:: fps // 30]
        shade = lamp.model.body("shade").id
        heads.append(kinematics.forward(lamp.tree, moved).position[:, shade, 0])
    assert np.abs(heads[0] - heads[1]).max() < 0.04 * lamp.height


def test_a_hop_is_as_steep_as_the_floor_needs_it(lamp: Character, legs: Character) -> None:
    settings = ContactSettings()
    base = sole_of(lamp, int(standing_bodies(lamp)[0]))
    flat = math.sqrt(2 * 0.5 * math.tan(settings.hop_angle) / 9.81)
    for friction, slope in ((2.0, math.tan(settings.hop_angle)), (1.0, 1 / 0.95), (0.1, 2.0)):
        time = hop_time(replace(base, friction=friction), 0.5, settings)
        assert time == pytest.approx(math.sqrt(2 * 0.5 * slope / 9.81))
    # A foot that swings is not thrown: others bear the weight.
    foot = sole_of(legs, int(standing_bodies(legs)[0]))
    assert hop_time(replace(foot, friction=0.1), 0.5, settings) == pytest.approx(flat)


def test_a_stance_that_the_clip_cuts_off_gives_way(lamp: Character) -> None:
    """Its last frames know nothing of how long it lasts: it may begin as late as a hop needs."""
    time = np.arange(60) / 60.0
    sole = sole_of(lamp, int(standing_bodies(lamp)[0]))
    active = np.zeros((60, 4), dtype=bool)
    left = np.array([side == "left" for side in sole.sides])
    active[:50, left] = True
    active[48:, ~left] = True
    place = np.stack([0.8 * time, 0 * time, 0 * time], axis=1)
    settings = ContactSettings()
    found, _ = find_footings(sole, active, place, time, lamp.height, 1.0, settings)
    lasts = time[found[1].first] - time[found[0].last]
    way = float(np.linalg.norm(found[1].place[:2] - found[0].place[:2]))
    assert lasts >= hop_time(sole, way, settings) - 1 / 60
    assert time[found[1].first] - time[48] > settings.hop_share * found[1].length


def test_a_base_lands_and_leaves_flat(box: Character, walk) -> None:
    time, active = walk
    qpos = travelling(box, time, 0.4)
    result = adjust(box, qpos, time, Phases(NAMES, active, time))
    tilt = 1.0 - kinematics.quat_to_matrix(result.qpos[:, 3:7])[:, 2, 2]
    first, *between, last = result.stances
    assert len(between) > 2
    for stance in between:
        assert tilt[stance.first] < 1e-9
        assert tilt[stance.last] < 1e-9
        assert tilt[stance.first : stance.last].max() > 1e-4  # and rocks in between
        assert result.active[stance.first].all()  # all of it takes the blow
        assert result.active[stance.last].all()
    assert tilt[first.last] < 1e-9
    assert tilt[last.first] < 1e-9


def test_where_the_clip_begins_and_ends_nobody_lands() -> None:
    time = np.arange(61) / 60.0
    settings = ContactSettings()
    assert (level_ends(time, (False, False), settings) == 1.0).all()
    begun = level_ends(time, (False, True), settings)
    assert begun[0] == 1.0
    assert begun[-1] == 0.0
    both = level_ends(time, (True, True), settings)
    assert both[0] == both[-1] == 0.0
    assert both[30] == 1.0
    assert (np.diff(both[:31]) >= 0).all()


def test_a_stance_of_one_frame_is_level() -> None:
    assert level_ends(np.zeros(1), (True, False), ContactSettings()) == pytest.approx([0.0])
