from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from physretarget.capture.actor import ActorMotion, ActorShape
from physretarget.capture.mot import GroundForce
from physretarget.capture.recording import Source
from physretarget.errors import InputError
from physretarget.groundtruth import (
    Trial,
    by_fitted_forces,
    by_measured_forces,
    compare,
    contact_timing,
    coverage,
    load_plate_trial,
    load_trial,
    load_trials,
    loaded_feet,
    standing_weight,
    with_weight_of_impulse,
)
from physretarget.groundtruth.__main__ import main
from physretarget.groundtruth.page import judge, write_page
from physretarget.groundtruth.trial import GRAVITY, smoothed
from physretarget.mjcf import lowpass

FPS = 100.0
SECONDS = 3.0
WEIGHT = 600.0
SOURCE = Source(path="x.trc", sha256="", format="trc", unit="m", up="z", fps=FPS, frames=301)


def actor_at(height: np.ndarray) -> ActorMotion:
    """The reference actor in its zero pose, its soles `height` (T,) above the floor."""
    shape = replace(ActorShape.reference(), mass=WEIGHT / GRAVITY)
    time = np.arange(len(height)) / FPS
    qpos = np.zeros((len(height), 75))
    qpos[:, 3::4] = 1.0
    qpos[:, :3] = shape.offset[0]
    qpos[:, 2] += height
    return ActorMotion(
        shape=shape, time=time, qpos=qpos, fps=FPS, valid=np.ones(len(height), dtype=bool),
        marker_error_rms=0.0, source=SOURCE,
    )  # fmt: skip


def under_feet(motion: ActorMotion, vertical: np.ndarray) -> tuple[GroundForce, ...]:
    """`vertical` (T,) N shared by two plates so that its centre is below the actor's CoM."""
    trial = Trial(name="", motion=motion, forces=(), weight=WEIGHT)
    character = trial.character
    data = mujoco.MjData(character.model)
    data.qpos = motion.qpos[0]
    mujoco.mj_fwdPosition(character.model, data)
    centre = data.subtree_com[character.root_body]
    plates = []
    for name, side in (("1", -1.0), ("2", 1.0)):  # the right foot first: columns know no order
        point = np.tile([centre[0], centre[1] + 0.0875 * side, 0.0], (len(vertical), 1))
        force = np.zeros((len(vertical), 3))
        force[:, 2] = 0.5 * vertical
        plates.append(
            GroundForce(
                name=name, time=motion.time, force=force, point=point, torque=np.zeros_like(force)
            )
        )
    return tuple(plates)


def standing() -> Trial:
    motion = actor_at(np.zeros(301))
    forces = under_feet(motion, np.full(301, WEIGHT))
    return Trial(name="standing", motion=motion, forces=forces, weight=WEIGHT)


def bouncing(scale: float = 1.0, late: float = 0.0) -> Trial:
    """A rigid body that goes up and down by 1 cm at 1 Hz, so that its force is known exactly."""
    time = np.arange(301) / FPS
    motion = actor_at(0.01 * (1 - np.cos(2 * np.pi * time)))
    acceleration = 0.01 * (2 * np.pi) ** 2 * np.cos(2 * np.pi * (time - late))
    vertical = scale * WEIGHT * (1 + acceleration / GRAVITY)
    return Trial(name="bouncing", motion=motion, forces=under_feet(motion, vertical), weight=WEIGHT)


def test_the_plates_get_the_filter_that_the_motion_gets():
    trial = standing()
    noise = np.random.default_rng(1).normal(size=(301, 3))
    qpos = trial.motion.qpos.copy()
    qpos[:, :3] += 0.01 * noise
    moved = lowpass(trial.character, qpos, FPS, 6.0)[:, :3] - trial.motion.qpos[:, :3]
    np.testing.assert_allclose(smoothed(0.01 * noise, trial.motion.time, 6.0), moved, atol=1e-9)


