from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from physretarget.capture import load
from physretarget.capture.actor import CONTACT_POINTS
from physretarget.contact import detect_phases
from physretarget.contact.detect import detect
from physretarget.kinematics import runs

NAMES = ("left_heel", "left_toe", "right_heel", "right_toe")


def steps(fps: float, *, floor: float = 0.0, scale: float = 1.0, seconds: float = 4.0):
    """Times and points (T, 4, 3) of feet that stand 0.6 s and swing 0.4 s, in turn."""
    time = np.arange(round(seconds * fps)) / fps
    points = np.zeros((len(time), 4, 3))
    for foot, late in ((0, 0.0), (1, 0.5)):
        phase = time - late
        swing = np.clip((phase % 1.0 - 0.6) / 0.4, 0.0, 1.0)
        ahead = np.floor(phase) + swing * swing * (3 - 2 * swing)
        for k, rest in ((2 * foot, 0.03), (2 * foot + 1, 0.0)):
            points[:, k, 0] = scale * ahead * 1.2
            points[:, k, 2] = scale * (0.2 * np.sin(np.pi * swing) ** 2 + rest) + floor
    return time, points


@pytest.mark.parametrize("fps", [24.0, 30.0, 60.0, 120.0, 250.0])
def test_phases_do_not_depend_on_the_frame_rate(fps):
    time, points = steps(fps)
    active = detect(points, time, NAMES)
    for k in (0, 1):
        found = [(time[a], time[b]) for a, b in runs(active[:, k])][1:3]
        for (start, end), step in zip(found, (1.0, 2.0), strict=True):
            assert start == pytest.approx(step, abs=0.08)
            assert end == pytest.approx(step + 0.6, abs=0.08)


@pytest.mark.parametrize("floor", [-0.3, 0.0, 0.9])
def test_the_floor_may_lie_anywhere(floor):
    time, points = steps(60.0, floor=floor)
    reference = detect(steps(60.0)[1], time, NAMES)
    np.testing.assert_array_equal(detect(points, time, NAMES), reference)


def test_noise_does_not_make_contacts_flicker():
    time, points = steps(60.0)
    noisy = points + 0.003 * np.random.default_rng(1).standard_normal(points.shape)
    active = detect(noisy, time, NAMES)
    for k in range(4):
        spans = runs(active[:, k])
        assert len(spans) <= 5
        assert min(time[b] - time[a] for a, b in spans) > 0.06


def test_no_contact_in_the_air_and_none_unseen():
    time, points = steps(60.0)
    points[120:150, :, 2] += 1.0
    assert not detect(points, time, NAMES)[121:149].any()
    points[:, 3] = np.nan
    points[60:80, 2] = np.nan
    active = detect(points, time, NAMES)
    assert not active[:, 3].any()
    assert not active[60:80, 2].any()
    assert active[:, 2].any()
    assert not detect(points[:2], time[:2], NAMES).any()


def test_walks_have_double_support_and_runs_have_flight(data: Path):
    for kind, both_feet, in_flight in (("walk", True, False), ("run", False, True)):
        motion = load(data / "bvh" / "bandai" / f"dataset-1_{kind}_happy_001.bvh")
        active = detect_phases(motion).active
        left, right = active[:, :2].any(axis=1), active[:, 2:4].any(axis=1)
        assert ((left & right).mean() > 0.05) == both_feet
        assert ((~left & ~right).mean() > 0.05) == in_flight


def test_a_bow_stands_all_the_time(data: Path):
    motion = load(data / "bvh" / "bandai" / "dataset-1_bow_normal_001.bvh")
    phases = detect_phases(motion)
    assert phases.active[:, :4].mean() > 0.98
    assert not phases.active[:, 4:].any()
    unknown = replace(motion, valid=np.arange(len(motion.time)) > 20)
    assert not detect_phases(unknown).active[:20].any()


def table(path: Path) -> tuple[list[str], np.ndarray]:
    """Column names and rows of an OpenSim .mot file."""
    lines = path.read_text().splitlines()
    header = lines.index("endheader") + 1
    rows = [line.split() for line in lines[header + 1 :] if line.strip()]
    return lines[header].split(), np.array(rows, dtype=float)


