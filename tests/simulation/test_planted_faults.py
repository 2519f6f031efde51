"""Planted faults have the size that is claimed for them, and the clips they go into are clean."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.planted_faults import puppets
from benchmarks.planted_faults.__main__ import report_of, smallest
from benchmarks.planted_faults.bases import Base, clip_of, lamp_acting, six_legs_walk, times
from benchmarks.planted_faults.faults import FAULTS, Fault, Planted
from physretarget.validation import Settings, validate

Array = NDArray[np.float64]


def centre_of_mass(base_qpos: Array, model: mujoco.MjModel) -> Array:
    data = mujoco.MjData(model)
    rows = []
    for pose in base_qpos:
        data.qpos[:] = pose
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        rows.append(data.subtree_com[1].copy())
    return np.array(rows)


def fault(name: str) -> Fault:
    return next(f for f in FAULTS if f.name == name)


def planted(name: str, base: str) -> Planted:
    return next(p for p in fault(name).planted() if p.base == base)


@pytest.mark.parametrize("fps", [30, 60, 120])
@pytest.mark.parametrize("lowpass", [None, 6.0])
@pytest.mark.parametrize("base", [six_legs_walk, lamp_acting])
def test_clips_are_clean_before(
    base: Callable[[], Base], fps: float, lowpass: float | None
) -> None:
    clean = base()
    clip = clip_of(clean.character, clean.qpos(fps), fps)
    report = validate(clip, clean.character, settings=Settings(lowpass_hz=lowpass))
    assert not [f for f in report.findings if f.severity == "error"]


def test_the_walkers_feet_stand_still_until_they_are_lifted() -> None:
    character = puppets.six_legs()
    qpos = puppets.walk(times(200))
    data = mujoco.MjData(character.model)
    spheres = [
        g for g in range(character.model.ngeom)
        if character.model.geom_type[g] == mujoco.mjtGeom.mjGEOM_SPHERE
    ]  # fmt: skip
    feet = []
    for pose in qpos:
        data.qpos[:] = pose
        mujoco.mj_kinematics(character.model, data)
        feet.append(data.geom_xpos[spheres].copy())
    path = np.array(feet)
    assert len(spheres) == 6
    down = path[..., 2] < puppets.RADIUS + 1e-6
    assert np.all(down.sum(axis=1) >= 3)
    assert not down.all()
    still = down[1:] & down[:-1]
    assert np.abs(np.diff(path, axis=0))[still].max() < 1e-3
    assert path[..., 2].min() > puppets.RADIUS - 1e-6


@pytest.mark.parametrize("statue", [puppets.biped_statue, puppets.lamp_statue])
def test_a_statue_leans_as_far_as_it_is_told(statue: Callable[[], puppets.Statue]) -> None:
    leaning = statue()
    angle = leaning.lean_for(0.02)
    assert angle is not None
    assert leaning.past_toe(angle) == pytest.approx(0.02, abs=1e-6)


@pytest.mark.parametrize("statue", [puppets.biped_statue, puppets.lamp_statue])
@pytest.mark.parametrize(
    ("past", "severity"), [(0.005, None), (0.01, "warning"), (0.02, "warning"), (0.03, "error")]
)
def test_a_centimetre_past_the_toe_warns_and_three_err(
    statue: Callable[[], puppets.Statue], past: float, severity: str | None
) -> None:
    leaning = statue()
    angle = leaning.lean_for(past)
    assert angle is not None
    clip = clip_of(leaning.character, np.tile(leaning.pose(angle), (60, 1)), 30)
    found = [f.severity for f in validate(clip, leaning.character).findings if f.code == "DYN005"]
    assert found == ([severity] if severity else [])


def test_a_statue_topples_once_its_centre_of_mass_is_past_the_toe() -> None:
    """The forward simulation agrees about where the edge is: 1 cm before it stands, beyond not."""
    statue = puppets.biped_statue()
    model = copy(statue.character.model)
    model.opt.timestep = 5e-4
    # Rotors this heavy make one rigid body of it, on a floor too hard to sink into.
    model.dof_armature[6:], model.geom_solref[:, 0] = 1e5, 0.002
    for past, stands in ((-0.005, True), (0.005, False)):
        angle = statue.lean_for(past)
        assert angle is not None
        held = statue.pose(angle)
        data = mujoco.MjData(model)
        data.qpos[:] = held
        mujoco.mj_step(model, data, 3000)
        tilt = 2 * np.arccos(min(abs(data.qpos[3:7] @ held[3:7]), 1.0))
        assert (tilt < 0.03) == stands


def test_the_floor_would_have_to_pull_as_told() -> None:
    fps = 500
    com = centre_of_mass(puppets.crouching(times(fps), 0.3), puppets.six_legs().model)
    lowest = (np.diff(com[:, 2], n=2) * fps**2).min()
    assert -lowest / 9.81 - 1 == pytest.approx(0.3, abs=0.15)
    # Short of what is told by the share of the feet, which stay.
    assert 0.1 < -lowest / 9.81 - 1 < 0.3


def test_friction_is_demanded_as_told() -> None:
    fps = 500
    com = centre_of_mass(puppets.swaying(times(fps), 1.2), puppets.six_legs().model)
    along = np.abs(np.diff(com[:, 0], n=2) * fps**2).max() / 9.81 / puppets.FRICTION
    assert along == pytest.approx(1.2, rel=0.12)


@pytest.mark.parametrize("name", [f.name for f in FAULTS])
def test_every_fault_changes_the_clip_more_the_larger_it_is_told(name: str) -> None:
    """Sizes go from mild to bad; the first place of each fault, at 60 frames/s."""
    place = next(fault(name).planted(), None)
    if place is None:
        pytest.skip("needs the robot data")
    clips = [place.clip(60, size) for size in fault(name).sizes[:3]]
    assert all(c is not None for c in clips)
    mild, _, bad = (c for c in clips if c is not None)
    assert mild.frames > 30
    changed = bad.frames != mild.frames or not np.array_equal(mild.qpos, bad.qpos)
    assert changed


def test_a_doubled_frame_is_the_one_before() -> None:
    place = planted("every n-th frame doubled", "six legs, walk")
    clip = place.clip(60, 5)
    assert clip is not None
    same = np.all(np.diff(clip.qpos, axis=0) == 0, axis=1)
    assert np.flatnonzero(same).tolist() == list(range(3, clip.frames - 1, 5))


def test_the_turn_of_a_heading_jump_is_about_the_root() -> None:
    place = planted("heading jumps", "lamp, acting")
    clip, clean = place.clip(60, 5), place.clean(60)
    assert clip is not None
    at = clip.frames // 2
    np.testing.assert_allclose(clip.qpos[at, :3], clean.qpos[at, :3], atol=1e-12)
    turned = 2 * np.degrees(np.arccos(abs(clip.qpos[at, 3:7] @ clean.qpos[at, 3:7])))
    assert turned == pytest.approx(5.0)


def test_the_crane_holds_its_bar_at_the_torque_told() -> None:
    place = next(fault("joint beyond its torque").planted())
    clip = place.clip(60, 2.0)
    assert clip is not None
    assert report_of(place, clip, None).measures["joint_torque_ratio_max"].value == pytest.approx(
        2.0, rel=1e-3
    )


def test_the_smallest_size_is_found_from_mild_to_bad() -> None:
    found = smallest(fault("joint beyond its torque"), planted("joint beyond its torque", "crane"),
                     60, None)  # fmt: skip
    assert found.by == ("DYN008",)
    assert found.clean == ()
    assert found.warned is not None
    assert found.erred is not None
    assert 1.0 < found.warned <= found.erred <= 3.0
