from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from physretarget import capture, kinematics
from physretarget.capture.actor import SEGMENT, ActorMotion, ActorShape
from physretarget.contact import detect_phases
from physretarget.demo import models_folder
from physretarget.errors import InputError, PhysretargetError, UsageError
from physretarget.keyposes import load_keyposes
from physretarget.mjcf import Character
from physretarget.pipeline import STAGES, RetargetSettings, _longest_run, retarget
from physretarget.stream import Streamer
from physretarget.trained import TrainedMapper, learn
from physretarget.validation import validate

MODELS = models_folder()


@pytest.fixture(scope="module")
def lamp() -> Character:
    return Character.load(MODELS / "lamp.xml")


@pytest.fixture(scope="module")
def mapper(lamp: Character) -> TrainedMapper:
    return learn(lamp, load_keyposes([MODELS / "lamp.keyposes.toml"], lamp))


@pytest.fixture(scope="module")
def jump(motions: Path) -> ActorMotion:
    return capture.load(motions / "humanoid3d_jump.txt")


@pytest.mark.parametrize("until", STAGES)
def test_every_stage_can_be_the_last(jump, mapper, until) -> None:
    seen: list[str] = []
    result = retarget(
        jump, mapper, settings=RetargetSettings(until=until, fps=30), progress=seen.append
    )
    stages = result.stages()
    assert list(stages) == list(STAGES[: STAGES.index(until) + 1])
    assert np.array_equal(result.clip.qpos, stages[until])
    assert np.isfinite(result.clip.qpos).all()
    assert seen == list(result.seconds)
    assert (result.clip.contact_active is not None) == (until in STAGES[2:])


def test_stages_do_what_they_promise(jump, mapper, lamp) -> None:
    result = retarget(jump, mapper)
    assert result.placed.error < 0.02
    assert result.contacted.slide_max_m < 0.002
    assert result.contacted.sink_max_m < 0.005
    physical = result.physical
    assert physical.mismatch_after <= 0.4 * physical.mismatch_before
    assert np.abs(physical.displacement).max() <= 0.15 * lamp.height


def test_physics_moves_nothing_but_the_root_height(jump, mapper) -> None:
    result = retarget(jump, mapper, settings=RetargetSettings(fps=30))
    others = [i for i in range(result.clip.qpos.shape[1]) if i != 2]
    assert np.array_equal(result.physical.qpos[:, others], result.contacted.qpos[:, others])


def test_balance_explains_more_and_keeps_what_stands(jump, mapper, lamp) -> None:
    result = retarget(jump, mapper)
    balanced = result.balanced
    assert balanced.unexplained_after.mean() < 0.1 * balanced.unexplained_before.mean()
    assert balanced.moved.max() <= 0.13 * lamp.height
    stands = balanced.active
    before, after = (
        kinematics.points(
            kinematics.forward(lamp.tree, stage.qpos), lamp.contacts.body, lamp.contacts.local
        )
        for stage in (result.contacted, balanced)
    )
    assert np.abs(after - before)[stands].max() < 5e-4
    unbalanced = replace(result.clip, qpos=result.physical.qpos)
    assert validate(result.clip, lamp).errors < validate(unbalanced, lamp).errors


def test_same_motion_same_bytes(jump, mapper) -> None:
    settings = RetargetSettings(fps=30)
    first, second = (retarget(jump, mapper, settings=settings).clip.to_bytes() for _ in range(2))
    assert first == second


def test_frame_rates(jump, mapper) -> None:
    def clip(**more):
        return retarget(jump, mapper, settings=RetargetSettings(until="mapped", **more)).clip

    assert clip().fps == pytest.approx(60)
    assert clip(fps=30).fps == pytest.approx(30)
    assert clip(fps=120).fps == pytest.approx(120)
    assert clip(max_fps=24).fps == pytest.approx(24)
    assert clip(fps=30).duration == pytest.approx(jump.time[-1], abs=1 / 30)


@pytest.mark.parametrize(
    "wrong",
    [{"fps": 0.0}, {"fps": float("nan")}, {"fps": 1e9}, {"max_fps": 0.5}, {"lowpass_hz": -1.0},
     {"until": "never"}],
)  # fmt: skip
def test_settings_that_make_no_sense(wrong) -> None:
    with pytest.raises(UsageError):
        RetargetSettings(**wrong)


def test_the_longest_usable_run_is_taken(jump, mapper) -> None:
    valid = jump.valid.copy()
    valid[:30] = False
    valid[-5] = False
    result = retarget(replace(jump, valid=valid), mapper, settings=RetargetSettings(until="mapped"))
    assert result.clip.frames == len(jump.time) - 35
    assert result.clip.time[0] == 0.0
    assert any("Frames 30 to" in note for note in result.notes)


def test_too_few_usable_frames_are_refused(jump, mapper) -> None:
    valid = np.zeros(len(jump.time), dtype=bool)
    valid[10:17] = True
    with pytest.raises(InputError, match=r"7 usable frames in a row; at least 8.*accelerations"):
        retarget(replace(jump, valid=valid), mapper)


