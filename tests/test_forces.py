"""Ground forces without plates: physics that must hold, a simulated hopper, and real plates."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import physretarget
from physretarget.capture.actor import SEGMENT, ActorMotion, ActorShape
from physretarget.capture.mot import GroundForce, read_mot, write_forces
from physretarget.capture.recording import Source
from physretarget.errors import InputError, UsageError
from physretarget.groundtruth import coverage, foot_agreement, load_trial, standing_weight
from physretarget.kinematics import runs
from physretarget.kinetics import forces, ground_wrench
from physretarget.kinetics.flight import Flights, measure_flights
from physretarget.kinetics.picture import write_picture
from physretarget.kinetics.treadmill import belt_velocity
from physretarget.mjcf import actor_character, momentum

FPS, MASS, G = 200.0, 70.0, 9.81
SOURCE = Source(path="x.trc", sha256="", format="trc", unit="m", up="z", fps=FPS, frames=1)

# A body's frame on a leg's spring, 9 of its 70 kg hung inside (Minetti and Belli 1994) softer
# than it hops: they move against it, and the frame more than the centre of mass.
HOPPER = """<mujoco><option timestep="0.0005" gravity="0 0 -9.81" integrator="RK4"/><worldbody>
<body name="frame"><joint name="z" type="slide" axis="0 0 1"/>
  <inertial pos="0 0 0" mass="{frame}" diaginertia="1 1 1"/>
  <body name="organs"><joint name="y" type="slide" axis="0 0 1" stiffness="{stiff}"
    damping="{damp}" springref="{rest}"/>
    <inertial pos="0 0 0" mass="{organs}" diaginertia="1 1 1"/></body></body>
