"""The clip played forward: what holds of every simulation, on a box with an arm."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from physretarget.clip import Clip, load_clip
from physretarget.errors import InputError, UsageError
from physretarget.mjcf import Character
from physretarget.options.simulation import SimulationOptions
from physretarget.report.simulation import render_simulation, simulation_scene
from physretarget.simulate import (
    Simulation,
    SimulationSettings,
    follow,
    model_of,
    replay,
    settings_of,
    simulate,
)
from physretarget.simulate import track as track_module
from physretarget.simulate.body import build_body
from physretarget.simulate.reference import build_reference
from physretarget.simulate.torques import gravity_torques
from physretarget.validation import validate

BOX = """
<mujoco model="box">
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 0.05"/>
    <body name="base" pos="0 0 0.05">
      <freejoint name="root"/>
      <geom type="box" size="0.1 0.1 0.05" mass="2"/>
      <body name="arm" pos="0 0 0.05">
        <joint name="shoulder" axis="0 1 0" range="-90 90" damping="0.01"/>
        <geom type="capsule" fromto="0 0 0 0 0 0.2" size="0.02" mass="0.3"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""

DOCS = Path(__file__).parents[2] / "docs" / "validate.md"


def _box(xml: str = BOX) -> Character:
    return Character.from_xml(xml)


def _nod(character: Character, seconds: float = 0.8, angle: float = 0.5) -> Clip:
    """The arm swings forward and back while the box stands."""
    time = np.arange(round(seconds * 30) + 1) / 30
    qpos = np.tile(character.reference_qpos, (len(time), 1))
    qpos[:, -1] = angle * np.sin(np.pi * time / seconds) ** 2
    return Clip(qpos=qpos, time=time, joint_names=character.joint_names)


@pytest.fixture(scope="module")
def nod() -> Simulation:
    character = _box()
    return simulate(_nod(character), character)


