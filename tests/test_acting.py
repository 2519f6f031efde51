from __future__ import annotations

import numpy as np
import pytest

from physretarget.acting import ActingBudget, hop_height, measure_acting, over_budget
from physretarget.mjcf import Character

XML = """<mujoco model="nod"><worldbody><geom type="plane" size="5 5 .1"/>
<body name="base" pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1"/>
<site name="marker_base" pos="0 0 .1"/>
<body name="head" pos="0 0 .3"><joint name="nod" axis="0 1 0"/><geom size=".1"/>
<site name="eye"/><site name="marker_head" pos=".1 0 0"/></body></body></worldbody>
<custom><text name="face" data="eye"/></custom></mujoco>"""
RATE = 50.0


@pytest.fixture(scope="module")
def nod() -> Character:
    return Character.from_xml(XML)


def _clip(angle):
    qpos = np.zeros((len(angle), 8))
    qpos[:, 2], qpos[:, 3], qpos[:, 7] = 0.1, 1.0, angle
    return qpos


def test_a_whipped_head_and_a_late_one_are_seen(nod) -> None:
    time = np.arange(100) / RATE
    wave = np.exp(-(((time - 1.0) / 0.1) ** 2))
    late = np.exp(-(((time - 1.08) / 0.1) ** 2))
    whipped = 0.3 * wave
    whipped[30] += np.radians(20)
    stages = {
        "placed": _clip(0.3 * wave),
        "contacted": _clip(0.3 * wave),
        "physical": _clip(0.3 * late),
        "balanced": _clip(whipped),
    }
    placed, contacted, physical, balanced = measure_acting(nod, stages, time)
    assert placed.since is None
    assert placed.moved is None
    assert contacted.moved == contacted.gaze_error_deg == contacted.lag_s == 0.0
    assert physical.lag_s == pytest.approx(0.08)
    assert balanced.gaze_speed_deg_s == pytest.approx(20 * RATE, rel=0.01)
    assert balanced.joint_step_rad == pytest.approx(np.radians(20), rel=0.01)
    assert balanced.gaze_error_deg == pytest.approx(20 / 10, rel=0.01)  # one frame of a hundred
    said = over_budget((placed, contacted, physical, balanced))
    assert any("turns the head" in each for each in said)
    assert not over_budget((placed, contacted))


def test_a_moved_pose_is_said_beyond_its_budget_alone(nod) -> None:
    time = np.arange(20) / RATE
    lifted = _clip(np.zeros(20))
    lifted[:, 0] += 0.1 * nod.height
    acting = measure_acting(nod, {"contacted": _clip(np.zeros(20)), "balanced": lifted}, time)
    assert acting[1].moved == pytest.approx(0.1)
    assert any("moves the pose by 10.0%" in each for each in over_budget(acting))
    assert not over_budget(acting, ActingBudget(moved=0.11))


def test_the_hop_is_how_high_the_lowest_point_comes(nod) -> None:
    qpos = _clip(np.zeros(30))
    qpos[10:20, 2] += 0.25
    assert hop_height(nod, qpos) == pytest.approx(0.25)
