"""The same motion at several frame rates: the same measures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline, Slerp

from physretarget.clip import Clip, load_clip
from physretarget.kinematics import difference, integrate
from physretarget.mjcf import Character, lowpass
from physretarget.validation import Report, Settings, validate
from physretarget.validation.grid import Grid

Array = NDArray[np.float64]
Motion = Callable[[Array], Array]
CLIPS = ("walk", "wave", "jumpjack", "dance", "high5")
MODELS = Path(__file__).parents[2] / "models"


def robot(data: Path) -> Character:
    return Character.load(data / "robot" / "g1_no_mesh_box_feet.xml")


def spline(character: Character, qpos: Array, time: Array) -> Motion:
    """Cubics through all coordinates, rotations as such."""
    (root,) = character.tree.quats[0]
    turn = RotationSpline(time, Rotation.from_quat(qpos[:, root], scalar_first=True))

    def at(when: Array) -> Array:
        between = CubicSpline(time, qpos)(when)
        between[:, root] = turn(when).as_quat(scalar_first=True)
        return np.asarray(between, dtype=np.float64)

    return at


def straight(character: Character, qpos: Array, time: Array) -> Motion:
    """Straight lines from frame to frame, slerp."""
    (root,) = character.tree.quats[0]
    turn = Slerp(time, Rotation.from_quat(qpos[:, root], scalar_first=True))

    def at(when: Array) -> Array:
        between = np.stack([np.interp(when, time, column) for column in qpos.T], axis=1)
        between[:, root] = turn(when).as_quat(scalar_first=True)
        return between

    return at


def sines(character: Character, fastest: float, seed: int = 0) -> Motion:
    """Every coordinate a sum of five sines up to so many Hz, about the reference pose."""
    generator = np.random.default_rng(seed)
    shape = (5, character.tree.nv)
    hz, phase = generator.uniform(0.2, fastest, shape), generator.uniform(0, 2 * np.pi, shape)
    hz[-1] = fastest
    size = generator.uniform(0.05, 0.25, shape) / (1 + hz**2)
    root = slice(character.root_dof, character.root_dof + 6)
    size[:, root] *= 0.3 * min(1.0, character.com_height)

    def at(when: Array) -> Array:
        swung = np.sin(2 * np.pi * hz * when[:, None, None] + phase)
        step = np.einsum("kv,tkv->tv", size, swung)
        return integrate(character.tree, np.tile(character.reference_qpos, (len(when), 1)), step)

    return at


def judged(
    character: Character, motion: Motion, seconds: float, fps: float, hz: float | None = None
) -> Report:
    time = np.arange(int(seconds * fps + 1e-6) + 1) / fps
    clip = Clip(qpos=motion(np.minimum(time, seconds)), time=time)
    return validate(clip, character, settings=Settings(profile="robot", lowpass_hz=hz))


def assert_alike(reports: list[Report]) -> None:
    """Every measure within 5 % of the first report's, and all of them taken or none."""
    taken = 0
    for name, first in reports[0].measures.items():
        values = [report.measures[name].value for report in reports]
        assert [v is None for v in values] == [first.value is None] * len(values), name
        if first.value is not None:
            taken += 1
            assert values == pytest.approx([first.value] * 3, rel=0.05), name
    assert taken >= 20


@pytest.mark.parametrize("name", CLIPS)
@pytest.mark.parametrize("hz", [None, 6.0])
@pytest.mark.parametrize("smooth", [3.0, 6.0])
def test_measures_of_a_robot_clip_are_those_of_30_60_and_120_frames(
    data: Path, name: str, smooth: float, hz: float | None
) -> None:
    character = robot(data)
    clip = load_clip(data / "robot" / f"g1_{name}.csv", character=character, fps=30)
    motion = spline(character, lowpass(character, clip.qpos, 30, smooth), clip.time)
    assert_alike([judged(character, motion, clip.duration, fps, hz) for fps in (30, 60, 120)])


@pytest.mark.parametrize("name", CLIPS)
def test_straight_lines_between_frames_change_nothing(data: Path, name: str) -> None:
    character = robot(data)
    clip = load_clip(data / "robot" / f"g1_{name}.csv", character=character, fps=30)
    motion = straight(character, clip.qpos, clip.time)
    assert_alike([judged(character, motion, clip.duration, fps, 6.0) for fps in (30, 60, 120)])


