"""What each dial does to a clip, and that untouched dials do nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from physretarget import capture, dials
from physretarget.acting import hop_height
from physretarget.capture.actor import ActorMotion
from physretarget.contact import Phases
from physretarget.demo import models_folder
from physretarget.errors import InputError, UsageError
from physretarget.features import features
from physretarget.keyposes import load_keyposes
from physretarget.kinematics import trajectories
from physretarget.mapping import SharedGPLVM
from physretarget.mjcf import Character
from physretarget.options import build
from physretarget.options.retargeting import with_preset
from physretarget.pipeline import Retargeted, RetargetSettings, retarget
from physretarget.trained import TrainedMapper, learn

MODELS = models_folder()


@pytest.fixture(scope="module")
def lamp() -> Character:
    return Character.load(MODELS / "lamp.xml")


@pytest.fixture(scope="module")
def mapper(lamp: Character) -> TrainedMapper:
    return learn(lamp, load_keyposes([MODELS / "lamp.keyposes.toml"], lamp), mapper="gp")


@pytest.fixture(scope="module")
def jump(motions: Path) -> ActorMotion:
    return capture.load(motions / "humanoid3d_jump.txt")


@pytest.fixture(scope="module")
def plain(jump: ActorMotion, mapper: TrainedMapper) -> Retargeted:
    return retarget(jump, mapper, settings=RetargetSettings(fps=30))


def _turned(jump: ActorMotion, mapper: TrainedMapper, **dial: object) -> Retargeted:
    return retarget(jump, mapper, settings=RetargetSettings(fps=30, **dial))  # type: ignore[arg-type]


def test_dials_at_their_ends_change_no_bit(jump, mapper, plain) -> None:
    same = _turned(
        jump, mapper, start=0.0, end=float(jump.time[-1]), exaggerate=1.0, max_hop=100.0,
        strength={"physical": 1.0, "balanced": 1.0}, keep=(),
    )  # fmt: skip
    for name, qpos in plain.stages().items():
        assert same.stages()[name].tobytes() == qpos.tobytes(), name


def test_start_and_end_are_times_of_the_capture(jump, mapper, plain) -> None:
    part = _turned(jump, mapper, start=0.4, end=1.2, until="mapped")
    assert part.clip.time[0] == 0.0
    assert part.clip.duration == pytest.approx(0.8, abs=1 / 30)
    # filtered and mapped from there: the poses are those of the whole, but for the filter's ends
    whole = plain.y[12 : 12 + len(part.y)]
    assert np.abs(part.y - whole)[4:-4].max() < 0.02
    with pytest.raises(InputError, match=r"start is 99 s, but the capture ends at"):
        _turned(jump, mapper, start=99.0)
    with pytest.raises(UsageError, match=r"end is 1 s; it must be later than start, 2 s"):
        RetargetSettings(start=2.0, end=1.0)


def test_exaggerated_gestures_are_bigger_and_stand_all_the_same(jump, mapper, lamp, plain) -> None:
    def size(result: Retargeted) -> float:
        """RMS of the joints about their means, rad."""
        joints = result.pose.qpos[:, 7:]
        return float(np.sqrt(np.mean((joints - joints.mean(axis=0)) ** 2)))

    big = _turned(jump, mapper, exaggerate=1.4)
    small = _turned(jump, mapper, exaggerate=0.6)
    assert size(small) < 0.75 * size(plain) < size(plain) < 0.87 * size(big)
    joints = lamp.tree.scalars[0]
    assert (big.clip.qpos[:, joints] >= lamp.lower[joints] - 0.01).all()
    assert (big.clip.qpos[:, joints] <= lamp.upper[joints] + 0.01).all()
    assert big.contacted.slide_max_m < 0.002


def test_no_hop_is_higher_than_told_or_it_is_said(jump, mapper, lamp) -> None:
    free, low, lowest = (
        retarget(jump, mapper, settings=RetargetSettings(max_hop=most))
        for most in (None, 0.3, 0.05)
    )
    assert hop_height(lamp, free.clip.qpos) > 0.35 * lamp.height
    assert hop_height(lamp, low.clip.qpos) < dials.TOLERANCE * 0.3 * lamp.height
    assert low.clip.duration < free.clip.duration
    assert any("played faster" in note for note in low.notes)
    assert not any("max_hop" in note for note in low.notes)
    # Over this distance no floor could throw it any flatter.
    assert hop_height(lamp, lowest.clip.qpos) > 0.1 * lamp.height
    assert any("max_hop is 5%" in note for note in lowest.notes)


def test_a_flight_lasts_as_long_as_a_throw_of_its_height() -> None:
    time = np.arange(200) / 100
    active = np.ones((200, 1), dtype=bool)
    active[80:130] = False
    clock = dials.shorter_flights(Phases(("left_heel",), active, time), 0.1)
    assert clock is not None
    inside = (clock > time[79]) & (clock < time[130])
    assert inside.sum() / 100 == pytest.approx(np.sqrt(8 * 0.1 / 9.81) - 0.01, abs=0.015)
    assert (np.diff(clock) > 0).all()
    # far from the flight the clock runs as before
    np.testing.assert_allclose(np.diff(clock[:50]), 0.01)
    assert dials.shorter_flights(Phases(("left_heel",), active, time), 1.0) is None


def test_half_the_strength_is_half_the_move_and_planted_points_stay(
    jump, mapper, lamp, plain
) -> None:
    half = _turned(jump, mapper, strength={"balanced": 0.5, "physical": 0.5})
    none = _turned(jump, mapper, strength={"balanced": 0.0, "physical": 0.0})
    np.testing.assert_allclose(none.clip.qpos, plain.contacted.qpos, atol=1e-12)
    np.testing.assert_array_equal(none.physical.qpos, plain.contacted.qpos)
    assert half.balanced.moved.mean() == pytest.approx(0.5 * plain.balanced.moved.mean(), rel=0.1)
    residues = [each.balanced.unexplained_after.mean() for each in (plain, half, none)]
    assert residues == sorted(residues)
    np.testing.assert_allclose(
        half.physical.displacement, 0.5 * plain.physical.displacement, atol=1e-12
    )
    stood, place = half.balanced.active, lamp.contacts
    before, after = (
        trajectories(lamp.tree, qpos, place.body, place.local)
        for qpos in (half.contacted.qpos, half.clip.qpos)
    )
    assert np.abs(after - before)[stood].max() < 2e-3
    with pytest.raises(UsageError, match=r"strength names 'contacted'; .* physical, balanced"):
        RetargetSettings(strength={"contacted": 0.5})
    with pytest.raises(UsageError, match=r"strength\.balanced is 1\.5; "):
        RetargetSettings(strength={"balanced": 1.5})


def test_what_is_kept_is_as_it_was_contacted(jump, mapper, lamp, plain) -> None:
    kept = _turned(jump, mapper, keep=("0.5:0.9",))
    inside = dials.spans(kept.clip.time, ("0.5:0.9",))
    assert inside.sum() == 13
    for stage in (kept.physical, kept.balanced):
        np.testing.assert_array_equal(stage.qpos[inside], kept.contacted.qpos[inside])
    moved = np.abs(plain.clip.qpos - plain.contacted.qpos)[inside].max()
    assert moved > 1e-3  # there would have been something to mend
    assert np.abs(kept.clip.qpos - kept.contacted.qpos)[~inside].max() > 1e-3
    # no jump at the border: no faster than what the stage does elsewhere
    change = np.abs(np.diff(kept.clip.qpos - kept.contacted.qpos, axis=0)).max()
    assert change < 3 * np.abs(np.diff(plain.clip.qpos - plain.contacted.qpos, axis=0)).max()


@pytest.mark.parametrize("span", ["2", "3:2", "a:b", "1:inf", "-1:2", ""])
def test_a_range_that_is_none(span) -> None:
    with pytest.raises(UsageError, match=r"two times in seconds"):
        RetargetSettings(keep=(span,))


def test_a_range_after_the_end(jump, mapper) -> None:
    with pytest.raises(InputError, match=r"keep is '99:100', but the clip ends at"):
        _turned(jump, mapper, keep=("99:100",))


def test_the_papers_preset_is_the_paper_end_to_end(jump, lamp, mapper) -> None:
    trained = learn(lamp, load_keyposes([MODELS / "lamp.keyposes.toml"], lamp))
    settings = build(RetargetSettings, with_preset({"preset": "yamane2010", "resample": 30.0}))
    paper = retarget(jump, trained, settings=settings)
    assert list(paper.stages()) == ["mapped", "placed", "contacted", "physical"]
    assert (settings.physics, settings.heading, settings.blend) == ("paper", "momentum", "paper")
    # each frame's latent point is where the paper's search from the nearest key pose ends
    own = features(paper.actor, paper.motion.qpos)
    np.testing.assert_array_equal(paper.y, own)
    assert isinstance(trained.mapper, SharedGPLVM)
    found = trained.mapper.as_paper().predict(own)
    np.testing.assert_array_equal(paper.mapped.mean, found.mean)
    np.testing.assert_array_equal(paper.mapped.variance, found.variance)
    assert np.abs(found.mean - trained.mapper.predict(own).mean).max() > 1e-4
    # what is given itself wins
    assert with_preset({"preset": "yamane2010", "until": "mapped"})["until"] == "mapped"
    with pytest.raises(UsageError, match="search is 'nearest', which is for mapper sgplvm"):
        retarget(jump, mapper, settings=settings)
