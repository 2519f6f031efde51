from __future__ import annotations

import math

import numpy as np
import pytest

from physretarget.capture.actor import CONTACT_POINTS
from physretarget.contact.sole import TiltCone, allowed_tilt
from physretarget.contact.soles import sole_of, standing_bodies
from physretarget.demo import models_folder
from physretarget.errors import InputError
from physretarget.keyposes import load_keyposes
from physretarget.mjcf import Character
from physretarget.stream import Streamer
from physretarget.stream.blend import Blend
from physretarget.stream.foresee import Flight, Habit
from physretarget.stream.touch import Touch
from physretarget.trained import TrainedMapper, learn


def load(name: str) -> Character:
    return Character.load(models_folder() / f"{name}.xml")


def test_the_cubic_begun_anew_in_every_frame_is_that_of_eq_9() -> None:
    blend = Blend(0.8, 9.81, np.zeros(7))
    goal, step, lasts = np.linspace(-0.1, 0.1, 7), 1 / 60, 0.5
    for k in range(1, 31):
        blend.approach(goal, step, lasts - (k - 1) * step, linear=False)
        h = k * step / lasts
        assert blend.value == pytest.approx(h * h * (3 - 2 * h) * goal, abs=1e-9)


def test_a_cubic_whose_goal_changes_goes_on_without_a_kink() -> None:
    blend = Blend(0.8, 9.81, np.zeros(7))
    path, step = [], 1 / 60
    for k in range(30):
        goal = np.full(7, 0.05 if k < 15 else 0.08)
        blend.approach(goal, step, 0.5 - k * step, linear=False)
        assert blend.value is not None
        path.append(blend.value[0])
    speed = np.diff(path) / step
    assert np.abs(np.diff(speed)).max() < 0.07
    assert path[-1] == pytest.approx(0.08)


@pytest.mark.parametrize("name", ["lamp", "penguin"])
def test_one_tilt_is_projected_as_many_are(name: str) -> None:
    character = load(name)
    sole = sole_of(character, int(standing_bodies(character)[0]))
    rng = np.random.default_rng(3)
    for _ in range(60):
        planted = rng.random(len(sole.local)) < 0.5
        if not planted.any():
            continue
        tilt = np.append(rng.normal(size=2), 0.0)
        wanted = allowed_tilt(sole, tilt[None], planted[None])[0]
        assert TiltCone.of(sole, planted).nearest(tilt) == pytest.approx(wanted, abs=1e-9)


def test_a_throw_lands_when_it_must() -> None:
    flight, step = Flight(9.81), 1 / 60
    nothing = np.zeros(len(CONTACT_POINTS), dtype=bool)
    infinite = np.full(len(CONTACT_POINTS), np.inf)
    speed, landed = 2.0, 2 * 2.0 / 9.81
    flight.next(-step, np.array([0, 0, 1.0 - speed * step]), Touch(~nothing, infinite))
    flight.next(0.0, np.array([0, 0, 1.0]), Touch(~nothing, infinite))
    for k in range(3, 12):
        time = k * step
        height = 1.0 + speed * time - 0.5 * 9.81 * time**2
        touch = Touch(nothing, infinite, clearance=max(height - 1.0, 0.0))
        left, behind = flight.next(time, np.array([0, 0, height]), touch)
        assert behind is None
        if k > 6:
            assert time + left == pytest.approx(landed, abs=0.04)


def test_habits_are_those_of_the_last_steps() -> None:
    habit = Habit()
    habit.going(1.4)
    assert 0.55 < habit.stance <= 0.6
    habit.going(3.5)
    assert habit.stance == pytest.approx(0.9 / 3.5)
    for _ in range(8):
        habit.stood(0.8)
        habit.swung(0.3)
    assert habit.stance == pytest.approx(0.8, abs=0.01)
    assert habit.swing == pytest.approx(0.3, abs=0.01)


@pytest.fixture(scope="module")
def mapper() -> TrainedMapper:
    character = load("lamp")
    return learn(
        character, load_keyposes(models_folder() / "lamp.keyposes.toml", character), mapper="pca"
    )


def test_delayed_poses_come_late_and_none_is_lost(mapper: TrainedMapper) -> None:
    streamer = Streamer(mapper, delay=0.1)
    qpos = mapper.actor.reference_qpos
    times = np.arange(20) / 60
    came = [streamer.next(float(t), qpos) for t in times]
    assert all(posed is None for posed in came[:6])
    due = [posed for posed in came if posed is not None]
    assert due[0].time == 0.0
    every = [posed.time for posed in [*due, *streamer.rest()]]
    assert every == pytest.approx(times)


@pytest.mark.parametrize("delay", [-0.1, math.nan, 60.0])
def test_impossible_delays_are_refused(mapper: TrainedMapper, delay: float) -> None:
    with pytest.raises(InputError, match="delay"):
        Streamer(mapper, delay=delay)
