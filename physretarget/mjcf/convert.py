"""From a compiled MuJoCo model to the plain tree that the batched kinematics work on."""

from __future__ import annotations

import mujoco
import numpy as np

from physretarget.kinematics import Joint, Tree
from physretarget.kinematics.tree import JointKind

__all__ = ["tree_of"]

_KINDS: dict[int, JointKind] = {
    mujoco.mjtJoint.mjJNT_FREE: "free",
    mujoco.mjtJoint.mjJNT_BALL: "ball",
    mujoco.mjtJoint.mjJNT_HINGE: "hinge",
    mujoco.mjtJoint.mjJNT_SLIDE: "slide",
}


def tree_of(model: mujoco.MjModel) -> Tree:
    """The kinematic tree of `model`: same bodies, same order, same qpos layout.

    Its forward kinematics equal ``mj_kinematics``; equality constraints are no part of it.
    """
    joints = []
    for i in range(model.njnt):
        kind = _KINDS[int(model.jnt_type[i])]
        at = int(model.jnt_qposadr[i])
        turning_freely = kind in ("free", "ball")
        joints.append(
            Joint(
                kind=kind,
                body=int(model.jnt_bodyid[i]),
                qpos=at,
                dof=int(model.jnt_dofadr[i]),
                axis=np.array(model.jnt_axis[i]),
                # MuJoCo ignores the position of a free joint.
                anchor=np.zeros(3) if kind == "free" else np.array(model.jnt_pos[i]),
                reference=0.0 if turning_freely else float(model.qpos0[at]),
            )
        )
    return Tree(
        parent=model.body_parentid.astype(np.int64),
        offset=np.array(model.body_pos),
        rotation=np.array(model.body_quat),
        joints=tuple(joints),
    )