@pytest.mark.parametrize("model", ["penguin", "squirrel", "lamp"])
@pytest.mark.parametrize("fastest", [1.5, 3.0, 5.0])
@pytest.mark.parametrize("hz", [None, 6.0])
def test_measures_of_sines_are_those_of_30_60_and_120_frames(
    model: str, fastest: float, hz: float | None
) -> None:
    character = Character.load(MODELS / f"{model}.xml")
    motion = sines(character, fastest)
    assert_alike([judged(character, motion, 5.0, fps, hz) for fps in (30, 60, 120)])


@pytest.mark.parametrize("hz", [None, 6.0])
def test_measures_hold_at_rates_between(biped: Character, hz: float | None) -> None:
    """Instants then lie between frames."""
    motion = sines(biped, 3.0)
    assert_alike([judged(biped, motion, 5.0, fps, hz) for fps in (30, 50, 100)])


def test_measures_are_those_of_every_fourth_frame(biped: Character) -> None:
    motion, time = sines(biped, 12.0), np.arange(481) / 120
    clip = Clip(qpos=motion(time), time=time)
    fine = validate(clip, biped)
    coarse = validate(Clip(qpos=clip.qpos[::4], time=clip.time[::4]), biped)
    for name, measure in coarse.measures.items():
        if measure.value is None:
            assert fine.measures[name].value is None, name
            continue
        assert fine.measures[name].value == pytest.approx(measure.value, rel=1e-5), name
        if measure.frame is not None:
            assert fine.measures[name].frame == 4 * measure.frame, name
    assert fine.settings.derivative != coarse.settings.derivative


def test_findings_see_every_frame(biped: Character) -> None:
    """A leap of one frame between two instants."""
    motion, time = sines(biped, 1.0), np.arange(481) / 120
    clip = Clip(qpos=motion(time), time=time)
    leap = clip.qpos.copy()
    leap[241, 8] += 1.0
    report = validate(replace(clip, qpos=leap), biped)
    assert {f.code for f in report.findings if f.frame in (240, 241, 242)} >= {"DYN001", "KIN002"}
    calm = validate(clip, biped).measures["joint_speed_max_rad_s"].value
    assert report.measures["joint_speed_max_rad_s"].value == pytest.approx(calm, rel=1e-6)


def test_cubics_between_frames_are_of_fourth_order(biped: Character) -> None:
    from physretarget.validation.chunk import Workspace

    motion = sines(biped, 3.0)
    work = Workspace.build(biped, tolerance=0.01, friction=1.0)
    worst = []
    for fps in (50.0, 100.0):
        time = np.arange(round(2 * fps)) / fps
        qpos = motion(time)

        def poses(first: int, last: int, qpos: Array = qpos) -> Array:
            return qpos[first:last]

        grid = Grid(time, np.arange(len(time), dtype=np.float64), work, None, poses, None)
        fewer = grid.resampled()
        assert fewer is not None
        assert fewer.fps == pytest.approx(30)
        whole = fewer.poses(0, len(fewer.time))
        np.testing.assert_array_equal(whole[7:23], fewer.poses(7, 23))
        worst.append(np.abs(difference(biped.tree, motion(fewer.time), whole))[1:-1].max())
    assert worst[0] / worst[1] > 12


@pytest.mark.parametrize(
    ("fps", "frames", "hz", "measured"),
    [
        (30.0, 300, None, 30.0), (40.0, 400, None, 40.0), (45.0, 450, None, 30.0),
        (100.0, 400, None, 30.0), (120.0, 28, None, 120.0), (120.0, 29, None, 30.0),
        (120.0, 480, 12.0, 30.0), (120.0, 480, 13.0, 120.0),
    ],
)  # fmt: skip
def test_what_is_measured_at_its_own_rate(
    biped: Character, fps: float, frames: int, hz: float | None, measured: float
) -> None:
    from physretarget.validation.analysis import analyse

    time = np.arange(frames) / fps
    clip = Clip(qpos=sines(biped, 2.0)(time), time=time)
    found = analyse(clip, biped, Settings(lowpass_hz=hz))
    assert found.fps == pytest.approx(fps)
    assert found.measured.fps == pytest.approx(measured)
