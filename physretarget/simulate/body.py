"""The body that is simulated: the character's model with the options of the proof.

Torques act through ``qfrc_applied`` alone. Actuators of the file are out of action (a servo would
pull towards a control that nobody gives); they lend their limits.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from physretarget.errors import UsageError
from physretarget.mjcf import Character
from physretarget.simulate.settings import SimulationSettings
from physretarget.simulate.torques import torque_limits

__all__ = ["Body", "build_body"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Body:
    """A character made ready to be simulated.

    Attributes:
        character: whose motion is played.
        model: what is stepped.
        smoother: the same on a floor of less friction.
        coarse: ``model`` with steps of a knot's length and a motor on every controlled degree of
            freedom, for derivatives.
        xml: text of ``model`` where it differs from the character's file, else empty.
        controls: (nu,) degrees of freedom that torques act on; the root's six come first in assist
            mode.
        low, high: (nu,) bounds of the torques, N m or N; infinite for the assist.
        inertia: (nu,) kg m² or kg, 1 / (M⁻¹)_jj in the reference pose.
        notes: what was changed or assumed, one sentence each.
    """

    character: Character
    model: mujoco.MjModel
    smoother: mujoco.MjModel
    coarse: mujoco.MjModel
    xml: str
    controls: Ints
    low: Array
    high: Array
    inertia: Array
    notes: tuple[str, ...]


def build_body(character: Character, settings: SimulationSettings) -> Body:
    """Make a character ready.

    Raises:
        UsageError: its root is not free, so that nothing can fall.
    """
    if not character.has_root:
        raise UsageError(
            f"{character.name} has no free root, so that it cannot fall: simulate needs one."
        )
    spec = _spec(character)
    notes: list[str] = []
    changed = _floor(spec, character, notes) | _gains(spec, character, notes)
    xml = spec.to_xml() if changed else ""
    model = mujoco.MjModel.from_xml_string(xml) if xml else copy.copy(character.model)
    _options(model, settings.timestep)
    controls = _controls(character, assist=settings.assist)
    coarse, smoother = _coarse(character, xml, controls, settings.knot), copy.copy(model)
    smoother.geom_friction[:, 0] *= settings.friction_share
    smoother.pair_friction[:, :2] *= settings.friction_share
    low, high, told = torque_limits(character, settings.torque_multiple)
    if told:
        notes.append(told)
    free = np.full(6 if settings.assist else 0, np.inf)
    joints = controls[len(free) :]
    return Body(
        character=character,
        model=model,
        smoother=smoother,
        coarse=coarse,
        xml=xml,
        controls=controls,
        low=np.concatenate([-free, low[joints]]),
        high=np.concatenate([free, high[joints]]),
        inertia=_inertia(model, character)[controls],
        notes=tuple(notes),
    )


def _spec(character: Character) -> mujoco.MjSpec:
    if character.path is not None:
        spec = mujoco.MjSpec.from_file(str(character.path))
        folder = character.path.resolve().parent
        spec.meshdir = str(folder / spec.meshdir)
        spec.texturedir = str(folder / spec.texturedir)
        return spec
    assert character.source is not None
    return mujoco.MjSpec.from_string(character.source.text)


def _floor(spec: mujoco.MjSpec, character: Character, notes: list[str]) -> bool:
    """Put a floor where there is none."""
    if character.has_floor:
        return False
    spec.worldbody.add_geom(
        name="simulate_floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0, 0, 0.05],
        pos=[0, 0, character.floor_height],
        friction=[character.friction, 0.005, 0.0001],
        contype=1,
        conaffinity=1,
        condim=3,
    )
    notes.append("the model has no floor: a level plane at height 0 was added")
    return True


def _gains(spec: mujoco.MjSpec, character: Character, notes: list[str]) -> bool:
    """Take springs and dampers off joints that a motor drives: there they are servo gains."""
    model = character.model
    driven = _driven(model) & (model.jnt_stiffness > 0)
    for index in np.flatnonzero(driven):
        joint = spec.joint(model.joint(int(index)).name)
        joint.stiffness = np.zeros_like(joint.stiffness)
        joint.damping = np.zeros_like(joint.damping)
    if driven.any():
        notes.append(
            f"{int(driven.sum())} joints have both a motor and a spring: stiffness and damping "
            "there are gains of a servo and were left out"
        )
    return bool(driven.any())


def _driven(model: mujoco.MjModel) -> NDArray[np.bool_]:
    driven = np.zeros(model.njnt, dtype=np.bool_)
    kinds = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
    driven[model.actuator_trnid[np.isin(model.actuator_trntype, kinds), 0]] = True
    return driven


def _options(model: mujoco.MjModel, timestep: float) -> None:
    """Actuators off, sensors off, and no reset behind one's back when a state is bad."""
    off = mujoco.mjtDisableBit
    model.opt.timestep = timestep
    model.opt.disableflags |= off.mjDSBL_ACTUATION | off.mjDSBL_SENSOR | off.mjDSBL_AUTORESET


def _controls(character: Character, *, assist: bool) -> Ints:
    model, root = character.model, character.root_dof
    inside = np.isin(model.dof_bodyid, character.bodies)
    controls = np.flatnonzero(inside)
    return controls if assist else controls[(controls < root) | (controls >= root + 6)]


def _coarse(character: Character, xml: str, controls: Ints, timestep: float) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(xml) if xml else _spec(character)
    for actuator in list(spec.actuators):
        spec.delete(actuator)
    for sensor in list(spec.sensors):
        spec.delete(sensor)
    for key in list(spec.keys):
        spec.delete(key)
    for index, joint in enumerate(spec.joints):
        joint.name = joint.name or f"simulate_joint_{index}"
    model = spec.compile()
    for dof in controls:
        joint = int(model.dof_jntid[dof])
        motor = spec.add_actuator(trntype=mujoco.mjtTrn.mjTRN_JOINT, target=model.joint(joint).name)
        motor.set_to_motor()
        gear = np.zeros(6)
        gear[dof - model.jnt_dofadr[joint]] = 1.0
        motor.gear = gear
    coarse = spec.compile()
    _options(coarse, timestep)
    coarse.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    coarse.jnt_actfrclimited[:] = 0
    return coarse


def _inertia(model: mujoco.MjModel, character: Character) -> Array:
    data = mujoco.MjData(model)
    data.qpos[:] = character.reference_qpos
    mujoco.mj_forward(model, data)
    inverse = np.empty((model.nv, model.nv))
    mujoco.mj_solveM(model, data, inverse, np.eye(model.nv))
    return 1.0 / np.diagonal(inverse)
