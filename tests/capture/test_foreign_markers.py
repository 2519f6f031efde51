"""Quirks of other people's marker files, each of which once was refused or misread."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physretarget.capture.actor import ActorShape
from physretarget.capture.marker_sets import recognise, subjects, up_axis, upside_down
from physretarget.capture.markers import fit_markers
from physretarget.capture.recording import MarkerRecording, Source
from physretarget.errors import InputError
from physretarget.kinematics import forward, points

FPS = 30.0
PLUG_IN_GAIT = [
    "LFHD",
    "RFHD",
    "LBHD",
    "RBHD",
    "C7",
    "T10",
    "CLAV",
    "STRN",
    "LSHO",
    "LELB",
    "LWRA",
    "LWRB",
    "LFIN",
    "RSHO",
    "RELB",
    "RWRA",
    "RWRB",
    "RFIN",
    "LASI",
    "RASI",
    "LPSI",
    "RPSI",
    "LTHI",
    "LKNE",
    "LTIB",
    "LANK",
    "LHEE",
    "LTOE",
    "RTHI",
    "RKNE",
    "RTIB",
    "RANK",
    "RHEE",
    "RTOE",
]
LIMBS = ["hip", "knee", "ankle", "shoulder", "elbow", "wrist"]
COCO = ["Nose", *(f"{side}{joint.title()}" for side in "LR" for joint in LIMBS)]
MEDIAPIPE = [
    "nose",
    *(
        f"{side}_{joint}"
        for side in ("left", "right")
        for joint in (*LIMBS, "heel", "foot_index", "pinky", "index")
    ),
]
HALPE = [
    *COCO,
    *["Hip", "Neck", "Head", "LBigToe", "LSmallToe", "LHeel", "RBigToe", "RSmallToe", "RHeel"],
]


def worn(labels: list[str], *, as_if: list[str] | None = None) -> MarkerRecording:
    """Somebody who bends both knees, with these markers; placed where ``as_if`` belong."""
    shape = ActorShape.reference()
    tree = shape.tree()
    frames = 12
    qpos = np.tile(tree.neutral(), (frames, 1))
    bend = np.linspace(0.0, 0.9, frames)
    for joint, turn in (("thigh", -1.0), ("shank", 2.0), ("foot", -1.0)):
        for side in ("left", "right"):
            at = 3 + 4 * _index(f"{side}_{joint}")
            qpos[:, at], qpos[:, at + 2] = np.cos(turn * bend / 2), np.sin(turn * bend / 2)
    pose = forward(tree, qpos)
    marks = recognise(as_if or labels)
    position = np.full((frames, len(labels), 3), np.nan)
    for i, mark in enumerate(marks):
        if mark is not None:
            position[:, i] = points(pose, np.array([mark.segment + 1]), mark.local[None])[:, 0]
    return MarkerRecording(
        source=Source(
            path="made.trc", sha256="0" * 64, format="trc", unit="m", up="z", fps=FPS, frames=frames
        ),
        labels=tuple(labels),
        time=np.arange(frames) / FPS,
        position=position,
        notes=(),
    )


def _index(segment: str) -> int:
    from physretarget.capture.actor import SEGMENT

    return SEGMENT[segment]


def knees(motion) -> np.ndarray:
    """Flexion (T, 2) of the knees, rad; positive is how knees bend."""
    at = [3 + 4 * _index(f"{side}_shank") for side in ("left", "right")]
    quat = np.stack([motion.qpos[:, a : a + 4] for a in at], axis=1)
    return 2 * np.arctan2(quat[..., 2], quat[..., 0])


@pytest.mark.parametrize("labels", [COCO, MEDIAPIPE, HALPE], ids=["COCO", "MediaPipe", "HALPE"])
def test_joints_as_video_sees_them_carry_a_body(labels: list[str]) -> None:
    assert all(recognise(labels))
    motion = fit_markers(worn(labels))
    assert motion.valid.all()
    assert motion.marker_error_rms is not None
    assert motion.marker_error_rms < 0.01
    assert 1.6 < motion.shape.height < 1.9
    assert np.degrees(knees(motion)[-1].min()) > 60.0
    assert not any("no markers on chest" in note for note in motion.notes)


def test_hips_beside_bones_of_the_pelvis_are_trochanters() -> None:
    legs = [f"{s}{j}" for s in "LR" for j in ("HIP", "KNEE", "ANKLE", "ASIS")]
    marks = recognise(legs)
    assert marks[0] is not None
    assert marks[0].name == "left trochanter"


def test_exchanged_sides_are_noticed_and_stated() -> None:
    swapped = [{"L": "R", "R": "L"}.get(x[0], x[0]) + x[1:] for x in PLUG_IN_GAIT]
    motion = fit_markers(worn(swapped, as_if=PLUG_IN_GAIT))
    assert any("left and right were exchanged" in note for note in motion.notes)
    assert np.degrees(knees(motion)[-1].min()) > 80.0
    straight = fit_markers(worn(PLUG_IN_GAIT))
    assert not any("exchanged" in note for note in straight.notes)
    np.testing.assert_allclose(motion.qpos[:, :3], straight.qpos[:, :3], atol=0.01)


@pytest.mark.parametrize(
    "turn", [np.diag([1.0, -1, -1]), np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])]
)
def test_a_body_upside_down_or_lying_keeps_its_sides(turn: np.ndarray) -> None:
    upright = worn(PLUG_IN_GAIT)
    turned = MarkerRecording(
        source=upright.source,
        labels=upright.labels,
        time=upright.time,
        position=upright.position @ turn.T + [0, 0, 2.0],
        notes=(),
    )
    assert not any("exchanged" in note for note in fit_markers(turned).notes)


@pytest.mark.parametrize("name", ["Bob:", "Bob_", "Subject1 ", "S01-"])
def test_a_person_s_name_before_every_label(name: str) -> None:
    labels = [name + label for label in PLUG_IN_GAIT]
    assert set(subjects(labels)) == {name.rstrip(":_ -")}
    assert all(recognise(labels))


def test_sides_are_nobody_s_name() -> None:
    labels = [f"{side}_{joint}" for side in ("left", "right") for joint in LIMBS]
    assert set(subjects(labels)) == {""}
    assert set(subjects(PLUG_IN_GAIT)) == {""}


def test_of_two_people_one_is_taken() -> None:
    both = [f"{name}_{label}" for name in ("Bob", "Ann") for label in PLUG_IN_GAIT]
    recording = worn(both)
    recording.position[:, len(PLUG_IN_GAIT) :, 0] += 2.0
    motion = fit_markers(recording)
    assert any("2 subjects are in the file: Bob was taken, Ann left out" in n for n in motion.notes)
    assert motion.marker_error_rms is not None
    assert motion.marker_error_rms < 0.01


def test_labels_that_stand_twice_are_taken_once() -> None:
    one = worn(PLUG_IN_GAIT)
    beside = one.position + np.array([0.0, 2.0, 0.0])
    both = replace(
        one,
        labels=(*one.labels, *one.labels),
        position=np.concatenate([one.position, beside], axis=1),
    )
    alone, found = fit_markers(one), fit_markers(both)
    np.testing.assert_array_equal(found.qpos, alone.qpos)
    assert any("34 labels stand in the file again" in note for note in found.notes)
    assert not any("not known" in note for note in found.notes)


def test_too_few_labels_say_what_is_needed() -> None:
    with pytest.raises(InputError, match="both hips and both shoulders"):
        fit_markers(worn(["LKNE", "RKNE", "LANK", "RANK", "LTOE", "RTOE", "LHEE", "RHEE"]))


def test_legs_alone_tell_the_up_axis() -> None:
    legs = [label for label in PLUG_IN_GAIT if label[1:] in ("ASI", "PSI", "KNE", "ANK", "TOE")]
    position = worn(legs).position
    assert up_axis(legs, position) == "z"
    assert up_axis(legs, position[..., [1, 2, 0]]) == "y"


def test_who_lies_on_the_stated_floor_is_not_taken_for_standing() -> None:
    upright = worn(PLUG_IN_GAIT).position
    lying = upright[..., [2, 0, 1]] * [1, 1, 1] + [4.0, 0.0, 0.2]
    assert up_axis(PLUG_IN_GAIT, lying) == "x"
    assert up_axis(PLUG_IN_GAIT, lying, "z") is None


def test_feet_above_the_head_are_noticed() -> None:
    position = worn(PLUG_IN_GAIT).position
    assert upside_down(PLUG_IN_GAIT, position, "-z")
    assert upside_down(PLUG_IN_GAIT, -position, "z")
    assert not upside_down(PLUG_IN_GAIT, position, "z")
    assert not upside_down(["a", "b"], position[:, :2], "z")
