"""Play a recorded simulation again: as it was, or from a disturbed start under its feedback."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

__all__ = ["follow", "model_of", "replay"]

Array = NDArray[np.float64]


def model_of(sim: Any, path: str | Path | None = None) -> mujoco.MjModel:
    """The model that a ``SIM.npz`` (as loaded by ``np.load``) was made with.

    `path` is the character's file, needed where the simulation was of the file itself.

    Args:
        sim: A ``SIM.npz`` as ``np.load`` gives it.
        path: The character's file, where the simulation was of the file itself.

    Returns:
        The compiled model with the simulation's options.
    """
    xml = str(sim["sim_model_xml"])
    text = mujoco.MjModel.from_xml_string
    model = text(xml) if xml else mujoco.MjModel.from_xml_path(str(path))
    for name, value in json.loads(str(sim["sim_options"])).items():
        setattr(model.opt, name, value)
    return model


def replay(sim: Any, model: mujoco.MjModel) -> Array:
    """(N+1, nq) poses from the recorded torques: on the same machine, those of the file.

    Args:
        sim: A ``SIM.npz`` as ``np.load`` gives it.
        model: Its model, from ``model_of``.

    Returns:
        (N + 1, nq) poses.
    """
    data, poses = mujoco.MjData(model), [sim["sim_qpos0"]]
    data.qpos[:], data.qvel[:] = sim["sim_qpos0"], sim["sim_qvel0"]
    for force in sim["sim_qfrc_applied"]:
        data.qfrc_applied[:] = force
        mujoco.mj_step(model, data)
        poses.append(data.qpos.copy())
    return np.array(poses)


def follow(sim: Any, model: mujoco.MjModel, qpos: Array, qvel: Array) -> Array:
    """(N+1, nq) poses from another start, the recorded gains leading back to the motion.

    Args:
        sim: A ``SIM.npz`` as ``np.load`` gives it.
        model: Its model, from ``model_of``.
        qpos: (nq,) pose to start from.
        qvel: (nv,) velocity to start with.

    Returns:
        (N + 1, nq) poses.
    """
    data, nv, wanted = mujoco.MjData(model), model.nv, sim["qpos"]
    data.qpos[:], data.qvel[:] = qpos, qvel
    controls, limit, step = sim["sim_controls"], sim["sim_torque_limit"], model.opt.timestep
    off, speed, poses = np.zeros(2 * nv), np.array(sim["sim_qvel0"]), [qpos]
    for k, force in enumerate(sim["sim_qfrc_applied"]):
        if k:
            mujoco.mj_differentiatePos(model, speed, step, wanted[k - 1], wanted[k])
        mujoco.mj_differentiatePos(model, off[:nv], 1.0, wanted[k], data.qpos)
        off[nv:] = data.qvel - speed
        at = np.searchsorted(sim["sim_gain_time"], k * step + 1e-9) - 1
        data.qfrc_applied[:] = force
        data.qfrc_applied[controls] += sim["sim_gain"][at] @ off
        data.qfrc_applied[:] = np.clip(data.qfrc_applied, -limit, limit)
        mujoco.mj_step(model, data)
        poses.append(data.qpos.copy())
    return np.array(poses)
