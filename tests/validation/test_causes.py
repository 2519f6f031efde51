"""What lies behind a broken clip is named, with its size; clean clips have no cause."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from physretarget.clip import Clip, load_clip
from physretarget.kinematics import quat_conjugate, quat_multiply
from physretarget.kinematics.order import breadth_first
from physretarget.mjcf import Character
from physretarget.validation import Report, Settings, validate
from physretarget.validation.causes import likeliest
from physretarget.validation.report import Cause

Array = NDArray[np.float64]
How = Callable[[Character, Array], Array]
ROBOT = ("walk", "wave", "dance", "high5", "jumpjack")


def robot(data: Path) -> Character:
    return Character.load(data / "robot" / "g1_no_mesh_box_feet.xml")


def clip(data: Path, character: Character, name: str) -> Clip:
    return load_clip(data / "robot" / f"g1_{name}.csv", character=character, fps=30, quat="wxyz")


def judged(character: Character, qpos: Array, fps: float = 30.0) -> Report:
    made = Clip(qpos=qpos, time=np.arange(len(qpos)) / fps)
    return validate(made, character, settings=Settings(profile="robot"))


def root(qpos: Array, **columns: Callable[[Array], Array]) -> Array:
    changed = qpos.copy()
    for name, how in columns.items():
        first, end = {"place": (0, 3), "flat": (0, 2), "height": (2, 3), "turn": (3, 7)}[name]
        changed[:, first:end] = how(qpos[:, first:end])
    return changed


def turned(qpos: Array, axis: str, degrees: float) -> Array:
    turn = Rotation.from_euler(axis, degrees, degrees=True)
    quat = turn.as_quat(scalar_first=True)
    return root(qpos, place=turn.apply, turn=lambda q: quat_multiply(quat, q))


def pitched(character: Character, qpos: Array, degrees: float) -> Array:
    changed = qpos.copy()
    for side in ("left", "right"):
        at = character.model.joint(f"{side}_ankle_pitch_joint").qposadr[0]
        changed[:, at] += np.deg2rad(degrees)
    return changed


MISREAD: dict[str, tuple[How, str]] = {
    "xyzw": (lambda c, q: root(q, turn=lambda r: np.roll(r, -1, axis=1)), "DAT010"),
    "wxyz": (lambda c, q: root(q, turn=lambda r: np.roll(r, 1, axis=1)), "DAT010"),
    "inverse": (lambda c, q: root(q, turn=quat_conjugate), "DAT010"),
    "breadth-first": (lambda c, q: q[:, np.argsort(breadth_first(c.tree))], "DAT011"),
    "y up": (lambda c, q: turned(q, "x", -90), "DAT013"),
    "x up": (lambda c, q: turned(q, "y", 90), "DAT013"),
    "upside down": (lambda c, q: turned(q, "x", 180), "DAT013"),
    "centimetres": (lambda c, q: root(q, place=lambda p: 100 * p), "DAT006"),
    "inches": (lambda c, q: root(q, place=lambda p: 39.37 * p), "DAT006"),
    "metres as centimetres": (lambda c, q: root(q, place=lambda p: p / 100), "DAT006"),
}


@pytest.mark.parametrize("name", ["walk", "dance"])
@pytest.mark.parametrize("fault", MISREAD)
def test_a_misreading_is_named_and_nothing_else(data: Path, name: str, fault: str) -> None:
    character = robot(data)
    break_, code = MISREAD[fault]
    report = judged(character, break_(character, clip(data, character, name).qpos))
    assert [cause.code for cause in report.causes] == [code]
    assert code in {f.code for f in report.findings}
    assert report.causes[0].remedy


@pytest.mark.parametrize("name", ROBOT)
@pytest.mark.parametrize("fps", [30, 15])
def test_clean_clips_have_no_cause(data: Path, name: str, fps: int) -> None:
    character = robot(data)
    taken = clip(data, character, name)
    assert judged(character, taken.qpos[:: 30 // fps], fps).causes == ()


@pytest.mark.parametrize("offset", [0.045, -0.06, 0.12])
def test_a_constant_offset_has_its_size(data: Path, offset: float) -> None:
    character = robot(data)
    qpos = clip(data, character, "wave").qpos
    (cause,) = judged(character, root(qpos, height=lambda z: z + offset)).causes
    assert cause.code == "CON007"
    assert cause.value == pytest.approx(offset, abs=0.003)


@pytest.mark.parametrize("scale", [0.8, 1.2, 1.5])
def test_a_root_that_outruns_its_legs_has_its_factor(data: Path, scale: float) -> None:
    character = robot(data)
    qpos = clip(data, character, "walk").qpos
    cause = judged(character, root(qpos, flat=lambda p: scale * p)).causes[0]
    assert cause.code == "DAT014"
    assert cause.value == pytest.approx(scale, rel=0.06)


@pytest.mark.parametrize("degrees", [10.0, -9.0, 14.0])
def test_a_constant_foot_pitch_has_its_size(data: Path, degrees: float) -> None:
    character = robot(data)
    qpos = clip(data, character, "high5").qpos
    found = {c.code: c for c in judged(character, pitched(character, qpos, degrees)).causes}
    assert found["CON006"].value == pytest.approx(abs(degrees), abs=2.5)


@pytest.mark.parametrize("factor", [0.25, 0.5, 2.0, 4.0])
def test_flights_tell_the_frame_rate(biped: Character, hop: Clip, factor: float) -> None:
    report = validate(Clip(qpos=hop.qpos, time=hop.time * factor), biped)
    (cause,) = report.causes
    assert cause.code == "DAT012"
    assert cause.value == pytest.approx(100.0, rel=0.05)


def test_a_walk_in_slow_motion_is_told_by_its_steps(data: Path) -> None:
    character = robot(data)
    slow = judged(character, clip(data, character, "walk").qpos, 7.5)
    (cause,) = slow.causes
    assert cause.code == "DAT012"
    assert cause.value == pytest.approx(30.0, rel=0.1)
    fast = judged(character, clip(data, character, "walk").qpos, 120.0)
    assert [c.code for c in fast.causes] == ["DAT012"]


def test_a_cut_names_its_frame(data: Path) -> None:
    character = robot(data)
    one, other = (clip(data, character, name).qpos for name in ("high5", "dance"))
    joined = np.vstack([one[:70], root(other[40:], flat=lambda p: p - p[0] + one[69, :2])])
    cause = judged(character, joined).causes[0]
    assert (cause.code, cause.value) == ("DAT015", 70.0)


@pytest.mark.parametrize("lowpass", [None, 6.0])
@pytest.mark.parametrize("fps", [30, 60, 120])
def test_noise_on_the_root_is_a_cause_whatever_the_filter(
    biped: Character, standing: Clip, fps: int, lowpass: float | None
) -> None:
    qpos = np.tile(standing.qpos[:1], (2 * fps, 1))
    qpos[:, :3] += np.random.default_rng(3).normal(0, 0.004, (2 * fps, 3))
    noisy = Clip(qpos=qpos, time=np.arange(2 * fps) / fps)
    (cause,) = validate(noisy, biped, settings=Settings(lowpass_hz=lowpass)).causes
    assert cause.code == "KIN003"
    assert cause.value is not None
    # The worst second and axis of two: of 30 frames a median strays that far.
    assert 0.003 < cause.value < 0.016


def test_misreadings_stand_alone_and_first() -> None:
    made = [Cause(code=c, message="m", remedy="r") for c in ("CON007", "DAT013", "DAT015")]
    assert [c.code for c in likeliest(made)] == ["DAT013"]
    assert [c.code for c in likeliest(made[::2])] == ["DAT015", "CON007"]


def test_who_shifts_from_foot_to_foot_does_not_walk() -> None:
    """Four legs that are set down again in turn, slowly, on the spot: no clock is in that."""
    legs = "".join(
        f"<body name='l{k}' pos='{x} {y} 0'><joint name='j{k}' type='slide' axis='0 0 1'/>"
        "<geom type='capsule' fromto='0 0 0 0 0 -.2' size='.02'/></body>"
        for k, (x, y) in enumerate(((0.2, 0.2), (-0.2, 0.2), (0.2, -0.2), (-0.2, -0.2)))
    )
    beast = Character.from_xml(
        "<mujoco><worldbody><geom type='plane' size='5 5 .1'/><body><freejoint/>"
        f"<geom type='box' size='.2 .2 .05' mass='5'/>{legs}</body></worldbody></mujoco>"
    )
    frames, fps = 360, 30.0
    qpos = np.zeros((frames, beast.tree.nq))
    qpos[:, 2], qpos[:, 3] = 0.22, 1.0
    time = np.arange(frames) / fps
    for k in range(4):
        up = (time // 1.5).astype(int) % 4 != k
        qpos[:, 7 + k] = np.where(up, 0.002 * np.sin(np.pi * (time % 1.5) / 1.5) ** 2, 0.0)
    report = validate(Clip(qpos=qpos, time=time), beast)
    assert "DAT012" not in {finding.code for finding in report.findings}
