from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from physretarget import kinematics
from physretarget.contact import ContactSettings, Phases, adjust
from physretarget.contact.carry import swivels
from physretarget.contact.turns import cuts
from physretarget.mjcf import Character

NAMES = ("left_heel", "left_toe", "right_heel", "right_toe")
FPS = 60.0
NEVER = np.zeros(0)


def turning(character: Character, frames: int, angle: np.ndarray) -> tuple:
    """The reference pose turning about the vertical by ``angle`` (frames,)."""
    time = np.arange(frames) / FPS
    qpos = np.tile(character.reference_qpos, (frames, 1))
    spin = kinematics.rotvec_to_quat(np.outer(angle, [0.0, 0.0, 1.0]))
    qpos[:, 3:7] = kinematics.quat_multiply(spin, qpos[:, 3:7])
    return time, qpos


def heading(character: Character, qpos: np.ndarray, body: str) -> np.ndarray:
    pose = kinematics.forward(character.tree, qpos)
    ahead = pose.rotation[:, character.model.body(body).id, :, 0]
    return np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))


def assert_still(result) -> None:
    assert result.slide_max_m < 0.002
    assert result.sink_max_m < 0.005


def test_a_small_turn_is_left_to_the_swivel(swivel):
    angle = 0.9 * np.sin(np.linspace(0, 2 * np.pi, 180))
    time, qpos = turning(swivel, 180, angle)
    qpos[:, 8:] = 0.4
    result = adjust(swivel, qpos, time, Phases(NAMES, np.ones((180, 4), bool), time))
    assert_still(result)
    assert len(result.stances) == 1
    np.testing.assert_allclose(np.ptp(heading(swivel, result.qpos, "base")), 0.0, atol=1e-9)
    np.testing.assert_allclose(heading(swivel, result.qpos, "head"), angle, atol=1e-6)


@pytest.mark.parametrize("seconds", [1.5, 4.0])
def test_a_full_turn_is_hopped(swivel, seconds):
    frames = round(seconds * FPS)
    angle = np.linspace(0.0, 2 * np.pi, frames)
    time, qpos = turning(swivel, frames, angle)
    result = adjust(swivel, qpos, time, Phases(NAMES, np.ones((frames, 4), bool), time))
    assert_still(result)
    assert 3 <= len(result.stances) <= 5
    assert any("turns" in note for note in result.notes)
    np.testing.assert_allclose(heading(swivel, result.qpos, "head"), angle, atol=0.02)
    off = heading(swivel, result.qpos, "base") - angle
    assert np.abs(off).max() < ContactSettings().swivel + 0.3
    speed = np.abs(kinematics.difference(swivel.tree, result.qpos[:-1], result.qpos[1:])) * FPS
    assert speed.max() < 30.0


def test_a_tilted_base_keeps_what_it_carries_where_it_was(swivel):
    angle = 0.8 * np.sin(np.linspace(0, 2 * np.pi, 120))
    time, qpos = turning(swivel, 120, angle)
    active = np.ones((120, 4), dtype=bool)
    active[40:80, 2:] = False  # rolls onto its left edge
    result = adjust(swivel, qpos, time, Phases(NAMES, active, time))
    assert_still(result)
    pose = kinematics.forward(swivel.tree, result.qpos)
    base = pose.rotation[:, swivel.root_body]
    assert np.arccos(base[:, 2, 2]).max() > 0.05
    np.testing.assert_allclose(heading(swivel, result.qpos, "head"), angle, atol=0.05)


def test_at_the_end_of_its_range_the_swivel_stops(swivel):
    angle = 1.0 * np.sin(np.linspace(0, 2 * np.pi, 120))
    time, qpos = turning(swivel, 120, angle)
    qpos[:, 7] = np.radians(120.0)
    result = adjust(swivel, qpos, time, Phases(NAMES, np.ones((120, 4), bool), time))
    assert_still(result)
    assert result.qpos[:, 7].max() == pytest.approx(np.radians(150.0), abs=1e-6)
    wanted = np.radians(120.0) + np.minimum(angle, np.radians(30.0))
    np.testing.assert_allclose(heading(swivel, result.qpos, "head"), wanted, atol=1e-3)


def test_a_box_without_a_swivel_is_turned_as_a_whole_in_more_hops(box):
    angle = np.linspace(0.0, 2 * np.pi, 240)
    time, qpos = turning(box, 240, angle)
    result = adjust(box, qpos, time, Phases(NAMES, np.ones((240, 4), bool), time))
    assert_still(result)
    assert 5 <= len(result.stances) <= 8
    assert np.abs(heading(box, result.qpos, "head") - angle).max() < 0.9


