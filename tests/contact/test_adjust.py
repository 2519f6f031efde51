from __future__ import annotations

import mujoco
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from physretarget import kinematics
from physretarget.contact import Contacted, ContactSettings, Phases, adjust
from physretarget.contact.clearance import surface_points
from physretarget.errors import InputError
from physretarget.mjcf import Character

NAMES = ("left_heel", "left_toe", "right_heel", "right_toe")
FPS = 60.0


def placed(character: Character, frames: int, *, speed: float = 0.3, wobble: float = 0.0):
    """The reference pose moving ahead, its root shaking by ``wobble``."""
    time = np.arange(frames) / FPS
    qpos = np.tile(character.reference_qpos, (frames, 1))
    qpos[:, 0] += speed * time
    qpos[:, 2] += wobble * np.sin(9.0 * time)
    shake = wobble * np.stack([np.sin(7 * time), np.cos(5 * time), np.sin(3 * time)], axis=1)
    qpos[:, 3:7] = kinematics.quat_multiply(kinematics.rotvec_to_quat(2.0 * shake), qpos[:, 3:7])
    return time, qpos


def contact_points(character: Character, qpos: np.ndarray) -> np.ndarray:
    pose = kinematics.forward(character.tree, qpos)
    return kinematics.points(pose, character.contacts.body, character.contacts.local)


def column(character: Character, name: str) -> int:
    return character.tied.index(name)


def assert_planted(character: Character, result: Contacted) -> None:
    """The judged requirement, measured here anew: < 2 mm along the floor, < 5 mm into it."""
    points = contact_points(character, result.qpos)
    for stance in result.stances:
        part = slice(stance.first, stance.last + 1)
        for k in range(points.shape[1]):
            on = result.active[part, k]
            body = character.model.body(int(character.contacts.body[k])).name
            if body == stance.body and on.any():
                held = points[part, k][on]
                assert np.linalg.norm(np.ptp(held[:, :2], axis=0)) < 0.002
                assert held[:, 2].min() > -0.005
                assert held[:, 2].max() < 0.005
    inside = np.zeros(len(points), dtype=bool)
    for stance in result.stances:
        inside[stance.first : stance.last + 1] = True
    assert not result.active[~inside].any()
    assert result.slide_max_m < 0.002
    assert result.sink_max_m < 0.005


def assert_smooth(result: Contacted, limit: float) -> None:
    speed = np.linalg.norm(np.diff(result.qpos[:, :3], axis=0), axis=1) * FPS
    assert speed.max() < limit
    turn = kinematics.quat_multiply(
        kinematics.quat_conjugate(result.qpos[:-1, 3:7]), result.qpos[1:, 3:7]
    )
    assert np.linalg.norm(kinematics.quat_to_rotvec(turn), axis=1).max() * FPS < 15.0


def test_a_walk_becomes_a_waddle(box, walk):
    time, active = walk
    _, qpos = placed(box, len(time), wobble=0.03)
    result = adjust(box, qpos, time, Phases(NAMES, active, time))
    assert_planted(box, result)
    assert_smooth(result, 3.0)
    points = contact_points(box, result.qpos)
    assert points[..., 2].min() > -1e-4, "nothing sinks, in flight neither"
    left = [column(box, n) for n in NAMES[:2]]
    right = [column(box, n) for n in NAMES[2:]]
    on_left = result.active[:, left].all(axis=1) & ~result.active[:, right].any(axis=1)
    on_right = result.active[:, right].all(axis=1) & ~result.active[:, left].any(axis=1)
    assert on_left.sum() > 30
    assert on_right.sum() > 30
    # It is the side of the planted foot that stays down; the other one is lifted visibly.
    assert points[on_left][:, right, 2].max() > 0.005
    assert points[on_right][:, left, 2].max() > 0.005
    # Between the sides it flies, and it arrives where the motion was meant to go.
    hops = [s for s in result.stances if s.hop]
    assert len(hops) >= 4
    assert result.qpos[-1, 0] == pytest.approx(qpos[-1, 0], abs=0.15)


def test_hops_take_their_time(box, walk):
    time, active = walk
    _, qpos = placed(box, len(time))
    result = adjust(box, qpos, time, Phases(NAMES, active, time))
    flights = [b.start - a.end for a, b in zip(result.stances, result.stances[1:], strict=False)]
    assert min(flights) >= ContactSettings().min_flight - 1e-9
    low = contact_points(box, result.qpos)[..., 2].min(axis=1)
    for a, b in zip(result.stances, result.stances[1:], strict=False):
        assert low[a.last + 1 : b.first].max() > 0.01


def test_a_jump_is_a_hop_of_both_sides(box):
    time, qpos = placed(box, 120, speed=0.5)
    active = np.ones((120, 4), dtype=bool)
    active[50:74] = False
    result = adjust(box, qpos, time, Phases(NAMES, active, time))
    assert_planted(box, result)
    assert len(result.stances) == 2
    assert not any(s.hop for s in result.stances)
    assert result.active[:50].all()
    assert not result.active[50:74].any()
    assert result.active[74:].all()
    low = contact_points(box, result.qpos)[..., 2].min(axis=1)
    ballistic = 9.81 * (25 / FPS) ** 2 / 8
    highest = min(ballistic, ContactSettings().hop_height * box.height)
    assert low.max() == pytest.approx(highest, rel=0.15)


