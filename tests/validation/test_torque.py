"""What contact forces do to joints."""

from __future__ import annotations

import mujoco
import numpy as np

from physretarget import kinematics
from physretarget.clip import Clip
from physretarget.ground.contacts import find_contacts
from physretarget.ground.support import find_support
from physretarget.ground.undersides import undersides
from physretarget.mjcf import Character
from physretarget.validation.torque import contact_torque


def test_contact_torque_is_the_transposed_jacobian(biped: Character, hop: Clip) -> None:
    qpos = hop.qpos[:40:8]
    pose = kinematics.forward(biped.tree, qpos)
    com = np.random.default_rng(1).normal(size=(len(qpos), 3))
    near = find_contacts(undersides(biped), pose, 0.0, 0.02)
    touch = find_support(near, com, np.zeros((*near.mask.shape, 2)), slice(0, len(qpos)), 0)
    rng = np.random.default_rng(0)
    force = rng.normal(size=touch.position.shape) * touch.mask[..., None]
    ours = contact_torque(biped, pose, touch, force, com)
    data = mujoco.MjData(biped.model)
    for t in range(len(qpos)):
        data.qpos[:] = qpos[t]
        mujoco.mj_kinematics(biped.model, data)
        mujoco.mj_comPos(biped.model, data)
        expected = np.zeros(biped.model.nv)
        for k in range(touch.mask.shape[1]):
            jacobian = np.zeros((3, biped.model.nv))
            body = int(touch.body[t, k])
            mujoco.mj_jac(biped.model, data, jacobian, None, touch.position[t, k], body)
            expected += jacobian.T @ force[t, k]
        np.testing.assert_allclose(ours[t, 6:], expected[6:], atol=1e-9)