@pytest.mark.parametrize("trial", ["DJ1", "DJ2", "DJ3", "squats1", "walking1", "walking4"])
def test_detected_contacts_agree_with_force_plates(data: Path, trial: str):
    """Where a foot is on a plate: its measured force against the fitted actor's contacts."""
    folder = data / "grf" / "opencap_subject4"
    motion = load(folder / f"{trial}.trc")
    names, rows = table(folder / f"{trial}_grf.mot")
    forces = [
        np.interp(motion.time, rows[:, 0], rows[:, names.index(f"ground_force_{plate}_vy")]) > 20
        for plate in (1, 2)
    ]
    # Walks: only the steps on the plates were measured; the first 0.2 s step is off them.
    seen = motion.time > 0.2
    if trial.startswith("DJ"):  # and the box of a drop jump is no plate
        seen = motion.time >= motion.time[np.argmax(forces[0] | forces[1])]
    active = detect_phases(motion).active
    left, right = active[:, :2].any(axis=1), active[:, 2:4].any(axis=1)
    agreement = max(
        np.mean([(left == a)[seen].mean(), (right == b)[seen].mean()])
        for a, b in (forces, forces[::-1])
    )
    assert agreement > 0.93


def on_a_box(seconds: float = 3.0, box: float = 0.4) -> tuple[np.ndarray, np.ndarray]:
    """Somebody who stands on a box, steps down with the left foot, then with the right."""
    time = np.arange(int(seconds * 60)) / 60
    place = np.zeros((len(time), len(CONTACT_POINTS), 3))

    def falls(start: float) -> np.ndarray:
        return box * (1 - np.clip((time - start) / 0.4, 0, 1))

    for name, start in (("left", 1.0), ("right", 1.6)):
        for point, ahead in (("heel", 0.0), ("toe", 0.2)):
            k = CONTACT_POINTS.index(f"{name}_{point}")
            moved = np.clip((time - start) / 0.4, 0, 1)
            place[:, k] = np.stack([ahead + 0.5 * moved, np.zeros_like(time), falls(start)], axis=1)
    for name, over in (("pelvis", 0.9), ("head", 1.6), ("left_knee", 0.45), ("right_knee", 0.45)):
        place[:, CONTACT_POINTS.index(name), 2] = over + falls(1.0)
    for name in ("left_hand", "right_hand"):
        place[:, CONTACT_POINTS.index(name), 2] = 0.7 + falls(1.0)
    return place, time


def test_feet_stand_on_boxes_too():
    place, time = on_a_box()
    active = detect(place, time, CONTACT_POINTS)
    left, right = active[:, :2].min(axis=1), active[:, 2:4].min(axis=1)
    assert left[time < 0.9].all()
    assert right[time < 0.9].all(), "the second foot beside the first"
    assert not left[(time > 1.15) & (time < 1.35)].any()
    assert right[time < 1.5].all()
    assert left[time > 1.5].all()
    assert right[time > 2.1].all()
    assert not active[:, 4:].any()


def test_a_foot_held_up_beside_one_that_stands_is_in_the_air():
    place, time = on_a_box()
    for name in ("left_heel", "left_toe"):
        place[:, CONTACT_POINTS.index(name)] = 0.0
    active = detect(place, time, CONTACT_POINTS)
    assert not active[time < 1.4, 2:4].any()


def test_who_sits_with_dangling_feet_does_not_stand_on_air():
    place, time = on_a_box()
    place[:, CONTACT_POINTS.index("pelvis"), 2] = 0.75
    place[:, 0:4, 2] = 0.4
    place[time > 2.5, 0:4, 2] = 0.0
    active = detect(place, time, CONTACT_POINTS)
    assert not active[time < 2.2, :4].any()


@pytest.mark.data
def test_every_stair_is_stood_on(data: Path):
    """Contacts on a staircase against its four plates, together."""
    from physretarget.capture import read
    from physretarget.capture.recording import MarkerRecording

    path = data / "c3d" / "Movement_trial.c3d"
    recording = read(path)
    assert isinstance(recording, MarkerRecording)
    motion = load(path)
    force = sum(np.interp(motion.time, p.time, p.force[:, 2]) for p in recording.plates)
    inside = (motion.time > motion.time[np.argmax(force > 500)]) & (motion.time < 2.5)
    standing = detect_phases(motion).active[:, :4].max(axis=1)
    assert standing[inside].mean() > 0.97
    single = detect_phases(motion).active[:, :2].any(axis=1) != detect_phases(motion).active[
        :, 2:4
    ].any(axis=1)
    assert single[inside].mean() > 0.4, "one foot after the other"