def test_standing_and_shifting_weight_stays_put(box):
    time, qpos = placed(box, 300, speed=0.01, wobble=0.01)
    active = np.ones((300, 4), dtype=bool)
    active[60:100, 2:] = False
    active[150:190, :2] = False
    result = adjust(box, qpos, time, Phases(NAMES, active, time))
    assert_planted(box, result)
    assert len(result.stances) == 1
    points = contact_points(box, result.qpos)
    right, left = column(box, "right_toe"), column(box, "left_toe")
    assert points[80, right, 2] > 0.004
    assert points[80, left, 2] < 1e-4
    assert points[170, left, 2] > 0.004
    assert points[170, right, 2] < 1e-4
    assert result.active[:40].all()


def test_without_waddle_the_mapped_roll_decides(box):
    time, qpos = placed(box, 100, speed=0.0)
    active = np.ones((100, 4), dtype=bool)
    active[30:70, 2:] = False  # the right foot is up
    flat = ContactSettings(waddle=0.0)
    right, left = column(box, "right_toe"), column(box, "left_toe")
    # A roll that would lift the left, planted side is impossible; the other way is allowed.
    for roll, lifted in ((0.1, 0.0), (-0.1, 0.16 * np.sin(0.1))):
        qpos[:, 3:7] = kinematics.rotvec_to_quat(np.tile([roll, 0.0, 0.0], (100, 1)))
        result = adjust(box, qpos, time, Phases(NAMES, active, time), settings=flat)
        assert_planted(box, result)
        points = contact_points(box, result.qpos)
        assert points[50, right, 2] == pytest.approx(lifted, abs=1e-6)
        assert np.abs(points[:, left, 2]).max() < 1e-6
        assert np.abs(points[:20, :, 2]).max() < 1e-6


def test_drift_in_a_long_stance_moves_to_the_flights(box):
    time, qpos = placed(box, 240, speed=0.2)
    active = np.ones((240, 4), dtype=bool)
    active[110:130] = False
    result = adjust(box, qpos, time, Phases(NAMES, active, time))
    assert_planted(box, result)
    first, second = result.stances
    middle = 0.5 * (time[second.first] + time[second.last] - time[first.first] - time[first.last])
    assert np.linalg.norm(second.position - first.position) == pytest.approx(0.2 * middle, rel=0.01)


def test_the_pose_is_carried_along(box, walk):
    time, active = walk
    _, qpos = placed(box, len(time), wobble=0.02)
    qpos[:, 7:] = 0.5 * np.sin(4 * time)[:, None]
    stiff = ContactSettings(lean=0.0)
    result = adjust(box, qpos, time, Phases(NAMES, active, time), settings=stiff)
    np.testing.assert_allclose(result.qpos[:, 7:], qpos[:, 7:], atol=1e-12)


def test_two_legs_keep_their_feet_and_walk(legs, walk):
    time, active = walk
    _, qpos = placed(legs, len(time), speed=0.15, wobble=0.01)
    qpos[:, 8] += 0.2 * np.sin(2 * np.pi * time)
    qpos[:, 14] -= 0.2 * np.sin(2 * np.pi * time)
    result = adjust(legs, qpos, time, Phases(NAMES, active, time))
    assert_planted(legs, result)
    assert_smooth(result, 2.0)
    timetable = np.stack([active[:, NAMES.index(str(t))] for t in legs.tied], axis=1)
    assert (result.active >= timetable)[10:-10].mean() > 0.99, "each foot stands when it should"
    assert contact_points(legs, result.qpos)[..., 2].min() > -0.005
    rise = np.abs(result.qpos[:, 2] - qpos[:, 2]).max()
    assert rise < 0.1 * legs.height
    assert (result.qpos >= legs.lower - 1e-9).all()
    assert (result.qpos <= legs.upper + 1e-9).all()


def test_untied_points_and_empty_timetables(box):
    time, qpos = placed(box, 30)
    nothing = adjust(box, qpos, time, Phases(NAMES, np.zeros((30, 4), bool), time))
    np.testing.assert_array_equal(nothing.qpos, qpos)
    assert not nothing.active.any()
    assert np.isnan(nothing.target).all()
    assert nothing.notes
    hands = adjust(box, qpos, time, Phases(("left_hand",), np.ones((30, 1), bool), time))
    np.testing.assert_array_equal(hands.qpos, qpos)


def test_what_does_not_fit_is_refused(box):
    time, qpos = placed(box, 30)
    with pytest.raises(InputError, match="30 frames"):
        adjust(box, qpos, time, Phases(NAMES, np.ones((29, 4), bool), time[:29]))
    qpos[7, 2] = np.nan
    with pytest.raises(InputError, match="frame 7"):
        adjust(box, qpos, time, Phases(NAMES, np.ones((30, 4), bool), time))