def test_too_few_frames_at_the_rate_of_the_clip_are_refused(jump, mapper) -> None:
    settings = RetargetSettings(fps=2, lowpass_hz=None, until="mapped")
    with pytest.raises(InputError, match="only 4 frames at 2 frames per second"):
        retarget(jump, mapper, settings=settings)


def test_longest_run() -> None:
    assert _longest_run(np.array([0, 1, 1, 0, 1, 1, 1, 0], dtype=bool)) == (4, 6)
    assert _longest_run(np.zeros(3, dtype=bool)) == (0, -1)


def test_contact_phases_set_by_hand_are_used(jump, mapper) -> None:
    found = detect_phases(jump)
    standing = replace(found, active=np.ones_like(found.active))
    settings = RetargetSettings(until="contacted", fps=30)
    result = retarget(jump, mapper, settings=settings, phases=standing)
    feet = [i for i, tied in enumerate(mapper.character.tied) if tied]
    assert result.contacted.active[:, feet].all()


def test_heading_and_place_of_the_capture_do_not_change_the_character(jump, mapper) -> None:
    """A capture that begins elsewhere gives the same joints: the mapping knows no place."""
    moved = jump.qpos.copy()
    moved[:, :2] += [3.0, -2.0]
    settings = RetargetSettings(until="contacted", fps=30)
    one = retarget(jump, mapper, settings=settings).clip.qpos
    two = retarget(replace(jump, qpos=moved), mapper, settings=settings).clip.qpos
    assert np.abs(one[:, 7:] - two[:, 7:]).max() < 1e-3


CAPTURES = (".bvh", ".c3d", ".trc", ".amc")


@pytest.mark.data
@pytest.mark.slow
def test_every_real_capture_gives_a_clip_that_can_be_judged(data: Path, mapper, lamp) -> None:
    files = sorted(p for p in data.rglob("*") if p.suffix.lower() in CAPTURES)
    assert files
    failed = {}
    for path in files:
        try:
            motion = capture.load(path, fps=30, max_seconds=2.0)
            result = retarget(motion, mapper, settings=RetargetSettings(until="contacted"))
            report = validate(result.clip, lamp)
        except PhysretargetError as error:
            failed[path.name] = str(error)
            continue
        assert report.clip.frames == result.clip.frames
        assert result.contacted.slide_max_m < 0.002, path.name
        assert result.contacted.sink_max_m < 0.005, path.name
    assert failed == {}


def test_how_a_file_cuts_its_skeleton_does_not_change_the_way(jump, mapper) -> None:
    """Same legs, but a longer chain of trunk joints and shorter arms: the same path, to the mm."""
    shape = jump.shape
    offset, tip = shape.offset.copy(), shape.tip.copy()
    trunk, arms = SEGMENT["chest"], [SEGMENT[f"{side}_forearm"] for side in ("left", "right")]
    offset[trunk] *= 1.4
    offset[arms] *= 0.7
    other = replace(shape, offset=offset, tip=tip)
    assert other.leg_length == pytest.approx(shape.leg_length)
    until = RetargetSettings(until="placed")
    here = retarget(jump, mapper, settings=until)
    there = retarget(replace(jump, shape=other), mapper, settings=until)
    assert here.placed is not None
    assert there.placed is not None
    np.testing.assert_allclose(here.placed.qpos, there.placed.qpos, atol=2e-3)


def test_the_stream_goes_the_same_way(jump, mapper, lamp) -> None:
    """One momentum scale: the way of the placed root agrees within 3 %."""
    big = replace(jump, qpos=jump.qpos * np.r_[[1.15] * 3, np.ones(72)], shape=bigger(jump.shape))
    batch = retarget(big, mapper, settings=RetargetSettings(until="placed"))
    reference = batch.motion.on(ActorShape.reference())
    stream = Streamer(mapper)
    frames = zip(reference.time, reference.qpos, strict=True)
    placed = np.array([posed.placed for posed in stream.play(frames)])
    assert batch.placed is not None
    ends = [np.linalg.norm(qpos[-1, :2] - qpos[0, :2]) for qpos in (placed, batch.placed.qpos)]
    assert ends[0] == pytest.approx(ends[1], rel=0.03, abs=0.003)


def bigger(shape: ActorShape) -> ActorShape:
    """15 % larger in every length."""
    return replace(shape, offset=1.15 * shape.offset, tip=1.15 * shape.tip, heel=1.15 * shape.heel)


@pytest.mark.slow
def test_every_motion_of_the_wheel_gives_a_clip_or_a_reason(motions, mapper, lamp) -> None:
    refused = []
    for path in sorted(motions.glob("*.txt")):
        try:
            motion = capture.load(path)
        except InputError:
            refused.append(path.name)
            continue
        result = retarget(motion, mapper, settings=RetargetSettings(fps=30))
        validate(result.clip, lamp)
        assert np.abs(result.physical.displacement).max() <= 0.15 * lamp.height
        assert result.physical.mismatch_after < result.physical.mismatch_before
    assert refused == ["laikago_walk.txt"]  # a dog
