from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physretarget import kinematics
from physretarget.balance import BalanceSettings, balance
from physretarget.balance.follow import DEEPEST, followed, raised
from physretarget.balance.hold import held
from physretarget.errors import InputError
from physretarget.ground.undersides import lowest_heights, solids
from physretarget.mjcf import derivatives, momentum


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
    result = balance(stalk, qpos, time, active, settings=BalanceSettings(limit=0.2))
    assert result.unexplained_before.min() > 0.05
    assert result.unexplained_after.mean() < 0.05 * result.unexplained_before.mean()
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
    assert np.all(result.qpos[:, 7] < qpos[:, 7] + 1e-3)  # nor is a fall caught at the ends


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
    whole, parts = (
        balance(stalk, qpos, time, active, settings=BalanceSettings(window=seconds))
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
    assert result.moved.max() <= 0.1 * stalk.height


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


def _depth(character, qpos):
    """(T,) how deep the lowest point of any geom is in the floor, m."""
    low = lowest_heights(solids(character), kinematics.forward(character.tree, qpos))
    return np.maximum(character.floor_height - low.min(axis=1), 0.0)


def test_what_is_too_deep_is_raised_smoothly(stalk, standing) -> None:
    qpos, time, _ = standing(1.0)
    qpos[:, 2] = -0.002
    sunk = qpos.copy()
    sunk[30, 2] = -0.015
    frames = np.arange(len(qpos))
    higher = raised(stalk, qpos, sunk, frames, time[1])
    assert _depth(stalk, higher).max() <= DEEPEST + 1e-12
    rise = higher[:, 2] - sunk[:, 2]
    assert np.abs(np.diff(rise)).max() < 0.2 * rise.max()
    assert np.array_equal(higher[:20], sunk[:20])
    assert np.array_equal(higher[:, :2], sunk[:, :2])


def test_what_was_deep_already_stays_where_it_was(stalk, standing) -> None:
    qpos, time, _ = standing(0.5)
    qpos[:, 2] = -0.02
    frames = np.arange(len(qpos))
    assert np.array_equal(raised(stalk, qpos, qpos, frames, time[1]), qpos)


def test_an_idle_foot_is_not_held_in_the_floor(stalk) -> None:
    """Contact points near the floor are held firmly, also while they do not stand: not below it."""
    qpos = np.zeros((8, 9))
    qpos[:, 3] = 1.0
    wanted = qpos.copy()
    wanted[:, 2] = -0.02
    hold = held(stalk, qpos, np.zeros((8, 4), bool), 1 / 60, BalanceSettings())
    found = followed(stalk, qpos, wanted, hold, np.arange(8), BalanceSettings())
    assert _depth(stalk, found).max() <= DEEPEST + 1e-4
