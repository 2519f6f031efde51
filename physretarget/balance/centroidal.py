"""How each degree of freedom moves the centre of mass and turns the whole about it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.kinematics.pose import screws
from physretarget.mjcf import Character

Array = NDArray[np.float64]


def centroidal(character: Character, qpos: Array, pose: kinematics.Pose) -> tuple[Array, Array]:
    """Centroidal momentum matrices (T, 6, nv) and centres of mass (T, 3) of poses (T, nq).

    Times a velocity they give linear momentum (kg m/s) and angular momentum about the centre of
    mass (kg m²/s), in world axes (Orin and Goswami 2008). Armatures have no momentum here.
    """
    tree, bodies, model = character.tree, character.bodies, character.model
    mass = np.array(model.body_mass)[bodies]
    at = kinematics.points(pose, bodies, np.array(model.body_ipos)[bodies])
    com = np.einsum("b,tbi->ti", mass, at) / mass.sum()
    arm = at - com[:, None]
    carried = tree.carries[np.ix_(tree.dof_body, bodies)].astype(np.float64)
    first = (carried * mass) @ arm  # (T, nv, 3)
    inertia = _inertia(character, pose, arm, mass).reshape(len(qpos), len(bodies), 9)
    second = (carried @ inertia).reshape(len(qpos), tree.nv, 3, 3)
    angular, anchor, linear = screws(tree, pose, qpos)
    linear = linear + np.cross(anchor - com[:, None], angular)  # velocity at the centre of mass
    momentum = (carried @ mass)[:, None] * linear + np.cross(angular, first)
    spin = np.cross(first, linear) + np.matmul(second, angular[..., None])[..., 0]
    matrix: Array = np.concatenate([momentum, spin], axis=-1).swapaxes(1, 2)
    return matrix, com


def _inertia(character: Character, pose: kinematics.Pose, arm: Array, mass: Array) -> Array:
    """(T, B, 3, 3) each body's inertia about the centre of mass of the whole, world axes."""
    model, bodies = character.model, character.bodies
    axes = pose.rotation[:, bodies] @ kinematics.quat_to_matrix(np.array(model.body_iquat)[bodies])
    own = (axes * np.array(model.body_inertia)[bodies][:, None, :]) @ np.swapaxes(axes, -1, -2)
    square = np.sum(arm * arm, axis=-1)[..., None, None] * np.eye(3)
    moved: Array = own + mass[:, None, None] * (square - arm[..., :, None] * arm[..., None, :])
    return moved