</worldbody></mujoco>"""


@dataclass(frozen=True)
class Hop:
    """A motion of the actor, and the vertical force (T,) N that truly was under its feet."""

    motion: ActorMotion
    force: np.ndarray


def hopping(organs: float = 9.0, hz: float = 1.6, seconds: float = 6.0) -> Hop:
    """Simulate the hopper with MuJoCo and pose the actor so that its frame is where it was."""
    stiff = organs * (2 * np.pi * hz) ** 2
    model = mujoco.MjModel.from_xml_string(
        HOPPER.format(
            frame=MASS - organs, organs=organs, stiff=stiff,
            damp=2 * 0.15 * organs * 2 * np.pi * hz, rest=organs * G / stiff,
        )
    )  # fmt: skip
    data = mujoco.MjData(model)
    leg = MASS * (2 * np.pi * 3.2) ** 2  # N/m
    data.qpos[0] = 0.02
    every, heights, pushes = round(1 / FPS / model.opt.timestep), [], []
    apex = 0.02
    for step in range(round((seconds + 4.0) / model.opt.timestep)):
        push = max(0.0, -leg * data.qpos[0])
        # Muscles give back what organs damp: stiffer on the way up, so that hops stay high.
        if push and data.qvel[0] > 0:
            push *= 1.0 + 12.0 * max(0.0, 0.04 - apex)
        data.qfrc_applied[0] = push
        mujoco.mj_step(model, data)
        if data.qpos[0] > 0 and abs(data.qvel[0]) < 0.01:
            apex = float(data.qpos[0])
        if step % every == 0:
            heights.append(float(data.qpos[0]))
            pushes.append(push)
    settled = round(4.0 * FPS)
    return Hop(posed(np.array(heights[settled:])), np.array(pushes[settled:]))


def posed(height: np.ndarray) -> ActorMotion:
    """The actor's centre of mass at ``height`` (T,) about that of slightly bent legs on the floor.

    Below it the knees bend and the feet stay; above, the feet leave and the legs are drawn up.
    """
    shape = replace(ActorShape.reference(), mass=MASS)
    character = actor_character(shape)
    bends = np.linspace(0.15, 1.6, 300)
    poses = np.stack([_crouched(shape, bend) for bend in bends])
    com = momentum(character, poses, np.zeros((len(poses), character.model.nv))).com[:, 2]
    wanted = com[60] + height
    bent = np.interp(-np.minimum(wanted, com[60]), -com, bends)
    for first, last in runs(height > 0):
        bent[first : last + 1] += 0.5 * np.sin(np.linspace(0, np.pi, last - first + 1))
    frames = np.stack([_crouched(shape, float(bend)) for bend in bent])
    frames[:, 2] += wanted - np.interp(bent, bends, com)
    time = np.arange(len(height)) / FPS
    return ActorMotion(
        shape=shape, time=time, qpos=frames, fps=FPS, valid=np.ones(len(time), dtype=bool),
        marker_error_rms=0.0, source=SOURCE,
    )  # fmt: skip


def _crouched(shape: ActorShape, bend: float) -> np.ndarray:
    """qpos with knees bent by ``bend`` rad, soles flat on the floor, feet where they were."""
    qpos = np.zeros(75)
    qpos[3::4] = 1.0
    thigh = -shape.offset[SEGMENT["left_shank"], 2]
    shank = -shape.offset[SEGMENT["left_foot"], 2]
    hip = np.arctan2(shank * np.sin(bend), thigh + shank * np.cos(bend))
    for name, angle in (("thigh", -hip), ("shank", bend), ("foot", hip - bend)):
        x, y, z, w = Rotation.from_rotvec([0.0, angle, 0.0]).as_quat()
        for side in ("left", "right"):
            at = 3 + 4 * SEGMENT[f"{side}_{name}"]
            qpos[at : at + 4] = w, x, y, z
    reach = np.hypot(thigh + shank * np.cos(bend), shank * np.sin(bend))
    qpos[:3] = shape.offset[0]
    qpos[2] -= thigh + shank - reach
    return qpos


@pytest.fixture(scope="module")
def hop() -> Hop:
    return hopping()


def slope(predicted: np.ndarray, true: np.ndarray) -> float:
    return float(np.polyfit(true, predicted, 1)[0])


def test_a_hopper_whose_organs_lag_is_predicted_within_5_percent(hop):
    found = forces(hop.motion, lowpass_hz=20.0)
    inside = slice(40, -40)
    assert found.flights > 8
    assert slope(found.total[inside, 2], hop.force[inside]) == pytest.approx(1.0, abs=0.05)
    error = (found.total[inside, 2] - hop.force[inside]) / found.weight
    assert np.sqrt(np.mean(error**2)) < 0.1
    # The control: the same body taken for rigid is as wrong as runs were.
    rigid = ground_wrench(hop.motion, hz=20.0)
    weight = found.weight
    uncorrected = weight + (rigid.force[inside, 2] - weight) * rigid.flights.gain
    assert slope(uncorrected, hop.force[inside]) > 1.12


def test_a_rigid_hopper_is_left_as_it_is():
    found = forces(hopping(organs=0.01, hz=30.0).motion, lowpass_hz=20.0)
    assert found.vertical_gain == pytest.approx(1.0, abs=0.01)


def test_the_gain_is_that_of_flights_and_one_without():
    time = np.arange(400) / 100.0
    airborne = (time % 0.4) > 0.25
    height = -0.5 * 1.15 * G * ((time % 0.4) - 0.33) ** 2
    found = measure_flights(height, airborne, time)
    assert found.count == 9
    assert found.gain == pytest.approx(1.15, abs=0.01)
    assert measure_flights(height, np.zeros(400, dtype=bool), time) == Flights()
    # Who stands on something unseen, or hangs, does not fall: that is no flight.
    assert measure_flights(np.ones(400), airborne, time) == Flights()


def test_a_flight_too_short_to_measure_hardly_counts():
    time = np.arange(200) / 60.0
    airborne = np.zeros(200, dtype=bool)
    airborne[99:104] = True
    height = -0.5 * 1.3 * G * (time - time[101]) ** 2
    found = measure_flights(height, airborne, time)
    assert found.count == 1
    assert found.gain == pytest.approx(1.05, abs=0.02)


def test_a_wrong_frame_rate_is_said_and_not_corrected(hop):
    slow = replace(hop.motion, time=hop.motion.time * 1.45, fps=FPS / 1.45)
    found = forces(slow)
    assert found.vertical_gain == 1.0
    assert any("frame rate" in note and "fall at 0.5" in note for note in found.notes)
    assert not any("frame rate" in note for note in forces(hop.motion).notes)


def test_contact_found_a_little_late_does_not_blur_a_flight():
    time = np.arange(1000) / 500.0
    phase = time % 0.4
    acceleration = np.where((phase > 0.25) & (phase < 0.386), -1.1 * G, 30.0)
    height = np.cumsum(np.cumsum(acceleration)) / 500.0**2
    found = measure_flights(height, phase > 0.25, time)  # the last 14 ms are on the floor
    assert found.count == 4
    assert found.gain == pytest.approx(1.1, abs=0.01)


def test_impulse_over_whole_hops_is_weight_times_time(hop):
    found = forces(hop.motion)
    down = np.flatnonzero(np.diff(found.contact.any(axis=1).astype(int)) == 1)
    first, last = down[1], down[-2]
    mean = found.total[first:last, 2].mean()
    assert mean == pytest.approx(found.weight, rel=0.01)


def test_nothing_pushes_in_flight_and_nothing_pulls(hop):
    found = forces(hop.motion)
    flying = ~found.contact.any(axis=1)
    assert flying.any()
    assert not found.total[flying].any()
    assert min(found.left.force[:, 2].min(), found.right.force[:, 2].min()) >= 0.0


def test_standing_is_shared_evenly_below_the_body():
    found = forces(posed(np.full(100, -0.01)))
    np.testing.assert_allclose(found.total[:, 2], MASS * G, rtol=1e-6)
    np.testing.assert_allclose(found.left.force[:, 2], found.right.force[:, 2], rtol=1e-3)
    np.testing.assert_allclose(found.left.point[:, 1], -found.right.point[:, 1], atol=1e-6)
    np.testing.assert_allclose(found.left.torque + found.right.torque, 0.0, atol=1e-6)
    assert np.abs(found.left.point[:, 1] - 0.0875).max() < 0.03
    assert not found.left.point[:, 2].any()


def test_force_and_moment_of_both_feet_are_those_that_the_motion_asks_for():
    time = np.arange(400) / FPS
    motion = posed(-0.04 - 0.03 * np.sin(2 * np.pi * 0.8 * time))
    qpos = motion.qpos.copy()
    lean = Rotation.from_rotvec(np.outer(0.05 * np.sin(2 * np.pi * 0.5 * time), [0.3, 1.0, 0.6]))
    qpos[:, [12, 13, 14, 11]] = lean.as_quat()  # the abdomen, and all above it
    found = forces(replace(motion, qpos=qpos), lowpass_hz=None)
    asked = ground_wrench(replace(motion, qpos=qpos), hz=None)
    np.testing.assert_allclose(found.total, asked.force, atol=1e-6)
    moment = np.zeros_like(asked.moment)
    for foot in (found.left, found.right):
        moment += np.cross(foot.point - asked.com, foot.force) + foot.torque
    # The evenest load may stray from the centre of pressure by a few mm.
    np.testing.assert_allclose(moment[:, :2], asked.moment[:, :2], atol=0.005 * MASS * G)
    np.testing.assert_allclose(moment[:, 2], asked.moment[:, 2], atol=1e-6)


def test_a_treadmill_changes_no_force(hop):
    belt = np.array([-2.5, 0.3])
    moved = hop.motion.qpos.copy()
    on_floor = forces(hop.motion)
    slid = np.cumsum(np.where(on_floor.contact.max(axis=1)[:, None], belt, -belt * 1.2), axis=0)
    moved[:, :2] += (slid - slid.mean(axis=0)) / FPS  # back on the belt, forward in flight
    motion = replace(hop.motion, qpos=moved)
    assert not belt_velocity(hop.motion).any()
    np.testing.assert_allclose(belt_velocity(motion), belt, atol=0.1)
    found = forces(motion)
    # Here the body is thrown forward in flight, which legs would do: contact is blurred a little.
    assert (found.contact == on_floor.contact).mean() > 0.9
    assert any("treadmill" in note for note in found.notes)
    assert slope(found.total[:, 2], on_floor.total[:, 2]) == pytest.approx(1.0, abs=0.05)


def test_mass_scales_every_force(hop):
    heavy, light = forces(hop.motion, mass=140.0), forces(hop.motion, mass=70.0)
    np.testing.assert_allclose(heavy.total, 2 * light.total, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(heavy.left.point, light.left.point, atol=1e-6)


def test_a_mot_file_is_read_back(hop, tmp_path: Path):
    motion = replace(hop.motion, source=replace(SOURCE, start=1.5))
    found = forces(motion)
    found.write(tmp_path / "f.mot")
    right, left = read_mot(tmp_path / "f.mot")
    assert (right.name, left.name) == ("r", "l")
    np.testing.assert_allclose(right.time, found.time + 1.5, atol=1e-6)
    for read, foot in ((right, found.right), (left, found.left)):
        np.testing.assert_allclose(read.force, foot.force, atol=1e-5)
        np.testing.assert_allclose(read.point, foot.point, atol=1e-5)
        np.testing.assert_allclose(read.torque, foot.torque, atol=1e-5)
    header = (tmp_path / "f.mot").read_text().splitlines()
    assert f"nRows={len(found.time)}" in header
    assert header[6].split("\t")[:3] == ["time", "ground_force_r_vx", "ground_force_r_vy"]
    assert len(header) == 7 + len(found.time)


def test_the_csv_has_the_same_columns_and_y_is_up(hop, tmp_path: Path):
    found = forces(hop.motion)
    found.write(tmp_path / "f.csv")
    table = np.genfromtxt(tmp_path / "f.csv", delimiter=",", names=True)
    np.testing.assert_allclose(table["ground_force_l_vy"], found.left.force[:, 2], atol=1e-5)
    np.testing.assert_allclose(table["ground_force_l_py"], 0.0, atol=1e-9)


def test_other_endings_and_clocks_are_refused(hop, tmp_path: Path):
    with pytest.raises(UsageError, match=r"\.mot or \.csv"):
        forces(hop.motion).write(tmp_path / "f.txt")
    row = np.zeros((3, 3))
    one = GroundForce(name="r", time=np.arange(3.0), force=row, point=row, torque=row)
    late = replace(one, name="l", time=np.arange(3.0) + 1)
    with pytest.raises(UsageError, match="one clock"):
        write_forces([one, late], tmp_path / "f.mot")
    assert not list(tmp_path.iterdir())


def test_who_never_stands_and_impossible_masses_are_refused(hop):
    qpos = hop.motion.qpos.copy()
    qpos[:, 0] += 3.0 * hop.motion.time**2  # carried along, faster and faster
    with pytest.raises(InputError, match="no foot"):
        forces(replace(hop.motion, qpos=qpos).cut(400, 900))
    for mass in (0.0, -1.0, float("nan")):
        with pytest.raises(UsageError, match="mass"):
            forces(hop.motion, mass=mass)


def test_slow_captures_get_a_filter_that_they_can_have(hop):
    found = forces(hop.motion.resampled(20.0))
    assert found.lowpass_hz == pytest.approx(8.0)
    assert any("low-pass at 8 Hz" in note for note in found.notes)
    with pytest.raises(UsageError, match="not possible"):
        forces(hop.motion.resampled(20.0), lowpass_hz=15.0)


def test_a_picture_can_be_had(hop, tmp_path: Path):
    write_picture(forces(hop.motion), tmp_path / "f.png")
    assert (tmp_path / "f.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(UsageError, match=r"\.png"):
        write_picture(forces(hop.motion), tmp_path / "f.pdf")


@pytest.mark.parametrize(
    ("name", "total", "centre"), [("squats1", 0.03, 0.05), ("walking1", 0.08, 0.03)]
)
def test_real_plates_agree(data: Path, name: str, total: float, centre: float):
    folder = data / "grf/opencap_subject4"
    weight = standing_weight(folder / "static1_grf.mot")
    trial = load_trial(folder / f"{name}.trc", folder / f"{name}_grf.mot", weight=weight)
    found = foot_agreement(trial, coverage(trial))
    assert found is not None
    assert found.total < total
    assert max(found.centre_forward, found.centre_left) < centre
    assert found.vertical < 0.07


def test_forces_are_a_verb_of_the_package():
    assert physretarget.forces is forces
