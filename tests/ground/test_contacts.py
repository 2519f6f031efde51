"""What touches, for how long its force shows, and what slides: as it can be worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from physretarget.ground.contacts import Contacts, bounces, contact_tolerance, find_contacts
from physretarget.ground.sliding import sliding
from physretarget.ground.support import find_support
from physretarget.ground.undersides import undersides
from physretarget.ground.wrench import centre_of_mass
from physretarget.kinematics import Pose, forward
from physretarget.mjcf import Character

HALF = 0.1
TOLERANCE = 0.01


@pytest.fixture(scope="module")
def box() -> Character:
    return Character.from_xml(
        "<mujoco><worldbody><geom type='plane' size='5 5 .1'/><body name='box' pos='0 0 .1'>"
        "<freejoint/><geom type='box' size='.1 .1 .1'/></body></worldbody></mujoco>"
    )


def poses(box: Character, x: np.ndarray, z: np.ndarray) -> Pose:
    qpos = np.zeros((len(x), 7))
    qpos[:, 0], qpos[:, 2], qpos[:, 3] = x, z + HALF, 1.0
    return forward(box.tree, qpos)


def contacts(box: Character, pose: Pose) -> Contacts:
    return find_contacts(undersides(box), pose, 0.0, TOLERANCE, None)


# ---- between two frames ------------------------------------------------------------------------


@pytest.mark.parametrize("speed", [1.0, 3.0, 8.0])
@pytest.mark.parametrize("fps", [30.0, 60.0])
def test_a_ball_that_turns_at_the_floor_between_frames_touched(speed: float, fps: float) -> None:
    """The floor is met between frames 4 and 5: these two see the force, no others."""
    gap = speed * np.abs(np.arange(10) - 4.4) / fps
    (seen,) = np.nonzero(bounces(gap[:, None], np.arange(10))[:, 0])
    assert seen.tolist() == [4, 5]


def test_a_ball_that_turns_above_the_floor_did_not_touch() -> None:
    """Thrown up and caught: 5 cm of air at its lowest."""
    time = np.arange(12) / 60 - 0.09
    gap = 0.05 + 0.5 * 9.81 * time**2
    assert not bounces(gap[:, None], np.arange(12)).any()


def test_what_comes_and_stays_did_not_bounce() -> None:
    gap = np.maximum(0.2 - 3.0 * np.arange(12) / 60, 0.05)
    assert not bounces(gap[:, None], np.arange(12)).any()


def test_frames_that_are_missing_say_nothing() -> None:
    gap = 3.0 * np.abs(np.arange(10) - 4.4) / 60
    rows = np.array([0, 1, 2, 3, 4, 6, 7, 8, 9, 10])
    assert not bounces(gap[:, None], rows).any()
    assert not bounces(gap[:3, None], np.arange(3)).any()


@pytest.mark.parametrize(("height", "tolerance"), [(0.1, 0.01), (0.5, 0.015), (2.0, 0.02)])
def test_a_contact_is_within_three_per_cent_of_the_height(height: float, tolerance: float) -> None:
    assert contact_tolerance(height) == pytest.approx(tolerance)


# ---- how long a force shows --------------------------------------------------------------------


@pytest.mark.parametrize("reach", [1, 2, 4])
def test_a_force_shows_as_far_as_it_reaches(box: Character, reach: int) -> None:
    """The box stands for ten frames, then it is gone: supported for ``reach`` frames more."""
    frames = 30
    pose = poses(box, np.zeros(frames), np.where(np.arange(frames) < 10, 0.0, 0.5))
    found = contacts(box, pose)
    none = np.zeros((*found.body.shape, 2))
    com = centre_of_mass(box, pose)
    support = find_support(found, com, none, slice(0, frames), reach)
    assert np.flatnonzero(support.within).tolist() == list(range(10 + reach))
    every = find_support(found, com, none, slice(0, frames), reach, np.ones(frames, bool))
    assert np.flatnonzero(every.mask.any(axis=1)).tolist() == list(range(10 + reach))
    assert every.away[9 + reach][every.mask[9 + reach]].min() == reach


@pytest.mark.parametrize("reach", [1, 3])
def test_the_last_frame_reaches_one_further(box: Character, reach: int) -> None:
    """A clip's ends take their acceleration from their neighbours, and so their force."""

    def last(frames: int) -> bool:
        pose = poses(box, np.zeros(frames), np.where(np.arange(frames) < 10, 0.0, 0.5))
        found = contacts(box, pose)
        none = np.zeros((*found.body.shape, 2))
        com = centre_of_mass(box, pose)
        return bool(find_support(found, com, none, slice(0, frames), reach).within[-1])

    assert last(10 + reach + 1)
    assert not last(10 + reach + 2)


# ---- sliding -----------------------------------------------------------------------------------


def speeds(box: Character, x: np.ndarray, z: np.ndarray, fps: float) -> np.ndarray:
    pose = poses(box, x, z)
    found = contacts(box, pose)
    velocity = sliding(found, pose, (pose,), 0, 1 / fps)
    return np.where(found.mask, np.linalg.norm(velocity, axis=-1), 0.0).max(axis=1)


@pytest.mark.parametrize("speed", [0.05, 0.4])
@pytest.mark.parametrize("fps", [30.0, 120.0])
def test_what_slides_slides_at_its_speed_at_any_rate(
    box: Character, speed: float, fps: float
) -> None:
    time = np.arange(int(fps)) / fps
    found = speeds(box, speed * time, np.zeros(len(time)), fps)
    away = int(fps / 30)  # what slides is seen over a thirtieth of a second
    np.testing.assert_allclose(found[away:-away], speed, rtol=1e-6)


def test_what_stands_does_not_slide(box: Character) -> None:
    assert speeds(box, np.zeros(20), np.zeros(20), 30.0).max() < 1e-12


@pytest.mark.parametrize(("slope", "slides"), [(0.15, True), (0.35, False)])
def test_what_rises_steeply_lifts_off_and_does_not_slide(
    box: Character, slope: float, slides: bool
) -> None:
    """20 mm along from one frame to the next, at most 7 mm up: still near the floor."""
    x = 0.02 * np.arange(12)
    z = np.clip(slope * (x - x[6]), 0.0, None)
    found = speeds(box, x - x[6], z, 30.0)
    assert (found[7] > 0.3) == slides


def test_a_contact_of_one_frame_slides_only_if_it_stays_near(box: Character) -> None:
    """Down for one frame at 1 m/s along: it hit the floor, it was not dragged over it."""
    z = np.full(9, 0.1)
    z[4] = 0.0
    assert speeds(box, np.arange(9) / 30, z, 30.0).max() < 1e-9


def test_the_slower_of_the_clip_as_given_and_as_filtered_counts(box: Character) -> None:
    frames, fps = 20, 30.0
    still, moving = (poses(box, s * np.arange(frames) / fps, np.zeros(frames)) for s in (0.0, 0.3))
    found = contacts(box, moving)
    velocity = sliding(found, moving, (moving, still), 0, 1 / fps)
    assert np.abs(velocity[2:-2]).max() < 1e-9
