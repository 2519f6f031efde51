"""One chunk of a clip: poses, forces and contacts in, per-frame series out.

Series (T frames; BW = body weight, h = CoM height in the reference pose; *_body, *_dof, *_pair
say where):

* ``required_force`` (T, 3) BW, ``required_moment`` (T, 3) BW h about the CoM: what the floor
  must supply; ``root_acceleration`` m/s^2
* ``step`` rad or m since the frame before, ``leap_linear`` m/s, ``leap_angular`` rad/s faster
  than the frames around (all unfiltered)
* ``joint_speed`` rad/s or m/s; ``limit_excess`` rad or m beyond a joint's range (unfiltered)
* ``jerk`` dimensionless, windowed; ``jitter`` the same without single shocks
* ``lowest`` m above the floor of what may touch, ``deepest`` of all collision geometry;
  ``touching`` number of touching points, ``touch`` (T, bodies) which bodies touch
* ``unexplained_force`` BW, ``unexplained_moment`` BW h: what no contact force explains;
  ``contact_force`` (T, 3) BW: what was found
* ``friction_demand`` 1, ``cop_outside`` m, NaN where nothing is supported
* ``arrow_origin``, ``arrow_force`` (T, 4, 3) m and BW: the largest contact forces, to be drawn
* ``skate`` m/s, ``skate_free`` the part of it that friction does not brake
* ``torque_ratio`` 1, share of a joint's limit; ``self_penetration`` m
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.mjcf import Character, derivatives, required_wrench
from physretarget.validation.cones import fit_forces
from physretarget.validation.contacts import (
    Touch,
    arrows,
    body_motion,
    cop_outside,
    find_touch,
    skate,
    touch_rho,
)
from physretarget.validation.geometry import Candidates, candidates, collision_geoms, of_geoms
from physretarget.validation.selfcollision import SelfCollision
from physretarget.validation.smoothness import windowed_jerk
from physretarget.validation.steps import judge_steps
from physretarget.validation.torque import TorqueLimits, contact_torque

Floats = NDArray[np.float64]
Series = dict[str, NDArray[np.generic]]

# Below this share of body weight the direction of a support force means nothing.
SUPPORT_BW = 0.1


@dataclass(frozen=True, eq=False)
class Chunk:
    """Frames of a clip with neighbours on both sides: ``keep`` are the ones to answer for."""

    qpos: Floats
    raw: Floats
    time: Floats
    keep: slice


@dataclass(frozen=True, eq=False)
class Workspace:
    """What depends on the model alone."""

    character: Character
    points: Candidates
    solid: Candidates
    torque: TorqueLimits
    collision: SelfCollision
    scalars: NDArray[np.int64]
    tolerance: float
    friction: float

    @classmethod
    def build(cls, character: Character, *, tolerance: float, friction: float) -> Workspace:
        """Prepare a model; kept, since many clips share one."""
        return _workspace(character, tolerance, friction)

    @classmethod
    def fresh(cls, character: Character, tolerance: float, friction: float) -> Workspace:
        """Prepare a model: hulls of its meshes, a copy for self-collision, torque limits."""
        points = candidates(character)
        geoms = collision_geoms(character)
        declared = len(character.contacts) > 0
        return cls(
            character=character,
            points=points,
            solid=of_geoms(character, geoms) if declared else points,
            torque=TorqueLimits.build(character),
            collision=SelfCollision.build(character),
            scalars=np.array(
                [j.dof for j in character.tree.joints if j.kind in ("hinge", "slide")], dtype=int
            ),
            tolerance=tolerance,
            friction=friction,
        )


@lru_cache(maxsize=8)
def _workspace(character: Character, tolerance: float, friction: float) -> Workspace:
    return Workspace.fresh(character, tolerance, friction)


def analyse_chunk(work: Workspace, chunk: Chunk) -> Series:
    """Every series of the kept frames."""
    character = work.character
    qvel, qacc = derivatives(character, chunk.qpos, chunk.time)
    pose = kinematics.forward(character.tree, chunk.qpos)
    keep = chunk.keep
    step = float(chunk.time[1] - chunk.time[0]) if len(chunk.time) > 1 else 1.0
    series = judge_steps(character.tree, chunk.raw, 1 / step, keep)
    _joints(series, work, chunk, qvel)
    series |= windowed_jerk(pose.position[:, character.bodies], chunk.time, keep, character)
    here = kinematics.Pose(pose.position[keep], pose.rotation[keep])
    series |= work.collision.judge(chunk.qpos[keep])
    touch = None
    if len(work.points):
        touch = find_touch(work.points, here, character.floor_height, work.tolerance)
        series |= touch.series()
        series |= _penetration(work, here, touch)
    if len(chunk.time) >= 4:
        _forces(series, work, chunk, (qvel, qacc), (pose, here), touch, step)
    return series


def _penetration(work: Workspace, here: kinematics.Pose, touch: Touch) -> Series:
    if work.solid is work.points:
        return {"deepest": touch.lowest, "deepest_body": touch.lowest_body}
    if len(work.solid) == 0:
        return {"deepest": touch.lowest, "deepest_body": touch.lowest_body}
    solid = find_touch(work.solid, here, work.character.floor_height, work.tolerance)
    return {"deepest": solid.lowest, "deepest_body": solid.lowest_body}


def _joints(series: Series, work: Workspace, chunk: Chunk, qvel: Floats) -> None:
    character, keep = work.character, chunk.keep
    if len(work.scalars):
        speed = np.abs(qvel[keep][:, work.scalars])
        worst = speed.argmax(axis=1)
        series["joint_speed"] = speed[np.arange(len(speed)), worst]
        series["joint_speed_dof"] = work.scalars[worst]
    raw = chunk.raw[keep]
    if np.isfinite(character.lower).any() or np.isfinite(character.upper).any():
        excess = np.maximum(character.lower - raw, raw - character.upper)
        worst = excess.argmax(axis=1)
        series["limit_excess"] = np.maximum(excess[np.arange(len(raw)), worst], 0.0)
        series["limit_qpos"] = worst.astype(np.int64)


def _forces(
    series: Series,
    work: Workspace,
    chunk: Chunk,
    motion: tuple[Floats, Floats],
    poses: tuple[kinematics.Pose, kinematics.Pose],
    touch: Touch | None,
    step: float,
) -> None:
    """Inverse dynamics of the kept frames, and the contact forces that explain it."""
    character, keep = work.character, chunk.keep
    qvel, qacc = motion
    wrench = required_wrench(character, chunk.qpos[keep], qvel[keep], qacc[keep])
    if not character.has_root:
        _torques(series, work, wrench.joint_torque)
        return
    weight, height = character.weight, max(character.com_height, 1e-3)
    force = wrench.force / weight
    moment = (wrench.moment + np.cross(wrench.root - wrench.com, wrench.force)) / weight / height
    series["required_force"], series["required_moment"] = force, moment
    dofs = slice(character.root_dof, character.root_dof + 3)
    series["root_acceleration"] = np.linalg.norm(qacc[keep, dofs], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        demand = np.linalg.norm(force[:, :2], axis=1) / force[:, 2]
    series["friction_demand"] = np.where(force[:, 2] > SUPPORT_BW, demand, np.nan)
    if touch is None:
        return
    moving = body_motion(poses[0], touch.bodies, keep, step)
    velocity = touch.velocity(poses[1], moving)
    speed = np.linalg.norm(velocity, axis=2)
    arm = (touch.position - wrench.com[:, None]) / height
    fit = fit_forces(
        arm, touch.mask, np.hstack([force, moment]), friction=work.friction,
        rho=touch_rho(touch, speed, work.tolerance),
    )  # fmt: skip
    series["unexplained_force"] = np.linalg.norm(fit.residual[:, :3], axis=1)
    series["unexplained_moment"] = np.linalg.norm(fit.residual[:, 3:], axis=1)
    series["contact_force"] = fit.force.sum(axis=1)
    series["cop_outside"] = cop_outside(
        touch, force, moment * height, wrench.com, character.floor_height
    )
    series |= arrows(touch, fit.force)
    series |= skate(touch, fit.force, velocity, work.friction)
    held = contact_torque(character, poses[1], touch, fit.force * weight)
    _torques(series, work, wrench.joint_torque - held)


def _torques(series: Series, work: Workspace, torque: Floats) -> None:
    if work.torque.any:
        series |= work.torque.judge(torque)
