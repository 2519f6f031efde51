"""How forces smear: the filter's response, and pushes that explain what it shows."""

from __future__ import annotations

import numpy as np
import pytest

from physretarget.ground.contacts import Contacts
from physretarget.ground.response import (
    MAIN_LOBE_PERIODS,
    dilated,
    explained_force,
    near_contact,
    reach_frames,
    response,
)
from physretarget.ground.support import find_support
from physretarget.mjcf import Character, lowpass

SLIDER = """<mujoco><worldbody><body><joint name="x" type="slide" axis="1 0 0"/>
<geom size=".1" mass="1"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize(("fps", "hz"), [(30.0, 6.0), (120.0, 6.0), (100.0, 12.0)])
def test_response_is_that_of_the_clips_filter(fps: float, hz: float) -> None:
    slider = Character.from_xml(SLIDER, name="slider")
    shock = np.zeros((401, 1))
    shock[200] = 1
    kernel = response(fps, hz)
    half = len(kernel) // 2
    smooth = lowpass(slider, shock, fps, hz)[200 - half : 201 + half, 0]
    np.testing.assert_allclose(kernel, smooth, atol=2e-3 * kernel.max())


def test_main_lobe_ends_where_the_response_crosses_zero() -> None:
    fps, hz = 3000.0, 6.0
    kernel = response(fps, hz)
    right = kernel[len(kernel) // 2 :]
    crossing = int(np.argmax(right < 0)) / fps
    assert crossing == pytest.approx(MAIN_LOBE_PERIODS / hz, abs=2e-3)
    assert right.min() / right.max() == pytest.approx(-np.exp(-np.pi), abs=2e-3)
    assert reach_frames(30, None) == 1
    assert reach_frames(30, 6) == 4


def test_a_filtered_shock_is_a_push_and_a_filtered_pull_is_none() -> None:
    rng = np.random.default_rng(3)
    fps, hz = 100.0, 6.0
    push = np.where(rng.random(400) < 0.05, rng.uniform(0, 30, 400), 0.0)
    kernel = response(fps, hz)
    shown = np.convolve(push, kernel, mode="same")
    assert shown.min() < -0.1
    up = np.array([0.0, 0.0, 1.0])
    anywhere = np.full(400, 0.8)
    inside = slice(60, -60)
    for friction in (anywhere, np.where(push > 0, 0.8, np.nan)):
        off = (explained_force(shown[:, None] * up, friction, fps, hz)[:, 2] - shown)[inside]
        assert np.sqrt(np.mean(off**2)) < 0.02 * np.sqrt(np.mean(shown[inside] ** 2))
    pulled = np.full((400, 1), -0.5) * up
    assert np.abs(explained_force(pulled, anywhere, fps, hz)).max() < 1e-9
    assert np.abs(explained_force(-pulled, np.full(400, np.nan), fps, hz)).max() == 0


def test_without_a_filter_the_nearest_force_of_the_cone_explains() -> None:
    force = np.array([[0, 0, 1.0], [0, 0, -2.0], [3, 0, 1.0], [0.2, 0.1, 4.0], [0, 0, 1.0]])
    friction = np.array([0.5, 0.5, 0.5, 0.5, np.nan])
    found = explained_force(force, friction, 30, None)
    # (3, 1) on the ray (1/2, 1): a share of 2.5 / 1.25 of it.
    expected = [[0, 0, 1], [0, 0, 0], [1, 0, 2], [0.2, 0.1, 4], [0, 0, 0]]
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_what_acts_between_two_frames_shows_in_both() -> None:
    nan = np.nan
    touching = np.array([nan, nan, nan, 0.4, nan, nan, nan])
    shows = near_contact(touching)
    np.testing.assert_array_equal(shows, [nan, nan, 0.4, 0.4, 0.4, nan, nan])
    np.testing.assert_array_equal(near_contact(touching[2:]), [0.4, 0.4, 0.4, nan, nan])


def test_stretches_grow_at_both_ends() -> None:
    flags = np.array([0, 0, 1, 0, 0, 0, 0, 1], dtype=bool)
    np.testing.assert_array_equal(dilated(flags, 1), np.array([0, 1, 1, 1, 0, 0, 1, 1], bool))
    assert dilated(flags, 100).all()


def test_forces_act_where_a_body_touches_nearby_with_the_arm_it_has_then() -> None:
    on = np.array([0, 0, 1, 0, 0, 0, 1, 0, 0], dtype=bool)
    place = np.zeros((9, 1, 3))
    place[2, 0], place[6, 0] = (1, 0, 0), (2, 0, 0)
    com = np.c_[np.arange(9) / 4, np.zeros(9), np.ones(9)]
    contacts = Contacts(
        place, np.full((9, 1), 5), np.ones((9, 1)), on[:, None], on[:, None], np.zeros(9),
        np.zeros(9, dtype=np.int64), np.zeros(9), np.array([5]), on[:, None], np.zeros((6, 2)), 0.0,
    )  # fmt: skip
    support = find_support(contacts, com, np.zeros((9, 1, 2)), slice(1, 9), 2)
    assert support.mask.sum(axis=1).tolist() == [0, 1, 0, 0, 0, 1, 0, 0]
    wide = find_support(contacts, com, np.zeros((9, 1, 2)), slice(1, 9), 2, np.ones(8, dtype=bool))
    assert wide.mask.sum(axis=1).tolist() == [1, 1, 1, 2, 1, 1, 1, 1]
    assert wide.own.any(axis=1).tolist() == [0, 1, 0, 0, 0, 1, 0, 0]
    assert wide.within.all()
    np.testing.assert_array_equal(wide.position[3, :2, 0], [1, 2])
    np.testing.assert_array_equal(wide.arm[0, 0], place[2, 0] - com[2])
    np.testing.assert_array_equal(wide.arm[7, 0], place[6, 0] - com[6])