def test_same_input_same_output(legs, walk):
    time, active = walk
    _, qpos = placed(legs, len(time), wobble=0.01)
    phases = Phases(NAMES, active, time)
    first, second = adjust(legs, qpos, time, phases), adjust(legs, qpos, time, phases)
    assert first.qpos.tobytes() == second.qpos.tobytes()


@st.composite
def timetables(draw: st.DrawFn) -> np.ndarray:
    active = np.zeros((90, 4), dtype=bool)
    for _ in range(draw(st.integers(0, 10))):
        point, start = draw(st.integers(0, 3)), draw(st.integers(0, 89))
        active[start : start + draw(st.integers(1, 60)), point] = True
    return active


@settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.too_slow])
@given(active=timetables(), speed=st.floats(-1, 1), wobble=st.floats(0, 0.1))
def test_any_timetable_plants_what_it_says(box, active, speed, wobble):
    time, qpos = placed(box, 90, speed=speed, wobble=wobble)
    result = adjust(box, qpos, time, Phases(NAMES, active, time))
    assert np.isfinite(result.qpos).all()
    np.testing.assert_allclose(np.linalg.norm(result.qpos[:, 3:7], axis=1), 1.0, atol=1e-9)
    assert_planted(box, result)
    if result.stances:
        assert contact_points(box, result.qpos)[..., 2].min() > -1e-3
        speed_limit = ContactSettings().max_speed * np.sqrt(9.81 * box.height)
        assert_smooth(result, 2.0 * speed_limit)


def lowest(character: Character, qpos: np.ndarray) -> float:
    """Lowest point of the geometry of arm and head over a clip, by MuJoCo's contacts."""
    data = mujoco.MjData(character.model)
    deepest = 0.0
    for pose in qpos:
        data.qpos[:] = pose
        mujoco.mj_forward(character.model, data)
        for contact in data.contact[: data.ncon]:
            bodies = character.model.geom_bodyid[[contact.geom1, contact.geom2]]
            if bodies.min() == 0 and bodies.max() > character.root_body:
                deepest = min(deepest, float(contact.dist))
    return deepest


def test_what_the_base_carries_stays_above_the_floor(box):
    time, qpos = placed(box, 60, speed=0.0)
    qpos[:, 2] += 0.3
    qpos[:, 7] = 1.2 + 0.35 * np.sin(4 * time)
    qpos[:, 8] = 0.8 + 0.2 * np.cos(5 * time)
    active = np.ones((60, 4), dtype=bool)
    sunk = qpos.copy()
    sunk[:, 2] -= 0.3
    assert lowest(box, sunk) < -0.05
    result = adjust(box, qpos, time, Phases(NAMES, active, time))
    assert lowest(box, result.qpos) > -0.005
    assert_planted(box, result)
    assert np.abs(np.diff(result.qpos[:, 7:], axis=0)).max() * FPS < 6.0


def test_points_that_span_a_body(box):
    bodies, local = surface_points(box, np.array([2, 3]))
    assert set(bodies) == {2, 3}
    arm = local[bodies == 2]
    np.testing.assert_allclose(arm.min(axis=0), [-0.02, -0.02, -0.02], atol=2e-3)
    np.testing.assert_allclose(arm.max(axis=0), [0.02, 0.02, 0.22], atol=2e-3)


def test_nothing_pushes_a_flying_body_sideways(box):
    time, qpos = placed(box, 90, speed=0.6)
    qpos[:, 7] = 0.6 * np.sin(8 * time)
    qpos[:, 3:7] = kinematics.rotvec_to_quat(np.outer(3.0 * time, [0.0, 0.0, 1.0]))
    active = np.ones((90, 4), dtype=bool)
    active[40:60] = False
    result = adjust(box, qpos, time, Phases(NAMES, active, time))
    assert_planted(box, result)
    data = mujoco.MjData(box.model)
    centre = []
    for pose in result.qpos:
        data.qpos[:] = pose
        mujoco.mj_kinematics(box.model, data)
        mujoco.mj_comPos(box.model, data)
        centre.append(data.subtree_com[box.root_body, :2].copy())
    acceleration = np.diff(np.array(centre), 2, axis=0)[40:58] * FPS**2
    assert np.abs(acceleration).max() < 1e-6


def test_feet_that_land_one_after_the_other_are_thrown_together(legs):
    time, qpos = placed(legs, 120, speed=0.2)
    active = np.ones((120, 4), dtype=bool)
    active[48:72, :2] = False
    active[46:75, 2:] = False  # the right foot leaves first and lands last
    result = adjust(legs, qpos, time, Phases(NAMES, active, time))
    assert_planted(legs, result)
    points = contact_points(legs, result.qpos)
    left = points[:, [column(legs, n) for n in NAMES[:2]], 2].mean(axis=1)
    right = points[:, [column(legs, n) for n in NAMES[2:]], 2].mean(axis=1)
    assert left[50:70].max() > 0.1
    assert np.abs(left - right)[50:70].max() < 0.02
    assert np.abs(np.diff(result.qpos[:, 7:], axis=0)).max() * FPS < 8.0