@pytest.fixture(scope="module")
def saved(nod: Simulation, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sim")
    nod.save(folder / "SIM.npz")
    (folder / "model.xml").write_text(BOX)
    return folder


def test_a_clip_that_can_happen_is_played_to_its_end(nod: Simulation) -> None:
    assert nod.survived
    assert nod.measures.survived_s == pytest.approx(0.8)
    assert nod.measures.tracking_share < 0.005
    assert nod.measures.joint_limit_excess_max_rad < 0.02
    assert nod.measures.trackability > 0.9


def test_no_force_acts_on_the_root_without_assist(nod: Simulation) -> None:
    assert not nod.qfrc_applied[:, :6].any()
    assert nod.qfrc_applied[:, 6].any()


def test_plain_mujoco_reproduces_every_bit(saved: Path) -> None:
    with np.load(saved / "SIM.npz") as sim:
        model = model_of(sim, saved / "model.xml")
        assert (replay(sim, model) == sim["qpos"]).all()


def test_the_scripts_of_the_docs_do_what_they_say(
    saved: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(saved)
    blocks = re.findall(r"```python\n(.*?)```", DOCS.read_text(), re.S)
    scripts = [block for block in blocks if "mj_step" in block]
    assert len(scripts) == 2
    names: dict[str, object] = {}
    for script in scripts:
        exec(script, names)
    with np.load("SIM.npz") as sim:
        assert (names["poses"] == sim["qpos"]).all()
        start = sim["sim_qpos0"] + 0.005 * np.eye(8)[0]
        ours = follow(sim, model_of(sim, "model.xml"), start, sim["sim_qvel0"])
    assert names["data"].qpos == pytest.approx(ours[-1])  # type: ignore[attr-defined]


def test_the_gains_lead_back_from_a_disturbed_pose(nod: Simulation, saved: Path) -> None:
    """A push on the arm dies out; played without the gains it stays."""
    with np.load(saved / "SIM.npz") as loaded:
        sim = dict(loaded)
    model = model_of(sim, saved / "model.xml")
    start = sim["sim_qpos0"].copy()
    start[-1] += 0.1
    after = follow(sim, model, start, sim["sim_qvel0"])[-1, -1] - sim["qpos"][-1, -1]
    sim["sim_gain"] = np.zeros_like(sim["sim_gain"])
    without = follow(sim, model, start, sim["sim_qvel0"])[-1, -1] - sim["qpos"][-1, -1]
    assert abs(after) < 0.02 < 0.1 < abs(without)


def test_a_simulation_is_a_clip_without_errors_of_dynamics(saved: Path) -> None:
    character = _box()
    report = validate(load_clip(saved / "SIM.npz", character=character), character)
    errors = [f.code for f in report.findings if f.severity == "error"]
    assert not [code for code in errors if code.startswith("DYN")]


def test_the_same_clip_gives_the_same_bytes(nod: Simulation) -> None:
    character = _box()
    again = simulate(_nod(character), character)
    assert (again.clip.qpos == nod.clip.qpos).all()
    assert (again.qfrc_applied == nod.qfrc_applied).all()
    assert (again.gain == nod.gain).all()


def test_torque_limits_are_kept_exactly() -> None:
    """The arm's own weight held out takes more than the limit: it sinks, at the limit."""
    limited = BOX.replace('damping="0.01"', 'damping="0.01" actuatorfrcrange="-0.1 0.1"')
    character = _box(limited)
    played = simulate(_nod(character, angle=1.2), character)
    torque = played.qfrc_applied[:, 6]
    assert np.abs(torque).max() == 0.1
    assert played.measures.torque_saturated_fraction > 0.1
    assert played.measures.tracking_share > 0.01


def test_limits_of_an_actuator_count_with_its_gear() -> None:
    motor = '<actuator><motor joint="shoulder" gear="2" forcerange="-0.1 0.1"/></actuator></mujoco>'
    played = simulate(_nod(_box(), seconds=0.2), _box(BOX.replace("</mujoco>", motor)))
    assert played.torque_limit[6] == pytest.approx(0.2)


def test_a_statue_that_leans_is_lost_and_held_up_by_assist() -> None:
    """On one edge at 40 degrees nothing holds the box; a hand can."""
    character = _box()
    clip = _nod(character, seconds=1.0, angle=0.0)
    lean = np.deg2rad(40.0)
    clip.qpos[:, 2] = 0.1 * np.sin(lean) + 0.05 * np.cos(lean)
    clip.qpos[:, 3:7] = [np.cos(lean / 2), 0.0, np.sin(lean / 2), 0.0]
    alone = simulate(clip, character)
    assert alone.ending == "lost"
    assert 0.1 < alone.measures.survived_s < 0.9
    helped = simulate(clip, character, settings_of(SimulationOptions(assist=True)))
    assert helped.survived
    assert helped.measures.tracking_share < 0.2
    assert helped.measures.assist_moment_rms_bwh > 0.05
    assert helped.measures.trackability < 0.7


def test_a_standing_body_needs_no_assist() -> None:
    character = _box()
    clip = _nod(character, seconds=0.4, angle=0.0)
    played = simulate(clip, character, settings_of(SimulationOptions(assist=True)))
    assert played.survived
    assert played.measures.assist_force_rms_bw < 0.01


def test_a_fall_from_rest_is_followed() -> None:
    """Free flight is no reason to fail."""
    character = _box()
    clip = _nod(character, seconds=0.3, angle=0.0)
    clip.qpos[:, 2] = 1.0 - 0.5 * 9.81 * clip.time**2
    played = simulate(clip, character)
    assert played.survived
    assert played.measures.tracking_share < 0.005


def test_a_floor_is_added_and_servo_gains_are_left_out() -> None:
    floorless = BOX.replace('<geom name="floor" type="plane" size="0 0 0.05"/>', "")
    sprung = floorless.replace('damping="0.01"', 'damping="5" stiffness="100"')
    motor = '<actuator><motor joint="shoulder"/></actuator></mujoco>'
    character = _box(sprung.replace("</mujoco>", motor))
    played = simulate(_nod(character, seconds=0.3), character)
    assert played.survived
    model = mujoco.MjModel.from_xml_string(played.model_xml)
    assert model.jnt_stiffness.max() == 0
    assert (model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE).any()
    assert any("no floor" in note for note in played.notes)
    assert any("gains" in note for note in played.notes)


def test_a_clip_that_stands_in_the_floor_is_lifted() -> None:
    character = _box()
    clip = _nod(character, seconds=0.3, angle=0.0)
    clip.qpos[:, 2] -= 0.02
    played = simulate(clip, character)
    assert played.lift_m == pytest.approx(0.02, abs=1e-3)
    assert any("raised by 20 mm" in note for note in played.notes)


def test_an_interrupt_keeps_what_was_played(monkeypatch: pytest.MonkeyPatch) -> None:
    character = _box()

    def interrupt(done: float, whole: float) -> None:
        if done > 0.25:
            raise KeyboardInterrupt

    played = simulate(_nod(character), character, progress=interrupt)
    assert played.ending == "interrupted"
    assert 0.25 < played.measures.survived_s < 0.5
    assert len(played.qfrc_applied) == len(played.clip.qpos) - 1


def test_progress_is_told_in_seconds() -> None:
    character, told = _box(), []
    simulate(_nod(character, seconds=0.3), character, progress=lambda a, b: told.append((a, b)))
    assert told[-1] == pytest.approx((0.3, 0.3), abs=0.005)
    assert [a for a, _ in told] == sorted(a for a, _ in told)


def test_a_fixed_body_cannot_be_simulated() -> None:
    fixed = _box(BOX.replace('<freejoint name="root"/>', ""))
    with pytest.raises(UsageError, match="no free root"):
        simulate(_nod(fixed), fixed)


def test_a_moment_is_too_short() -> None:
    character = _box()
    clip = Clip(qpos=np.tile(character.reference_qpos, (2, 1)), time=np.array([0.0, 0.01]))
    with pytest.raises(InputError, match="at least"):
        simulate(clip, character)


def test_options_of_the_file_are_numbers(nod: Simulation) -> None:
    options = json.loads(nod.options)
    assert options["timestep"] == nod.timestep == 0.002
    assert options["gravity"] == [0.0, 0.0, -9.81]


def test_what_was_lost_is_tried_again_with_more_care(monkeypatch: pytest.MonkeyPatch) -> None:
    """A stretch that fails once is planned again; the second time it is played."""
    character, failures = _box(), []
    errors = track_module.marker_errors

    def once(reference: object, qpos: object, first: int) -> object:
        found = errors(reference, qpos, first)  # type: ignore[arg-type]
        if first == 100 and not failures:
            failures.append(first)
            return found + 1.0
        return found

    monkeypatch.setattr(track_module, "marker_errors", once)
    played = simulate(_nod(character), character, SimulationSettings())
    assert failures
    assert played.survived
    assert played.measures.survived_s == pytest.approx(0.8)


def test_what_stands_on_its_root_throws_itself_with_its_limbs() -> None:
    """The box stands: its arm has to be able to throw the whole weight, at the arm's reach."""
    character = _box()
    reach = 0.1  # m from the shoulder to the arm's centre of mass
    assert gravity_torques(character)[-1] == pytest.approx(character.weight * reach)


def test_the_first_speed_is_open_only_where_the_clip_changes_it() -> None:
    character = _box()
    body = build_body(character, SimulationSettings())
    steady, sudden = _nod(character), _nod(character)
    steady.qpos[:, -1] = 2.0 * steady.time
    sudden.qpos[:, -1] = np.where(sudden.time > 0.05, 2.0 * (sudden.time - 1 / 30), 0.0)
    for clip, doubt in ((steady, 0.0), (sudden, 2.0)):
        reference = build_reference(clip, body, SimulationSettings())
        assert reference.speed_doubt[-1] == pytest.approx(doubt, abs=1e-9)
        assert not reference.speed_doubt[:-1].any()


def test_noise_is_drawn_from_the_seed() -> None:
    """Every window counts as hard where none is good enough."""
    character = _box()
    clip = _nod(character, seconds=0.2)

    def torques(seed: int) -> np.ndarray:
        settings = SimulationSettings(stuck=0.0, seed=seed, iterations=2, hard_iterations=2)
        return simulate(clip, character, settings).qfrc_applied

    assert np.array_equal(torques(1), torques(1))


def test_a_spring_adds_what_it_pulls_to_the_limit() -> None:
    """A tail held against its own spring needs more than gravity asks of it."""
    plain, sprung = (
        build_body(
            _box(BOX.replace('damping="0.01"', f'damping="0.01" stiffness="{k}"')),
            SimulationSettings(),
        )
        for k in (0.0, 3.0)
    )
    assert sprung.high[-1] - plain.high[-1] == pytest.approx(3.0 * np.pi / 2)


def test_the_page_shows_the_clip_over_the_simulation(nod: Simulation) -> None:
    """Two bodies in one place; where the body is lost the moment is marked."""
    character = _box()
    clip = _nod(character)
    scene = simulation_scene(nod, clip, character)
    assert [each.name for each in scene.figures] == ["simulation", "clip"]
    gap = scene.figures[0].position[:, -1] - scene.figures[1].position[:, -1]
    assert np.abs(gap).max() < 0.005
    assert not scene.marks
    lost = replace(
        nod, ending="lost", measures=replace(nod.measures, survived_s=0.4)
    )  # fmt: skip
    (mark,) = simulation_scene(lost, clip, character).marks
    assert mark.code == "SIM001"
    assert mark.frame_first == 12
    page = render_simulation(lost, clip, character)
    assert "is lost at 0.40 s of 0.80 s" in page


def test_a_walk_is_followed_from_aside_and_on_a_smoother_floor(data: Path, tmp_path: Path) -> None:
    """5 mm aside, and friction down to 0.6: under the recorded gains a G1 keeps walking.

    Planned with all friction it slips on 0.8 and ends 15 cm off.
    """
    model = data / "robot" / "g1_no_mesh_box_feet.xml"
    character = Character.load(model)
    clip = load_clip(data / "robot" / "g1_walk.csv", character=character, fps=30.0, quat="wxyz")
    short = replace(clip, qpos=clip.qpos[:25], time=clip.time[:25], contact_active=None)
    simulate(short, character).save(tmp_path / "SIM.npz")
    with np.load(tmp_path / "SIM.npz") as loaded:
        sim = dict(loaded)
    assert (replay(sim, model_of(sim, model)) == sim["qpos"]).all()
    for friction in (None, 0.8, 0.6):
        played = model_of(sim, model)
        if friction is not None:
            played.geom_friction[:, 0] = np.minimum(played.geom_friction[:, 0], friction)
        for aside in ((0.005, 0.0), (-0.005, 0.0), (0.0, 0.005), (0.0, -0.005)):
            start = sim["sim_qpos0"].copy()
            start[:2] += aside
            end = follow(sim, played, start, sim["sim_qvel0"])[-1]
            assert np.linalg.norm(end[:3] - sim["qpos"][-1, :3]) < 0.02


def test_plans_are_kept_only_where_a_retreat_leads() -> None:
    """What a simulation holds per second of a clip does not grow with windows' lengths."""
    character = _box()
    settings = SimulationSettings()
    body = build_body(character, settings)
    reference = build_reference(_nod(character, seconds=2.0), body, settings)
    played = track_module.track(reference)
    kept = [piece.plan is not None for piece in played.pieces]
    assert len(kept) == 20
    assert kept == sorted(kept)
    assert 8 <= sum(kept) <= 12
