"""What is known beforehand: standing, falling, simulated motion and its distortions."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from physretarget.clip import Clip, load_clip
from physretarget.mjcf import Character
from physretarget.validation import Report, Settings, analysis, validate
from physretarget.validation.measures import time_share


def explained(report: Report) -> set[str]:
    """Codes that say what lies behind the others; tests of causes are about these."""
    return {cause.code for cause in report.causes}


def errors(report: Report) -> set[str]:
    return {f.code for f in report.findings if f.severity == "error"} - explained(report)


def codes(report: Report) -> set[str]:
    return {f.code for f in report.findings} - explained(report)


def value(report: Report, name: str) -> float:
    measured = report.measures[name].value
    assert measured is not None, name
    return measured


def test_standing_bears_its_weight(biped: Character, standing: Clip) -> None:
    report = validate(standing, biped)
    for name in ("max", "min", "mean"):
        assert value(report, f"required_force_vertical_{name}_bw") == pytest.approx(1, abs=1e-3)
    assert value(report, "unexplained_force_max_bw") < 1e-4
    assert report.passed


def test_free_fall_needs_nothing(biped: Character, standing: Clip) -> None:
    qpos = standing.qpos.copy()
    qpos[:, 2] += 8 - 9.81 / 2 * standing.time**2
    qpos[:, 0] += 1.5 * standing.time
    report = validate(replace(standing, qpos=qpos), biped)
    assert value(report, "required_force_vertical_max_bw") == pytest.approx(0, abs=1e-3)
    assert value(report, "required_force_vertical_min_bw") == pytest.approx(0, abs=1e-3)
    assert value(report, "flight_com_acceleration_error_rms") < 1e-2
    assert value(report, "flight_frames_fraction") == 1
    assert value(report, "float_time_s") == 0
    assert value(report, "pull_frames_fraction") == 0
    assert codes(report) == set()


def test_simulated_hop_is_explained(biped: Character, hop: Clip) -> None:
    report = validate(hop, biped)
    assert codes(report) == set()
    assert value(report, "unexplained_force_rms_bw") < 6e-3
    assert 0.02 < value(report, "flight_frames_fraction") < 0.2
    assert value(report, "flight_com_acceleration_error_rms") < 0.05


# Frame rates at which the simulation's time step gives whole numbers of steps.
TAKEN = [(fps, hz) for fps in (25.0, 50.0, 100.0, 125.0) for hz in (None, 6.0, 12.0)]


@pytest.mark.parametrize(("fps", "hz"), TAKEN)
def test_simulated_hop_is_clean_at_any_rate_and_filter(
    fps: float, hz: float | None, biped: Character, hop_at: Callable[[float], Clip]
) -> None:
    """Take-off and landing last milliseconds: differences and filter smear them over frames."""
    report = validate(hop_at(fps), biped, settings=Settings(lowpass_hz=hz))
    assert codes(report) == set()


@pytest.mark.parametrize(("fps", "hz"), TAKEN)
def test_lifted_clip_floats_and_nothing_else(
    fps: float, hz: float | None, biped: Character, hop_at: Callable[[float], Clip]
) -> None:
    hop = hop_at(fps)
    qpos = hop.qpos.copy()
    qpos[:, 2] += 0.03
    report = validate(replace(hop, qpos=qpos), biped, settings=Settings(lowpass_hz=hz))
    assert codes(report) == {"CON003"}
    assert value(report, "float_time_s") > 2.5


@pytest.mark.parametrize(("fps", "hz"), TAKEN)
def test_sliding_clip_skates_and_nothing_else(
    fps: float, hz: float | None, biped: Character, hop_at: Callable[[float], Clip]
) -> None:
    hop = hop_at(fps)
    qpos = hop.qpos.copy()
    qpos[:, 0] += 0.2 * hop.time
    report = validate(replace(hop, qpos=qpos), biped, settings=Settings(lowpass_hz=hz))
    assert codes(report) == {"CON002"}


@pytest.mark.parametrize("fps", [30.0, 60.0, 120.0])
def test_a_hop_that_plants_at_once_does_not_slide(fps: float) -> None:
    """Half a metre per hop: the frame of landing has a flight before it, and no sliding."""
    box = Character.from_xml(
        """<mujoco><worldbody><geom type="plane" size="9 9 .1"/><body pos="0 0 .1"><freejoint/>
        <geom type="box" size=".1 .1 .1" mass="3"/></body></worldbody></mujoco>""",
        name="box",
    )
    time = np.arange(round(3 * fps)) / fps
    phase, hops = np.modf(time / 0.5)
    air = np.clip((phase - 0.6) / 0.4, 0, 1)
    qpos = np.tile(box.reference_qpos, (len(time), 1))
    qpos[:, 0] = 0.5 * (hops + air)
    qpos[:, 2] = 0.1 + 9.81 / 2 * (0.2**2) * air * (1 - air)
    report = validate(Clip(qpos=qpos, time=time), box)
    assert value(report, "flight_frames_fraction") > 0.2
    assert value(report, "skate_speed_max_m_s") < 1e-6
    assert "CON002" not in codes(report)


def lifted(clip: Clip) -> Clip:
    return replace(clip, qpos=clip.qpos + 0.03 * np.eye(13)[2])


def slid(clip: Clip) -> Clip:
    return replace(clip, qpos=clip.qpos + 0.2 * clip.time[:, None] * np.eye(13)[0])


def faster(clip: Clip) -> Clip:
    return replace(clip, time=clip.time / 1.5)


def mirrored(clip: Clip) -> Clip:
    qpos = clip.qpos.copy()
    qpos[:, 2] = 2 * qpos[0, 2] - qpos[:, 2]
    return replace(clip, qpos=qpos)


def flipped(column: int) -> Callable[[Clip], Clip]:
    return lambda clip: replace(clip, qpos=np.where(np.arange(13) == column, -1, 1) * clip.qpos)


# Errors and warnings, unfiltered and at 6 Hz; docs/measures.md says why each.
ALTERED: dict[str, tuple[Callable[[Clip], Clip], tuple[str, str], tuple[str, str]]] = {
    "as simulated": (lambda clip: clip, ("", ""), ("", "")),
    "lifted by 3 cm": (lifted, ("CON003", ""), ("CON003", "")),
    "slid at 0.2 m/s": (slid, ("CON002", ""), ("CON002", "")),
    "1.5 times as fast": (
        faster,
        ("DYN001 DYN003 DYN005 DYN006", "DYN002 DYN009"),
        ("DYN001 DYN003 DYN005", "DYN002"),
    ),
    "upside down": (
        mirrored,
        ("CON001 CON003 DYN001 DYN002 DYN003", ""),
        ("CON001 CON003 DYN001 DYN003", ""),
    ),
    "left hip flipped": (
        flipped(7),
        ("DYN001 DYN002 DYN003 DYN004 DYN005", ""),
        ("DYN001 DYN004 DYN005", "DYN002"),
    ),
    "left knee flipped": (
        flipped(8),
        ("CON001 DYN001 DYN002 DYN003 DYN004 DYN005 KIN001", ""),
        ("DYN005 KIN001", "CON001 DYN001 DYN003"),
    ),
    "left ankle flipped": (flipped(9), ("CON001 DYN005", ""), ("CON001", "DYN005")),
}


@pytest.mark.parametrize("hz", [None, 6.0])
@pytest.mark.parametrize("name", ALTERED)
def test_altered_clip_fires_exactly_its_rules(
    name: str, hz: float | None, biped: Character, hop: Clip
) -> None:
    alter, *expected = ALTERED[name]
    report = validate(alter(hop), biped, settings=Settings(lowpass_hz=hz))
    severe, light = expected[hz is not None]
    assert errors(report) == set(severe.split())
    assert codes(report) - errors(report) == set(light.split())


@pytest.mark.parametrize("hz", [None, 6.0, 15.0])
def test_chunks_join_without_a_seam(
    hz: float | None, biped: Character, hop: Clip, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = Settings(lowpass_hz=hz)
    whole = validate(hop, biped, settings=settings)
    monkeypatch.setattr(analysis, "CHUNK", 37)
    parts = validate(hop, biped, settings=settings)
    for name, measure in whole.measures.items():
        other = parts.measures[name]
        assert measure.unit == other.unit
        assert (measure.value is None) == (other.value is None)
        if measure.value is not None and other.value is not None:
            assert other.value == pytest.approx(measure.value, rel=1e-6, abs=1e-7), name
    assert codes(whole) == codes(parts)


def test_fixed_base_says_what_it_cannot_judge() -> None:
    arm = Character.from_xml(
        """<mujoco><worldbody><geom type="plane" size="1 1 .1"/><body pos="0 0 1">
        <joint name="j" axis="0 1 0" range="-90 90"/><geom type="capsule" fromto="0 0 0 .4 0 0"
        size=".03" mass="1"/></body></worldbody>
        <actuator><motor joint="j" forcerange="-2 2" ctrllimited="false"/></actuator></mujoco>""",
        name="arm",
    )
    qpos = np.zeros((40, 1))
    report = validate(Clip(qpos=qpos, time=np.arange(40) / 50), arm)
    uncovered = {c.code: c.reason for c in report.coverage if c.status == "not-covered"}
    assert {"DYN001", "DYN003", "CON002", "CON003"} <= set(uncovered)
    assert "free joint" in uncovered["DYN001"]
    # A 1 kg rod held out level: m g l / 2 = 1.96 N m of 2 N m.
    ratio = report.measures["joint_torque_ratio_max"].value
    assert ratio == pytest.approx(9.81 * 0.2 / 2, rel=1e-3)


def test_ball_joints_and_two_trees_are_judged() -> None:
    character = Character.from_xml(
        """<mujoco><worldbody><geom type="plane" size="2 2 .1"/>
        <body name="box" pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" mass="3"/>
          <body name="tail" pos="-.1 0 .1"><joint name="t" type="ball"/>
          <geom type="capsule" fromto="0 0 .05 0 0 .3" size=".02" mass=".2"/></body></body>
        <body name="prop" pos="1 0 .05"><freejoint/><geom type="sphere" size=".05" mass="1"/></body>
        </worldbody></mujoco>""",
        name="two",
    )
    qpos = np.tile(character.reference_qpos, (50, 1))
    report = validate(Clip(qpos=qpos, time=np.arange(50) / 50), character)
    assert value(report, "required_force_vertical_mean_bw") == pytest.approx(1, abs=1e-6)
    assert value(report, "unexplained_force_max_bw") < 1e-4
    assert any("other moving trees" in note for note in report.model.notes)


def test_wrong_width_is_an_input_error(biped: Character) -> None:
    from physretarget.errors import InputError

    with pytest.raises(InputError, match="nq = 13"):
        validate(Clip(qpos=np.zeros((5, 4)), time=np.arange(5.0)), biped)


def g1(data: Path, name: str) -> tuple[Clip, Character]:
    character = Character.load(data / "robot" / "g1_no_mesh_box_feet.xml")
    return load_clip(data / "robot" / f"g1_{name}.csv", character=character, fps=30), character


@pytest.mark.parametrize("name", ["walk", "wave", "jumpjack"])
def test_generated_robot_clips(data: Path, name: str) -> None:
    clip, character = g1(data, name)
    report = validate(clip, character, settings=Settings(profile="robot", lowpass_hz=6))
    forces = {c for c in errors(report) if c.startswith("DYN")}
    low = value(report, "required_force_vertical_min_bw")
    high = value(report, "required_force_vertical_max_bw")
    if name == "jumpjack":
        assert "DYN003" in forces
        assert value(report, "pull_frames_fraction") == pytest.approx(0.1, abs=0.02)
    else:
        assert forces == set()
        near = {"walk": (0.69, 1.67), "wave": (0.96, 1.03)}[name]
        assert (low, high) == pytest.approx(near, abs=0.01)


def test_unfiltered_walk_reads_as_published(data: Path) -> None:
    clip, character = g1(data, "walk")
    report = validate(clip, character)
    assert value(report, "required_force_vertical_min_bw") == pytest.approx(0.30, abs=0.01)
    assert value(report, "required_force_vertical_max_bw") == pytest.approx(2.47, abs=0.01)


@pytest.mark.parametrize(
    ("margin", "share"),
    [
        ([-1.0, 1.0, -1.0], 0.5),
        ([-1.0, 3.0], 0.75),
        ([1.0, 2.0, 0.5], 1.0),
        ([-1.0, -2.0], 0.0),
        ([1.0, np.nan, -1.0], 0.25),
        ([1.0], 1.0),
        ([0.0, 0.0], 0.0),
    ],
)
def test_shares_of_time_end_between_frames(margin: list[float], share: float) -> None:
    assert time_share(np.array(margin)) == pytest.approx(share)


def test_every_measure_is_documented(biped: Character, standing: Clip) -> None:
    page = (Path(__file__).parents[2] / "docs" / "measures.md").read_text(encoding="utf-8")
    for name in validate(standing, biped).measures:
        last = "_" + "_".join(name.rsplit("_", 2)[1:])
        assert f"`{name}`" in page or f"`{last}`" in page, name


@pytest.mark.parametrize("frames", [1, 2, 3, 4, 6, 7, 10, 11])
@pytest.mark.parametrize("hz", [None, 6.0])
def test_the_shortest_clips_are_judged_or_said_not_to_be(
    frames: int, hz: float | None, biped: Character, hop: Clip
) -> None:
    clip = replace(hop, qpos=hop.qpos[:frames], time=hop.time[:frames])
    report = validate(clip, biped, settings=Settings(lowpass_hz=hz, also_literature=True))
    assert "DAT004" in codes(report)
    uncovered = {c.code for c in report.coverage if c.status == "not-covered"}
    assert ("DYN001" in uncovered) == (frames < 4)
    assert ("KIN003" in uncovered) == (frames < 11)
    json.dumps(report.to_dict(), allow_nan=False)


def test_model_without_contact_geometry_says_so(biped: Character, hop: Clip) -> None:
    from physretarget.validation.chunk import Workspace

    text = """<mujoco><worldbody><body pos="0 0 1"><freejoint/><inertial pos="0 0 0" mass="1"
    diaginertia=".1 .1 .1"/><body><joint name="j" axis="0 1 0" range="-1 1" limited="true"/>
    <inertial pos=".1 0 0" mass="1" diaginertia=".1 .1 .1"/></body></body></worldbody></mujoco>"""
    bare = Character.from_xml(text, name="bare")
    assert len(Workspace.build(bare, tolerance=0.01, friction=1.0).points) == 0
    qpos = np.tile(bare.reference_qpos, (30, 1))
    report = validate(Clip(qpos=qpos, time=np.arange(30) / 30), bare)
    uncovered = {c.code: c.reason for c in report.coverage if c.status == "not-covered"}
    assert {"CON001", "CON002", "CON003", "DYN001", "KIN005"} <= set(uncovered)
    assert "contact geometry" in uncovered["CON003"]
    assert value(report, "required_force_vertical_mean_bw") == pytest.approx(1, abs=1e-6)
    assert report.measures["unexplained_force_rms_bw"].value is None


def test_uneven_time_is_resampled_and_frames_stay_the_clips_own(
    biped: Character, hop: Clip
) -> None:
    kept = np.r_[0:50, 53 : hop.frames]
    uneven = replace(hop, qpos=hop.qpos[kept], time=hop.time[kept])
    report = validate(uneven, biped)
    gap = next(f for f in report.findings if f.code == "DAT001")
    assert gap.severity == "error"
    assert gap.frame == 50
    assert report.clip.frames == len(kept)


def test_forces_for_the_replay_add_up(biped: Character, standing: Clip) -> None:
    report = validate(standing, biped)
    assert report.forces is not None
    assert report.forces.vector.shape == (standing.frames, 4, 3)
    total = report.forces.vector.sum(axis=1)
    np.testing.assert_allclose(total, np.tile([0, 0, 1.0], (standing.frames, 1)), atol=1e-4)
    loaded = report.forces.vector[0, :, 2] > 0.1
    np.testing.assert_allclose(report.forces.origin[0, loaded, 2], 0, atol=1e-6)