def test_feet_step_round_and_the_trunk_keeps_facing(legs):
    angle = np.linspace(0.0, np.pi, 180)
    time, qpos = turning(legs, 180, angle)
    result = adjust(legs, qpos, time, Phases(NAMES, np.ones((180, 4), bool), time))
    assert_still(result)
    for foot in ("left_foot", "right_foot"):
        assert 3 <= sum(s.body == foot for s in result.stances) <= 5
    assert np.sqrt(np.mean((heading(legs, result.qpos, "trunk") - angle) ** 2)) < 0.15
    assert (result.qpos >= legs.lower - 1e-9).all()
    assert (result.qpos <= legs.upper + 1e-9).all()


def test_what_is_a_swivel(box, swivel, legs):
    assert swivels(swivel) == [(7, 1.0)]
    assert swivels(box) == []
    assert swivels(legs) == []


def test_cuts_fall_where_the_actor_steps():
    time = np.arange(120) / FPS
    angle = np.where(time < 0.6, 0.0, np.minimum(3.5 * (time - 0.6), 2.8))
    (cut,) = cuts(angle, time, 1.2, np.array([1.05]), ContactSettings())
    assert time[cut] == pytest.approx(1.05, abs=0.04)
    assert len(cuts(0.3 * angle, time, 1.2, NEVER, ContactSettings())) == 0
    assert len(cuts(angle[:10] * 9, time[:10], 1.2, NEVER, ContactSettings())) == 0


@settings(deadline=None, max_examples=50)
@given(seed=st.integers(0, 10**6), rate=st.floats(0.1, 6.0), limit=st.floats(0.4, 1.5))
def test_pieces_keep_the_limit_where_there_is_time(seed, rate, limit):
    rng = np.random.default_rng(seed)
    time = np.arange(180) / FPS
    angle = np.cumsum(rng.uniform(-rate, rate) + 0.3 * rate * rng.standard_normal(180)) / FPS
    some = ContactSettings()
    at = cuts(angle, time, limit, NEVER, some)
    edges = np.concatenate([[0], at, [180]])
    assert (np.diff(edges) >= 1).all()
    for first, last in pairwise(edges):
        assert time[last - 1] - time[first] >= some.min_piece - 2 / FPS or not len(at)
        piece = angle[first:last]
        if 2.0 * rate * 1.5 * some.min_piece < limit:
            assert np.abs(piece - piece.mean()).max() < 1.3 * limit


def test_single_points_have_no_heading():
    """A body on one point has no heading: nothing is cut."""
    one = Character.from_xml(
        """<mujoco><worldbody><geom name="floor" type="plane" size="5 5 .1"/>
        <body name="ball"><freejoint/><geom type="sphere" size=".1" pos="0 0 .1"/>
        <site name="contact_foot"/></body></worldbody>
        <custom><text name="contact_foot" data="left_toe"/></custom></mujoco>"""
    )
    time, qpos = turning(one, 120, np.linspace(0, 6, 120))
    result = adjust(one, qpos, time, Phases(("left_toe",), np.ones((120, 1), bool), time))
    assert_still(result)
    assert len(result.stances) == 1


def test_a_foot_is_set_down_anew_where_it_is_out_of_reach_for_long() -> None:
    time = np.arange(120) / 60.0
    still, sweep = np.zeros(len(time)), np.stack([1.5 * time, 0.0 * time], axis=1)
    settings = ContactSettings()
    assert len(cuts(still, time, 0.6, NEVER, settings, off=0.6 * sweep)) == 0
    assert len(cuts(still, time, 0.6, NEVER, settings, off=2.0 * sweep)) in (1, 2, 3)
    # Pieces that would be too short to come within reach are not worth a step.
    assert len(cuts(still, time, 0.6, NEVER, settings, off=40.0 * sweep)) == 0


def test_feet_that_are_set_down_anew_take_turns() -> None:
    time = np.arange(120) / 60.0
    angle = 0.75 * np.tanh(8 * (time - 1.0))
    settings, up = ContactSettings(), np.where(np.abs(time - 1.0) < 0.1, 1.0, 0.0)
    alone = time[cuts(angle, time, 0.6, NEVER, settings)]
    in_turn = time[cuts(angle, time, 0.6, NEVER, settings, up=up)]
    assert (np.abs(alone - 1.0) < 0.1).any()
    assert not (np.abs(in_turn - 1.0) < 0.1).any()
