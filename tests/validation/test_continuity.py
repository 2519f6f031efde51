"""Frames that follow one another: what impacts may do, what only broken data does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from physretarget.clip import Clip
from physretarget.kinematics import quat_multiply
from physretarget.mjcf import Character
from physretarget.validation import Settings, validate
from physretarget.validation.continuity import Continuity, continuity

Array = NDArray[np.float64]
RATES = (30.0, 60.0, 120.0, 240.0)
DATA_RULES = ("KIN003", "KIN004", "DAT003", "DAT008", "DAT009")
PUCK = """<mujoco><worldbody><body><freejoint/><geom size=".1"/></body></worldbody></mujoco>"""


@pytest.fixture(scope="module")
def puck() -> Character:
    return Character.from_xml(PUCK, name="puck")


def seen(character: Character, qpos: Array, fps: float) -> Continuity:
    return continuity(character, lambda first, last: qpos[first:last], len(qpos), fps)


def slid(height: Array) -> Array:
    """Poses of a puck at these heights."""
    qpos = np.zeros((len(height), 7))
    qpos[:, 2], qpos[:, 3] = height, 1.0
    return qpos


@given(
    speed=st.floats(-5, 5), after=st.floats(-5, 5), when=st.floats(0.3, 0.7),
    gravity=st.floats(0, 20), fps=st.sampled_from(RATES),
)  # fmt: skip
def test_an_impact_is_no_jump_and_no_spike(
    speed: float, after: float, when: float, gravity: float, fps: float
) -> None:
    puck = Character.from_xml(PUCK, name="puck")
    t = np.arange(round(fps)) / fps
    height = np.where(t < when, speed * (t - when), after * (t - when)) - gravity * t**2 / 2
    found = seen(puck, slid(height), fps)
    # Steady acceleration shifts where the bends meet by what it moves in a step.
    allowed = gravity / fps**2 + 1e-9
    assert found.jump_position.max() <= allowed
    assert found.spike_position.max() <= allowed
    assert found.noise_position.max() <= 1e-9
    assert not found.repeats.any()


@pytest.mark.parametrize("fps", RATES)
def test_jump_and_spike_have_their_size_at_any_rate(puck: Character, fps: float) -> None:
    t = np.arange(round(2 * fps)) / fps
    path = 0.1 * np.sin(2 * np.pi * t)
    middle = len(t) // 2
    jumped = seen(puck, slid(path + 0.02 * (np.arange(len(t)) >= middle)), fps)
    assert jumped.jump_position.argmax() == middle - 1
    assert jumped.jump_position.max() == pytest.approx(0.02, rel=0.1)
    spiked = seen(puck, slid(path + 0.02 * (np.arange(len(t)) == middle)), fps)
    assert spiked.spike_position.argmax() == middle
    assert spiked.spike_position.max() == pytest.approx(0.02, rel=0.1)


@pytest.mark.parametrize("fps", RATES)
def test_noise_is_measured_in_metres_at_any_rate(puck: Character, fps: float) -> None:
    t = np.arange(round(8 * fps)) / fps
    noise = 0.004 * np.random.default_rng(7).normal(size=len(t))
    still = seen(puck, slid(noise), fps)
    assert np.median(still.noise_position) == pytest.approx(0.004, rel=0.25)
    moving = seen(puck, slid(0.1 * np.sin(4 * np.pi * t)), fps)
    assert moving.noise_position.max() < 1e-3


def test_noise_hidden_by_interpolation_is_found(puck: Character) -> None:
    t = np.arange(120) / 30
    noise = 0.004 * np.random.default_rng(1).normal(size=len(t))
    fine = np.arange(476) / 120
    found = seen(puck, slid(CubicSpline(t, noise)(fine)), 120.0)
    coarse = found.noise_step > 0.03
    assert np.median(found.noise_position[coarse]) > 0.002


@pytest.mark.parametrize("every", [2, 3, 5, 10])
def test_repeated_and_missing_frames_are_counted(puck: Character, every: int) -> None:
    t = np.arange(200) / 60
    path = slid(0.3 * np.sin(2 * np.pi * 0.2 * t))
    path[:, 0] = t
    doubled = path[np.sort(np.r_[np.arange(200), np.arange(0, 200, every)])]
    repeats = seen(puck, doubled, 60.0).repeats.sum()
    assert abs(int(repeats) - 200 // every) <= 2
    kept = np.delete(path, np.arange(20, 190, 10 * every), axis=0)
    skipped = seen(puck, kept, 60.0).skipped
    assert skipped.sum() == len(path) - len(kept)
    assert seen(puck, path, 60.0).repeats.sum() == seen(puck, path, 60.0).skipped.sum() == 0


def test_rounding_to_few_digits_repeats_nothing(puck: Character) -> None:
    t = np.arange(400) / 120
    path = slid(np.round(0.02 * np.sin(2 * np.pi * 0.2 * t), 3))
    assert not seen(puck, path, 120.0).repeats.any()


def turned(qpos: Array, degrees: float) -> Array:
    half = np.deg2rad(degrees) / 2
    late = qpos.copy()
    turn = np.array([np.cos(half), 0, 0, np.sin(half)])
    late[len(qpos) // 2 :, 3:7] = quat_multiply(turn, late[len(qpos) // 2 :, 3:7])
    return late


def trembling(qpos: Array, size: float) -> Array:
    noisy = qpos.copy()
    noisy[:, :3] += size * np.random.default_rng(5).normal(size=(len(qpos), 3))
    return noisy


def spiked(qpos: Array, size: float) -> Array:
    one = qpos.copy()
    one[len(qpos) // 3, 2] += size
    return one


def doubled(qpos: Array) -> Array:
    return qpos[np.sort(np.r_[np.arange(len(qpos)), np.arange(0, len(qpos), 5)])]


PLANTED: dict[str, tuple[Callable[[Array], Array], str]] = {
    "noise of 3 mm": (lambda q: trembling(q, 0.003), "KIN003"),
    "heading jumps by 5 degrees": (lambda q: turned(q, 5.0), "KIN004"),
    "spike of 2 cm": (lambda q: spiked(q, 0.02), "DAT009"),
    "every fifth frame doubled": (doubled, "DAT003"),
}


@pytest.mark.parametrize("fps", [25.0, 50.0, 100.0])
@pytest.mark.parametrize("fault", PLANTED)
@pytest.mark.parametrize("hz", [None, 6.0])
def test_planted_faults_are_named_filtered_or_not(
    biped: Character, hop_at: Callable[[float], Clip], fault: str, fps: float, hz: float | None
) -> None:
    clean = hop_at(fps)
    settings = Settings(profile="robot", lowpass_hz=hz, select=DATA_RULES)
    assert validate(clean, biped, settings=settings).findings == ()
    plant, code = PLANTED[fault]
    qpos = plant(clean.qpos.copy())
    broken = replace(clean, qpos=qpos, time=np.arange(len(qpos)) / fps)
    assert code in {f.code for f in validate(broken, biped, settings=settings).findings}


def test_blocks_leave_no_seam(biped: Character, monkeypatch: pytest.MonkeyPatch) -> None:
    qpos = np.tile(biped.reference_qpos, (300, 1))
    qpos[:, :3] += np.random.default_rng(2).normal(size=(300, 3))
    whole = seen(biped, qpos, 60.0)
    monkeypatch.setattr("physretarget.validation.continuity._BLOCK", 64)
    pieces = seen(biped, qpos, 60.0)
    for name in ("step", "jump_position", "spike_position", "spike_joint", "skipped", "repeats"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(pieces, name), name)
