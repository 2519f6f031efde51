"""The marker fit on an actor that is known exactly, and on real captures."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from physretarget.capture.actor import SEGMENT, SEGMENTS, ActorMotion, ActorShape
from physretarget.capture.c3d import read_c3d
from physretarget.capture.marker_sets import recognise
from physretarget.capture.markers import fit_markers
from physretarget.capture.recording import MarkerRecording, Source
from physretarget.capture.trc import read_trc
from physretarget.errors import InputError
from physretarget.kinematics import forward, integrate, points, quat_to_rotvec

CMU = [
    "C7", "T10", "CLAV", "STRN", "RBAC",
    *(side + name for side in "LR" for name in (
        "FHD", "BHD", "SHO", "UPA", "ELB", "FRM", "WRA", "WRB", "FIN",
        "FWT", "BWT", "THI", "KNE", "SHN", "ANK", "HEE", "TOE", "MT5",
    )),
]  # fmt: skip
FPS = 60.0


def person() -> ActorShape:
    """Somebody of 1.62 m with long shanks, short forearms and broad shoulders."""
    shape = ActorShape.reference(height=1.62)
    offset = shape.offset.copy()
    for side, sign in (("left", 1), ("right", -1)):
        offset[SEGMENT[f"{side}_foot"], 2] -= 0.025
        offset[SEGMENT[f"{side}_hand"], 2] += 0.02
        offset[SEGMENT[f"{side}_upper_arm"], 1] += sign * 0.015
    return ActorShape.standing("person", 60, offset, shape.tip, shape.heel)


def acted(shape: ActorShape, frames: int = 180) -> np.ndarray:
    """Squats, arm swings and a turn, all known."""
    time = np.arange(frames) / FPS
    step = np.zeros((frames, 57))
    squat = 0.5 * (1 - np.cos(2 * np.pi * 0.5 * time))
    sway = np.sin(2 * np.pi * 0.7 * time)

    def turn(name: str, axis: int, value: np.ndarray) -> None:
        step[:, 3 + 3 * SEGMENT[name] + axis] = value

    leg = -shape.offset[SEGMENT["left_shank"], 2], -shape.offset[SEGMENT["left_foot"], 2]
    for side, sign in (("left", 1.0), ("right", -1.0)):
        turn(f"{side}_thigh", 1, -0.9 * squat)
        turn(f"{side}_shank", 1, 1.7 * squat)
        turn(f"{side}_foot", 1, -0.8 * squat)
        turn(f"{side}_upper_arm", 1, -1.2 * squat + 0.5 * sign * sway)
        turn(f"{side}_upper_arm", 0, sign * 0.4 * squat)
        turn(f"{side}_forearm", 1, -0.6 - 0.5 * sway)
        turn(f"{side}_hand", 0, 0.2 * sway)
    turn("abdomen", 1, 0.25 * squat)
    turn("chest", 1, 0.25 * squat)
    turn("head", 2, 0.5 * sway)
    step[:, 2] = -leg[0] * (1 - np.cos(0.9 * squat)) - leg[1] * (1 - np.cos(0.8 * squat))
    step[:, 0] = 0.05 * time
    step[:, 5] = 0.2 * time
    tree = shape.tree()
    return integrate(tree, np.tile(tree.neutral(), (frames, 1)), step)


def worn(
    shape: ActorShape, qpos: np.ndarray, noise: float = 0.001, labels: Sequence[str] = CMU
) -> MarkerRecording:
    """What cameras would see of it, each marker a little off its expected seat."""
    rng = np.random.default_rng(0)
    marks = [mark for mark in recognise(labels) if mark is not None]
    segment = np.array([mark.segment for mark in marks])
    local = np.array([mark.local for mark in marks]) * shape.height / 1.75
    local += 0.4 * np.array([[mark.spread] for mark in marks]) * rng.uniform(-1, 1, local.shape)
    at = points(forward(shape.tree(), qpos), segment + 1, local)
    at += noise * rng.standard_normal(at.shape)
    source = Source(
        path="acted.c3d", sha256="", format="c3d", unit="m", up="z", fps=FPS, frames=len(qpos)
    )
    return MarkerRecording(
        source=source, labels=tuple(labels), time=np.arange(len(qpos)) / FPS, position=at
    )


TRUTH = person()
QPOS = acted(TRUTH)
RECORDING = worn(TRUTH, QPOS)
FITTED = fit_markers(RECORDING)


def joint_error(motion: ActorMotion, frames: slice = slice(None)) -> np.ndarray:
    """(18,) RMS distance (m) of joint centres to the truth."""
    found = forward(motion.shape.tree(), motion.qpos[frames]).position[:, 1:]
    true = forward(TRUTH.tree(), QPOS[frames]).position[:, 1:]
    return np.sqrt(np.mean(np.sum((found - true) ** 2, axis=-1), axis=0))


def test_a_known_actor_is_found_again():
    assert FITTED.valid.all()
    assert FITTED.marker_error_rms < 0.004
    error = joint_error(FITTED)
    named = dict(zip(SEGMENTS, np.round(error, 4), strict=True))
    assert error.max() < 0.035, named
    assert error.mean() < 0.018, named
    assert abs(FITTED.shape.leg_length / TRUTH.leg_length - 1) < 0.03
    shank = FITTED.shape.offset[SEGMENT["left_foot"], 2]
    assert shank == pytest.approx(TRUTH.offset[SEGMENT["left_foot"], 2], abs=0.015)


def test_knees_bend_forward_and_the_feet_stand():
    knee = quat_to_rotvec(FITTED.qpos[:, 7 + 4 * (SEGMENT["left_shank"] - 1) :][:, :4])
    assert knee[:, 1].max() > 1.4
    assert knee[:, 1].min() > -0.15
    segment, local = FITTED.shape.contact_points()
    feet = points(forward(FITTED.shape.tree(), FITTED.qpos), segment[:4] + 1, local[:4])
    assert np.abs(np.median(feet[..., 2], axis=0)).max() < 0.012


def test_same_input_same_motion():
    np.testing.assert_array_equal(fit_markers(RECORDING).qpos, FITTED.qpos)


def test_short_gaps_are_filled_and_long_ones_leave_the_others_to_carry():
    position = RECORDING.position.copy()
    position[50:56, CMU.index("LELB")] = np.nan
    position[100:160, CMU.index("RTHI")] = np.nan
    motion = fit_markers(replace(RECORDING, position=position))
    assert motion.valid.all()
    assert any("1 short marker gap was" in note for note in motion.notes)
    assert any("1 long marker gap was" in note for note in motion.notes)
    assert joint_error(motion).max() < 0.04


def test_frames_without_support_are_excluded_and_bridged():
    position = RECORDING.position.copy()
    arm = [CMU.index(n) for n in ("LUPA", "LELB", "LFRM", "LWRA", "LWRB", "LFIN")]
    position[60:90, arm] = np.nan
    motion = fit_markers(replace(RECORDING, position=position))
    assert not motion.valid[60:90].any()
    assert motion.valid.sum() == len(motion.valid) - 30
    assert np.isfinite(motion.qpos).all()
    assert np.abs(np.diff(motion.qpos, axis=0)).max() < 0.1
    assert any("30 of 180 frames" in note for note in motion.notes)


def test_a_swapped_marker_does_no_harm():
    position = RECORDING.position.copy()
    a, b = CMU.index("LWRA"), CMU.index("LKNE")
    position[80:90, [a, b]] = position[80:90, [b, a]]
    motion = fit_markers(replace(RECORDING, position=position))
    assert joint_error(motion, slice(80, 90)).max() < 0.06
    assert any("leap" in note for note in motion.notes)


def test_floor_far_from_zero_is_found_and_stated():
    position = RECORDING.position + np.array([0.0, 0.0, 0.4])
    motion = fit_markers(replace(RECORDING, position=position))
    np.testing.assert_allclose(motion.qpos[:, 2], FITTED.qpos[:, 2], atol=2e-3)
    assert any(re.search(r"floor was found at \+0\.(39|4)", note) for note in motion.notes)


def test_legs_alone_are_enough():
    keep = [i for i, n in enumerate(CMU) if n[1:] in (
        "FWT", "BWT", "THI", "KNE", "SHN", "ANK", "HEE", "TOE", "MT5")]  # fmt: skip
    lower = replace(
        RECORDING,
        labels=tuple(CMU[i] for i in keep),
        position=RECORDING.position[:, keep],
    )
    motion = fit_markers(lower)
    assert motion.valid.all()
    assert any("no markers on chest, head, left arm, right arm: held" in n for n in motion.notes)
    legs = [i for i, n in enumerate(SEGMENTS) if n.endswith(("thigh", "shank", "foot"))]
    assert joint_error(motion)[legs].max() < 0.04


OTHER_SETS = {
    "Helen Hayes": ["V.Sacral", "Top.Head", "Front.Head", "Rear.Head"] + [
        f"{s}.{n}" for s in "LR" for n in (
            "ASIS", "Thigh", "Knee.Lat", "Shank", "Ankle.Lat", "Heel", "Toe.Tip", "Shoulder",
            "Elbow", "Wrist")],
    "key points": ["Neck", "midHip", "Nose"] + [
        s + n for s in "LR" for n in (
            "Hip", "Knee", "Ankle", "Heel", "BigToe", "SmallToe", "Shoulder", "Elbow", "Wrist")],
    "Qualisys animation": [
        "HeadL", "HeadTop", "HeadR", "HeadFront", "Chest", "SpineTop", "BackL", "BackR",
        "WaistLFront", "WaistRFront", "WaistL", "WaistR"] + [
        s + n for s in "LR" for n in (
            "ShoulderTop", "ShoulderBack", "Arm", "ElbowOut", "WristOut", "WristIn", "HandOut",
            "Thigh", "KneeOut", "Shin", "AnkleOut", "HeelBack", "ForefootOut", "ForefootIn",
            "ToeTip")],
    "OpenCap augmented": ["C7_study"] + [
        f"{s}{n}_study" for s in "Lr" for n in (
            ".ASIS", ".PSIS", "_knee", "_mknee", "_ankle", "_mankle", "_toe", "_5meta", "_calc",
            "_shoulder", "_thigh1", "_thigh2", "_sh1", "_sh2", "_sh3", "_lelbow", "_melbow",
            "_lwrist", "_mwrist")],
}  # fmt: skip


@pytest.mark.parametrize("name", OTHER_SETS)
def test_other_marker_sets_find_the_actor_too(name):
    labels = OTHER_SETS[name]
    motion = fit_markers(worn(TRUTH, QPOS, labels=labels))
    assert not any("not known" in note for note in motion.notes)
    assert motion.valid.all()
    assert joint_error(motion).max() < 0.045
    assert abs(motion.shape.height / TRUTH.height - 1) < 0.05


def test_two_subjects_in_one_file_are_told_apart():
    other = RECORDING.position[::-1] + np.array([2.0, 0.0, 0.0])
    labels = tuple(f"a:{n}" for n in CMU) + tuple(f"b:{n}" for n in CMU)
    both = np.concatenate([RECORDING.position, other], axis=1)
    motion = fit_markers(replace(RECORDING, labels=labels, position=both))
    np.testing.assert_allclose(motion.qpos, FITTED.qpos)
    assert any("2 subjects are in the file: a was taken, b left out" in n for n in motion.notes)


def test_mass_told_and_defaulted():
    assert fit_markers(RECORDING, mass=81.0).shape.mass == 81.0
    assert FITTED.shape.mass == pytest.approx(70 * (FITTED.shape.height / 1.75) ** 2)
    assert any("mass not given" in note for note in FITTED.notes)


def test_unknown_labels_are_named():
    strange = replace(RECORDING, labels=tuple(f"Q{i}" for i in range(len(CMU))))
    with pytest.raises(InputError, match=r"unknown: Q0, Q1.*known sets: CMU"):
        fit_markers(strange)


def test_no_supported_frame_is_an_error():
    position = RECORDING.position.copy()
    frames = np.arange(len(position))
    for k in range(position.shape[1]):  # every marker is seen, but never three at once
        position[frames % 41 != k, k] = np.nan
    with pytest.raises(InputError, match="no frame shows enough"):
        fit_markers(replace(RECORDING, position=position))


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "most", "height"),
    [
        ("c3d/85_02.c3d", 0.012, (1.65, 1.85)),
        ("c3d/cmu_dribble_shoot_basketball.c3d", 0.010, (1.70, 1.90)),
        ("c3d/Movement_trial.c3d", 0.010, (1.6, 1.85)),
        ("c3d/Qualisys.c3d", 0.010, (1.45, 1.75)),
        ("grf/opencap_subject4/DJ1.trc", 0.010, (1.55, 1.85)),
        ("grf/opencap_subject4/walking1.trc", 0.010, (1.55, 1.85)),
    ],
)
def test_real_captures(data: Path, name: str, most: float, height: tuple[float, float]):
    read = read_c3d if name.endswith("c3d") else read_trc
    motion = fit_markers(read(data / name))
    assert motion.valid.all()
    assert motion.marker_error_rms < most
    assert height[0] < motion.shape.height < height[1]
    # Joints turn no faster than a body can: no frame flips.
    turns = motion.qpos[:, 3:].reshape(-1, 18, 4)
    rate = 2 * np.arccos(np.clip(np.sum(turns[1:] * turns[:-1], axis=-1), -1, 1)) * motion.fps
    assert rate.max() < 60
    for side in ("left", "right"):
        knee = quat_to_rotvec(turns[:, SEGMENT[f"{side}_shank"]])
        assert np.percentile(knee[:, 1], 1) > -0.3
        assert knee[:, 1].max() > 0.5


@pytest.mark.data
@pytest.mark.slow
def test_a_long_martial_arts_clip(data: Path):
    motion = fit_markers(read_c3d(data / "c3d/135_02.c3d"))
    assert motion.valid.all()
    assert motion.marker_error_rms < 0.012