def test_a_known_force_is_predicted():
    trial = bouncing()
    found = compare(trial, coverage(trial), hz=6.0)
    assert found.frames.sum() == 281
    assert found.vertical.rmse < 1e-3
    assert found.vertical.r is not None
    assert found.vertical.r > 0.999
    assert found.vertical.slope == pytest.approx(1.0, abs=5e-3)
    assert found.impulse_ratio == pytest.approx(1.0, abs=2e-3)
    assert found.delay == pytest.approx(0.0, abs=1e-3)
    assert max(found.forward.rmse, found.left.rmse) < 1e-9
    assert found.forward.r is None


def test_plates_that_read_too_much_or_too_late_are_found_out():
    loud = compare(bouncing(1.1), coverage(bouncing(1.1)), hz=6.0)
    assert loud.vertical.bias == pytest.approx(-0.1, abs=2e-3)
    assert loud.impulse_ratio == pytest.approx(1.1, abs=3e-3)
    assert loud.vertical.slope == pytest.approx(1.1, abs=6e-3)
    late = bouncing(late=0.013)
    assert compare(late, coverage(late), hz=6.0).delay == pytest.approx(0.013, abs=1e-3)


def test_forward_is_where_the_actor_faces():
    trial = standing()
    push = np.array([0.0, 0.05 * WEIGHT, 0.0])
    forces = tuple(replace(force, force=force.force + push) for force in trial.forces)
    motion = trial.motion
    qpos = motion.qpos.copy()
    qpos[:, 3:7] = [np.sqrt(0.5), 0, 0, np.sqrt(0.5)]  # facing +y
    turned = replace(trial, motion=replace(motion, qpos=qpos), forces=forces)
    found = compare(turned, coverage(trial), hz=6.0)
    assert found.forward.bias == pytest.approx(-0.1, abs=1e-6)
    assert found.left.bias == pytest.approx(0.0, abs=1e-6)


def test_columns_are_told_apart_by_where_they_press():
    trial = standing()
    assert loaded_feet(trial).all()
    only_right = replace(trial, forces=trial.forces[:1])
    loaded = loaded_feet(only_right)
    assert loaded[:, 1].all()
    assert not loaded[:, 0].any()


def test_a_stance_beside_the_plates_is_not_covered():
    trial = standing()
    assert coverage(trial).whole.all()
    assert coverage(trial).judged.sum() == 281
    assert not coverage(replace(trial, forces=trial.forces[:1])).whole.any()


def test_frames_without_measured_forces_are_not_covered():
    trial = standing()
    short = tuple(
        GroundForce(
            name=force.name,
            time=force.time[:201],
            force=force.force[:201],
            point=force.point[:201],
            torque=force.torque[:201],
        )
        for force in trial.forces
    )
    assert np.flatnonzero(coverage(replace(trial, forces=short)).whole).max() == 200


def test_a_box_is_no_plate_until_it_is_left():
    time = np.arange(301) / FPS
    fall = np.maximum(0.3 - 0.5 * GRAVITY * np.maximum(time - 1.0, 0) ** 2, 0.0)
    motion = actor_at(fall)
    landed = fall == 0
    forces = under_feet(motion, np.where(landed, WEIGHT, 0.0))
    covered = coverage(Trial(name="drop", motion=motion, forces=forces, weight=WEIGHT))
    # From 5 cm below the box's top: 0.1 s of fall.
    assert time[np.argmax(covered.whole)] == pytest.approx(1.1, abs=0.021)
    assert covered.whole[112:].all()
    timing = contact_timing(
        Trial(name="drop", motion=motion, forces=forces, weight=WEIGHT), covered
    )
    assert len(timing.touch_down) == 2
    assert max(abs(error) for error in timing.touch_down) < 0.05


def test_measured_forces_explain_standing_and_a_centimetre_shows():
    trial = standing()
    covered = coverage(trial)
    exact = by_measured_forces(trial, covered, hz=6.0)
    assert exact.force_peak < 1e-6
    assert exact.moment_peak < 1e-6
    aside = np.array([0.01, 0.0, 0.0])
    shifted = tuple(replace(f, point=f.point + aside) for f in trial.forces)
    found = by_measured_forces(replace(trial, forces=shifted), covered, hz=6.0)
    assert found.moment_rms == pytest.approx(0.01 / trial.character.com_height, rel=1e-3)
    assert found.moment_share == pytest.approx(0.01 / trial.character.com_height, rel=1e-3)
    assert by_fitted_forces(trial, covered, hz=6.0).force_peak < 1e-3


