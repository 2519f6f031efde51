"""The wrench from the momentum of the samples is that of MuJoCo's inverse dynamics."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from physretarget import kinematics
from physretarget.demo import models_folder
from physretarget.ground.wrench import external_wrench
from physretarget.mjcf import Character, derivatives, required_wrench


def _wave(character: Character, fps: float) -> tuple[np.ndarray, np.ndarray]:
    """Joints and root that swing at 0.5 to 1 Hz: qpos (T, nq) and time (T,)."""
    rng = np.random.default_rng(4)
    time = np.arange(round(1.0 * fps)) / fps
    rate, phase = rng.uniform(3.0, 6.0, character.model.nv), rng.uniform(0, 6.0, character.model.nv)
    size = np.full(character.model.nv, 0.25)
    size[character.root_dof : character.root_dof + 3] = 0.03
    qpos = np.repeat(character.reference_qpos[None], len(time), axis=0)
    for t, now in enumerate(time):
        mujoco.mj_integratePos(character.model, qpos[t], size * np.sin(rate * now + phase), 1.0)
    return qpos, time


@pytest.mark.parametrize("name", ["lamp", "penguin", "squirrel"])
def test_momentum_and_inverse_dynamics_agree_on_smooth_motion(name: str) -> None:
    character = Character.load(models_folder() / f"{name}.xml")
    fps = 480.0
    qpos, time = _wave(character, fps)
    found = external_wrench(character, kinematics.forward(character.tree, qpos), 1 / fps)
    qvel, qacc = derivatives(character, qpos, time)
    wanted = required_wrench(character, qpos, qvel, qacc)
    force = wanted.force / character.weight
    arm = wanted.root - wanted.com
    moment = (wanted.moment / character.weight + np.cross(arm, force)) / character.com_height
    inner = slice(2, -2)
    assert np.ptp(force[inner], axis=0).max() > 0.05, "something moves"
    assert np.abs(found.force - force)[inner].max() < 0.002
    assert np.abs(found.moment - moment)[inner].max() < 0.002
    assert np.abs(found.com - wanted.com)[inner].max() < 1e-9


def test_a_fall_needs_nothing_and_a_throw_keeps_its_spin() -> None:
    character = Character.load(models_folder() / "lamp.xml")
    fps, frames = 120.0, 40
    time = np.arange(frames) / fps
    qpos = np.repeat(character.reference_qpos[None], frames, axis=0)
    qpos[:, character.root_qpos + 2] += 3.0 - 0.5 * 9.81 * time**2
    gravity = float(np.linalg.norm(character.model.opt.gravity))
    qpos[:, character.root_qpos + 2] += 0.5 * (9.81 - gravity) * time**2
    pose = kinematics.forward(character.tree, qpos)
    found = external_wrench(character, pose, 1 / fps)
    assert np.abs(found.force).max() < 1e-8
    assert np.abs(found.moment).max() < 1e-8
