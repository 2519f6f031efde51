from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physretarget import kinematics
from physretarget.errors import InputError
from physretarget.mjcf import derivatives, momentum
from physretarget.wholebody import WholeBodySettings, balance


def _contacts(character, qpos):
    pose = kinematics.forward(character.tree, qpos)
    return kinematics.points(pose, character.contacts.body, character.contacts.local)


def test_a_feasible_clip_stays_to_the_last_bit(stalk, standing) -> None:
    qpos, time, active = standing()
    qpos[:, 7] = 0.05 * np.sin(2 * np.pi * time)
    result = balance(stalk, qpos, time, active)
    assert np.array_equal(result.qpos, qpos)
    assert result.unexplained_after.max() <= 0.01


def test_a_leaning_box_is_led_over_its_support(stalk, standing) -> None:
    """Leaning at 30 degrees the centre of mass is beyond the edge; the foot stays."""
    qpos, time, active = standing()
    qpos[:, 7] = np.radians(30)
    result = balance(stalk, qpos, time, active, settings=WholeBodySettings(most=0.3))
    assert result.unexplained_before.min() > 0.05
    assert result.unexplained_after.mean() < 0.1 * result.unexplained_before.mean()
    pose = kinematics.forward(stalk.tree, result.qpos)
    bodies, mass = stalk.bodies, stalk.model.body_mass[stalk.bodies]
    centre = np.einsum(
        "b,tbi->ti",
        mass / mass.sum(),
        kinematics.points(pose, bodies, stalk.model.body_ipos[bodies]),
    )
    assert centre[40:-40, 0].max() <= 0.102
    assert centre[:, 0].min() > 0.05  # no farther back than needed
    assert np.abs(_contacts(stalk, result.qpos) - _contacts(stalk, qpos)).max() < 1e-3
    # Nor is a fall caught at the ends: beyond them nobody has to.
    assert np.all(result.qpos[:, 7] < qpos[:, 7] + np.radians(6))


def test_what_is_far_from_trouble_stays(stalk, standing) -> None:
    qpos, time, active = standing(12.0)
    qpos[:, 7] = np.radians(25) * np.exp(-(((time - 3.0) / 0.6) ** 2))
    result = balance(stalk, qpos, time, active)
    assert result.unexplained_after.max() < 0.5 * result.unexplained_before.max()
    assert np.array_equal(result.qpos[time > 8.0], qpos[time > 8.0])


def test_momentum_is_kept_in_flight(stalk) -> None:
    """A stalk that swings up in the air turns its foot the other way, and falls as it must."""
    time = np.arange(60) / 60
    flight = (time > 0.3) & (time < 0.6)
    qpos = np.zeros((60, 9))
    qpos[:, 3] = 1.0
    since = np.clip(time - 0.3, 0.0, 0.3)
    qpos[:, 2] = 0.5 * 9.81 * since * (0.3 - since)
    qpos[:, 7] = 0.1 * np.sin(np.pi * np.clip((time - 0.3) / 0.3, 0, 1)) ** 2
    active = np.tile(~flight[:, None], (1, 4))
    result = balance(stalk, qpos, time, active)
    inside = np.flatnonzero(flight)[4:-4]

    def torque(poses):
        spin = momentum(stalk, poses, derivatives(stalk, poses, time)[0]).angular
        return np.gradient(spin, time, axis=0)[inside] / (stalk.weight * stalk.com_height)

    assert np.abs(torque(qpos)).max() > 0.1
    assert np.abs(torque(result.qpos)).max() < 0.25 * np.abs(torque(qpos)).max()
    assert result.unexplained_after[inside].mean() < 0.2 * result.unexplained_before[inside].mean()


def test_windows_give_what_the_whole_gives(stalk, standing) -> None:
    qpos, time, active = standing(12.0, 30.0)
    qpos[:, 7] = np.radians(20) * np.sin(2 * np.pi * 0.3 * time)
    qpos[:, 8] = np.radians(18) * np.sin(2 * np.pi * 0.23 * time)
    thorough = WholeBodySettings(iterations=60, tolerance=1e-7)
    whole, parts = (
        balance(stalk, qpos, time, active, settings=replace(thorough, window=seconds))
        for seconds in (60.0, 3.0)
    )
    assert not np.array_equal(whole.qpos, qpos)
    assert parts.qpos == pytest.approx(whole.qpos, abs=5e-4)


def test_limits_of_joints_are_kept(stalk, standing) -> None:
    qpos, time, active = standing()
    qpos[:, 7] = np.radians(79)
    result = balance(stalk, qpos, time, active)
    at = stalk.tree.scalars[0]
    assert np.all(result.qpos[:, at] <= stalk.upper[at] + 1e-9)
    assert np.all(result.qpos[:, at] >= stalk.lower[at] - 1e-9)
    assert result.moved.max() <= 0.13 * stalk.height


def test_same_clip_same_bytes(stalk, standing) -> None:
    qpos, time, active = standing(1.0)
    qpos[:, 7] = np.radians(25)
    first, second = (balance(stalk, qpos, time, active).qpos for _ in range(2))
    assert first.tobytes() == second.tobytes()


def test_too_short_a_clip_is_left(stalk, standing) -> None:
    qpos, time, active = (each[:4] for each in standing())
    assert balance(stalk, qpos, time, active).qpos is qpos


def test_what_does_not_fit_is_refused(stalk, standing) -> None:
    qpos, time, active = standing()
    with pytest.raises(InputError, match="contact phases have shape"):
        balance(stalk, qpos, time, active[:, :2])
    with pytest.raises(InputError, match="no free root"):
        balance(replace(stalk, has_root=False), qpos, time, active)
