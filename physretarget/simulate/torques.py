"""What the joints can do: limits of the file, else a multiple of the gravity torque."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from physretarget.mjcf import Character
from physretarget.mjcf.reference import geom_span, tree_bodies

__all__ = ["gravity_torques", "torque_limits"]

Array = NDArray[np.float64]


def torque_limits(character: Character, multiple: float) -> tuple[Array, Array, str]:
    """Bounds (nv,) of the joints' torques, N m or N, and a sentence where some were assumed.

    A joint's bound is the tighter one of ``actuatorfrcrange`` and the force ranges of its
    actuators times their gears; without either it is `multiple` gravity torques, and what the
    joint's own spring pulls at the farther end of its range.
    """
    model = character.model
    low, high = np.full(model.nv, -np.inf), np.full(model.nv, np.inf)
    for joint in np.flatnonzero(model.jnt_actfrclimited):
        dof = model.jnt_dofadr[joint]
        low[dof], high[dof] = model.jnt_actfrcrange[joint]
    for dof, (least, most) in _forces(model).items():
        low[dof], high[dof] = max(low[dof], least), min(high[dof], most)
    gravity = multiple * gravity_torques(character) + _springs(model)
    unlimited = ~np.isfinite(high)
    low[unlimited], high[unlimited] = -gravity[unlimited], gravity[unlimited]
    joints = np.isin(model.dof_bodyid, character.bodies) & (model.dof_jntid != _root(character))
    assumed = int((unlimited & joints).sum())
    told = (
        f"{assumed} of {int(joints.sum())} joint axes have no torque limit in the model: "
        f"{multiple:g} gravity torques each, and what springs pull"
        if assumed
        else ""
    )
    return low, high, told


def _root(character: Character) -> int:
    return int(character.model.body_jntadr[character.root_body])


def _springs(model: mujoco.MjModel) -> Array:
    """(nv,) N m or N: what each hinge's or slide's spring pulls at the farther end of its range."""
    pull = np.zeros(model.nv)
    for joint in np.flatnonzero(model.jnt_limited):
        if model.jnt_type[joint] < int(mujoco.mjtJoint.mjJNT_SLIDE):
            continue
        rest = model.qpos_spring[model.jnt_qposadr[joint]]
        stiffness = float(np.ravel(model.jnt_stiffness[joint])[0])
        pull[model.jnt_dofadr[joint]] = stiffness * np.abs(model.jnt_range[joint] - rest).max()
    return pull


def _forces(model: mujoco.MjModel) -> dict[int, tuple[float, float]]:
    """Degree of freedom → what its limited actuators give in all."""
    found: dict[int, tuple[float, float]] = {}
    driven: dict[int, bool] = {}
    for index in range(model.nu):
        if model.actuator_trntype[index] != mujoco.mjtTrn.mjTRN_JOINT:
            continue
        joint = int(model.actuator_trnid[index, 0])
        if model.jnt_type[joint] < int(mujoco.mjtJoint.mjJNT_SLIDE):
            continue
        dof, gear = int(model.jnt_dofadr[joint]), float(model.actuator_gear[index, 0])
        driven[dof] = driven.get(dof, True) and bool(model.actuator_forcelimited[index])
        least, most = sorted(gear * model.actuator_forcerange[index])
        before = found.get(dof, (0.0, 0.0))
        found[dof] = before[0] + least, before[1] + most
    return {dof: force for dof, force in found.items() if driven[dof]}


def gravity_torques(character: Character) -> Array:
    """(nv,) N m (N for slides): what it takes to hold the body up through each joint.

    The weights of all that the joint carries, held out straight. Where the whole body hangs on a
    limb it is the whole weight at the limb's length, if that is more: a limb that ends on the floor
    in the reference pose bears the body, and where the root itself stands there, as a desk lamp's,
    the limb is what throws it.
    """
    model, weight = character.model, character.weight
    gravity = float(np.linalg.norm(model.opt.gravity))
    data = mujoco.MjData(model)
    data.qpos[:] = character.reference_qpos
    mujoco.mj_kinematics(model, data)
    stands = _standing(character, data)
    footed = bool(stands[character.root_body])
    torque = np.zeros(model.nv)
    for dof in range(model.nv):
        joint, body = int(model.dof_jntid[dof]), int(model.dof_bodyid[dof])
        if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE:
            continue
        carried = tree_bodies(model, body)
        mass = model.body_mass[carried]
        if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE:
            torque[dof] = weight
            continue
        reach = np.linalg.norm(data.xipos[carried] - data.xanchor[joint], axis=1)
        torque[dof] = gravity * float(mass @ reach)
        legs = carried if footed else carried[stands[carried]]
        if len(legs):
            far = np.linalg.norm(data.xipos[legs] - data.xanchor[joint], axis=1).max()
            torque[dof] = max(torque[dof], weight * float(far))
    return torque


def _standing(character: Character, data: mujoco.MjData) -> NDArray[np.bool_]:
    """Bodies with geometry in the lowest twentieth of the height in the reference pose."""
    model = character.model
    stands = np.zeros(model.nbody, dtype=np.bool_)
    inside = [int(g) for g in np.flatnonzero(np.isin(model.geom_bodyid, character.bodies))]
    low = np.array([geom_span(model, data, geom)[0] for geom in inside])
    touching = low < low.min(initial=np.inf) + 0.05 * character.height
    stands[model.geom_bodyid[inside][touching]] = True
    return stands
