"""Planted faults of a clip that stands: found, mended, and the rest left as it was."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physretarget import kinematics
from physretarget.errors import InputError
from physretarget.wholebody import repair

CORNERS = np.array([[0.1, 0.08, 0.0], [0.1, -0.08, 0.0], [-0.1, 0.08, 0.0], [-0.1, -0.08, 0.0]])


def _corners(stalk, qpos):
    body = np.full(4, stalk.contacts.body[0])
    return kinematics.trajectories(stalk.tree, qpos, body, CORNERS)


@pytest.fixture
def swaying(standing):
    qpos, time, _ = standing(3.0)
    qpos[:, 7] = 0.05 * np.sin(2 * np.pi * 0.5 * time)
    return qpos, time


def _bump(time, size: float):
    return size * np.exp(-(((time - 1.5) / 0.4) ** 2))


@pytest.mark.parametrize(
    ("axis", "size"), [(2, 0.05), (2, -0.04), (0, 0.03)], ids=["float", "sink", "slide"]
)
def test_a_fault_goes_and_the_sway_stays(stalk, swaying, axis: int, size: float) -> None:
    sound, time = swaying
    faulty = sound.copy()
    faulty[:, axis] += _bump(time, size)
    found = repair(stalk, faulty, time)
    corners = _corners(stalk, found.qpos)
    assert np.abs(corners[..., 2]).max() < 3e-3
    assert np.ptp(corners[:, :, 0], axis=0).max() < 3e-3
    assert np.abs(found.qpos[:, 7] - sound[:, 7]).max() < 0.02
    assert found.slid_m < 0.05
    assert np.sqrt(np.mean(found.posed**2)) < 0.01


def test_a_sound_clip_keeps_its_pose(stalk, swaying) -> None:
    sound, time = swaying
    found = repair(stalk, sound, time)
    assert found.lifted == 0.0
    assert found.moved.max() < 1e-3


def test_a_clip_that_hovers_throughout_is_put_down_as_a_whole(stalk, swaying) -> None:
    sound, time = swaying
    hovering = sound.copy()
    hovering[:, 2] += 0.2
    found = repair(stalk, hovering, time)
    assert found.lifted == pytest.approx(-0.2, abs=1e-3)
    assert found.posed.max() < 1e-3


def test_a_lean_is_straightened(stalk, standing) -> None:
    qpos, time, _ = standing()
    qpos[:, 7] = np.radians(25)
    found = repair(stalk, qpos, time)
    assert found.unexplained_after.mean() < 0.2 * found.unexplained_before.mean()


def test_what_cannot_be_mended_is_refused(stalk, swaying) -> None:
    qpos, time = swaying
    with pytest.raises(InputError, match="at least 8"):
        repair(stalk, qpos[:5], time[:5])
    with pytest.raises(InputError, match="no free root"):
        repair(replace(stalk, has_root=False), qpos, time)
