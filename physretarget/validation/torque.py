"""What joints must deliver, against what their motors can."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from physretarget.ground.support import Support
from physretarget.kinematics import Pose
from physretarget.mjcf import Character

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TorqueLimits:
    """Lower and upper force of every degree of freedom (nv,), infinite where not limited.

    ``actfrcrange`` of the joint, else the sum over its actuators of forcerange, or of
    ctrlrange times gain for a plain motor, times gear.
    """

    lower: Floats
    upper: Floats

    @property
    def any(self) -> bool:
        """Whether any degree of freedom is limited."""
        return bool(np.isfinite(self.upper).any())

    @classmethod
    def build(cls, character: Character) -> TorqueLimits:
        """Read the limits of a model."""
        model = character.model
        lower, upper = np.full(model.nv, -np.inf), np.full(model.nv, np.inf)
        scalar = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
        motors = _actuator_ranges(model)
        for joint in range(model.njnt):
            if int(model.jnt_type[joint]) not in scalar:
                continue
            dof = model.jnt_dofadr[joint]
            if model.jnt_actfrclimited[joint]:
                lower[dof], upper[dof] = model.jnt_actfrcrange[joint]
            elif joint in motors:
                lower[dof], upper[dof] = motors[joint]
        # A range without room on one side would divide by zero: nothing can be said there.
        open_ended = ~((lower < 0) & (upper > 0))
        lower[open_ended], upper[open_ended] = -np.inf, np.inf
        return cls(lower, upper)


def _actuator_ranges(model: mujoco.MjModel) -> dict[int, tuple[float, float]]:
    ranges: dict[int, tuple[float, float]] = {}
    kinds = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
    for actuator in range(model.nu):
        if int(model.actuator_trntype[actuator]) not in kinds:
            continue
        joint = int(model.actuator_trnid[actuator, 0])
        gear = float(model.actuator_gear[actuator, 0])
        if model.actuator_forcelimited[actuator]:
            ends = model.actuator_forcerange[actuator] * gear
        elif model.actuator_ctrllimited[actuator] and _is_motor(model, actuator):
            gain = float(model.actuator_gainprm[actuator, 0])
            ends = model.actuator_ctrlrange[actuator] * gain * gear
        else:
            continue
        low, high = ranges.get(joint, (0.0, 0.0))
        ranges[joint] = (low + float(min(ends)), high + float(max(ends)))
    return ranges


def _is_motor(model: mujoco.MjModel, actuator: int) -> bool:
    fixed = model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_FIXED
    plain = model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_NONE
    return bool(fixed and plain)


def contact_torque(
    character: Character, pose: Pose, support: Support, force: Floats, com: Floats
) -> Floats:
    """(T, nv) generalised force of contact forces (T, n, 3) N: J^T f without any Jacobian.

    Forces are gathered from the leaves to the root; every joint then feels what its subtree
    bears (the root's free joint is left at zero: there the wrench is judged as a whole).
    """
    tree, frames = character.tree, len(force)
    total = np.zeros((frames, tree.nb, 6))
    bearing = [int(b) for b in support.bodies]
    place = com[:, None] + support.arm
    for body in bearing:
        own = np.where((support.mask & (support.body == body))[..., None], force, 0.0)
        total[:, body, :3] = own.sum(axis=1)
        total[:, body, 3:] = np.cross(place, own).sum(axis=1)
    loaded = np.asarray(np.any(tree.carries[:, bearing], axis=1), dtype=np.bool_)
    for body in range(tree.nb - 1, 0, -1):
        if loaded[body]:
            total[:, tree.parent[body]] += total[:, body]
    torque = np.zeros((frames, tree.nv))
    for joint in tree.joints:
        if joint.kind == "free" or not loaded[joint.body]:
            continue
        turn = pose.rotation[:, joint.body]
        f, m = total[:, joint.body, :3], total[:, joint.body, 3:]
        about = m - np.cross(pose.position[:, joint.body] + turn @ joint.anchor, f)
        if joint.kind == "ball":
            torque[:, joint.dof : joint.dof + 3] = np.einsum("tji,tj->ti", turn, about)
        else:
            felt = about if joint.kind == "hinge" else f
            torque[:, joint.dof] = np.sum((turn @ joint.axis) * felt, axis=1)
    return torque