def test_a_weight_can_be_told_from_the_impulse():
    heavier = bouncing(1.2)
    found = with_weight_of_impulse(heavier, hz=6.0)
    assert found.weight == pytest.approx(1.2 * WEIGHT, rel=3e-3)
    assert found.character.mass == pytest.approx(found.weight / GRAVITY)
    assert compare(found, coverage(found), hz=6.0).vertical.rmse < 2e-3
    with pytest.raises(InputError, match="cover too little"):
        with_weight_of_impulse(replace(heavier, forces=heavier.forces[:1]), hz=6.0)


def mot(path: Path, vertical: np.ndarray) -> Path:
    head = "a\nnRows=1\nendheader\ntime\tground_force_1_vx\tground_force_1_vy\tground_force_1_vz\n"
    rows = "".join(f"{i / 100}\t0\t{value}\t0\n" for i, value in enumerate(vertical))
    path.write_text(head + rows)
    return path


def test_weight_comes_from_standing_still(tmp_path: Path):
    assert standing_weight(mot(tmp_path / "a.mot", np.full(50, 589.0))) == pytest.approx(589)
    with pytest.raises(InputError, match="not steady"):
        standing_weight(mot(tmp_path / "b.mot", np.linspace(0, 600, 50)))


def test_folders_without_pairs_or_weight(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    with pytest.raises(InputError, match="no pair"):
        load_trials(tmp_path)
    (tmp_path / "walk.trc").write_text("PathFileType")
    mot(tmp_path / "walk_grf.mot", np.ones(5))
    assert main([str(tmp_path)]) == 2
    assert "body weight" in capsys.readouterr().err


def test_the_page_keeps_what_people_wrote_and_is_the_same_twice(tmp_path: Path):
    page = tmp_path / "page.md"
    write_page([bouncing()], page)
    first = page.read_text()
    assert "Nothing has been written" in first
    assert "| bouncing | 2.81 |" in first
    page.write_text(first.replace("Nothing has been written about these trials yet.", "By hand."))
    pictures = {path.name: path.read_bytes() for path in (tmp_path / "images").iterdir()}
    write_page([bouncing()], page)
    assert "By hand." in page.read_text()
    assert {path.name: path.read_bytes() for path in (tmp_path / "images").iterdir()} == pictures
    for name in pictures:
        assert f"images/{name}" in first


@pytest.mark.data
def test_real_plates(data: Path):
    folder = data / "grf" / "opencap_subject4"
    weight = standing_weight(folder / "static1_grf.mot")
    assert weight == pytest.approx(589, abs=1)
    for name, seconds in (("squats1", 12.0), ("walking1", 0.8), ("DJ2", 0.9)):
        trial = load_trial(folder / f"{name}.trc", folder / f"{name}_grf.mot", weight=weight)
        assert trial.character.mass == pytest.approx(weight / GRAVITY)
        one = judge(trial)
        found = one.at(6.0)
        assert found.frames.sum() > seconds * FPS
        assert found.vertical.rmse < 0.12
        assert found.vertical.r is not None
        assert found.vertical.r > 0.98
        assert found.delay is not None
        assert abs(found.delay) < 0.012
        assert one.contacts.agreement > 0.94
        assert one.measured.force_rms < 0.15
        if name != "DJ2":
            assert max(found.forward.rmse, found.left.rmse) < 0.03


@pytest.mark.data
def test_real_plates_in_a_c3d_file(data: Path):
    # Another body, laboratory and camera system; nobody stands, so the course alone is judged.
    trial = load_plate_trial(data / "c3d" / "Qualisys.c3d", weight=700.0)
    trial = with_weight_of_impulse(trial, hz=6.0)
    found = compare(trial, coverage(trial), hz=6.0)
    assert found.frames.sum() > 0.5 * trial.motion.fps
    assert found.vertical.rmse < 0.04
    assert found.vertical.r is not None
    assert found.vertical.r > 0.98
    with pytest.raises(InputError, match="no force plates"):
        load_plate_trial(data / "c3d" / "cmu_02_05.c3d", weight=700.0)
