from __future__ import annotations

import numpy as np
import pytest

from physretarget import kinematics
from physretarget.balance.centroidal import centroidal
from physretarget.demo import models_folder
from physretarget.mjcf import Character, momentum


@pytest.mark.parametrize("name", ["lamp", "penguin", "squirrel"])
def test_centroidal_momentum_is_that_of_mujoco(name: str) -> None:
    character = Character.load(models_folder() / f"{name}.xml")
    rng = np.random.default_rng(0)
    start = np.tile(character.reference_qpos, (5, 1))
    qpos = kinematics.integrate(character.tree, start, rng.normal(0, 0.3, (5, character.tree.nv)))
    qvel = rng.normal(size=(5, character.tree.nv))
    matrix, com = centroidal(character, qpos, kinematics.forward(character.tree, qpos))
    found = np.einsum("tij,tj->ti", matrix, qvel)
    twin = momentum(character, qpos, qvel)
    assert com == pytest.approx(twin.com, abs=1e-12)
    assert found[:, :3] == pytest.approx(twin.linear, abs=1e-10)
    assert found[:, 3:] == pytest.approx(twin.angular, abs=1e-10)


def test_stiffness_is_that_of_the_jacobian() -> None:
    character = Character.load(models_folder() / "lamp.xml")
    rng = np.random.default_rng(1)
    tree, markers = character.tree, character.markers
    qpos = np.tile(character.reference_qpos, (3, 1))
    qpos = kinematics.integrate(tree, qpos, rng.normal(0, 0.3, (3, tree.nv)))
    pose = kinematics.forward(tree, qpos)
    weight = rng.uniform(0.1, 2.0, (3, len(markers)))
    slope = kinematics.jacobian(tree, pose, qpos, markers.body, markers.local)
    twin = np.swapaxes(slope, 1, 2) @ (np.repeat(weight, 3, axis=1)[..., None] * slope)
    found = kinematics.stiffness(tree, qpos, pose, markers.body, markers.local, weight)
    assert found == pytest.approx(twin, abs=1e-10)
