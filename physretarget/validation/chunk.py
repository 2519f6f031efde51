"""One chunk of a clip: poses, forces and contacts in, per-frame series out.

Series (T frames; BW = body weight, h = CoM height in the reference pose; *_body, *_dof, *_pair
say where):

* ``required_force`` (T, 3) BW, ``required_moment`` (T, 3) BW h about the CoM: what the floor
  must supply; ``root_acceleration`` m/s^2
* ``joint_speed`` rad/s or m/s; ``limit_excess`` rad or m beyond a joint's range (unfiltered)
* ``jerk`` dimensionless, windowed
* ``lowest`` m above the floor of what may touch, ``deepest`` of all collision geometry;
  ``clearance`` m by which no point touches, below 0 where one does;
  ``touching`` number of touching points, ``touch`` (T, bodies) which bodies touch,
  ``supported`` whether one does in this frame or within reach of its force
* ``declared_height``, ``declared_body``, ``undeclared_body``: where what the clip says of its
  contacts differs from its geometry, see :func:`physretarget.validation.declared.compare`
* ``unexplained_force`` BW, ``unexplained_moment`` BW h: what no contact force explains;
  ``contact_force`` (T, 3) BW: what was found
* ``cop_outside`` m, NaN where nothing is supported
* ``arrow_origin``, ``arrow_force`` (T, 4, 3) m and BW: the largest contact forces, to be drawn
* ``skate`` m/s, ``skate_free`` the part of it that friction does not brake
* ``elsewhere`` the geom, of nothing that is the floor's or its own, that the character touches; -1
* ``torque_ratio`` 1, share of a joint's limit; ``self_penetration`` m

Of the whole clip (see :mod:`physretarget.validation.smear`): ``straight_force`` (T, 3) BW,
``ringing`` and ``pushed`` (T,) BW, what pushes anywhere and pushes near contacts look like after
the filter; ``friction_demand`` 1, NaN where nothing is supported.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.mjcf import Character, derivatives, required_wrench
from physretarget.validation.contacts import Touch, cop_outside, find_touch, lowest
from physretarget.validation.declared import compare, standing
from physretarget.validation.elsewhere import Elsewhere
from physretarget.validation.geometry import Candidates, candidates, collision_geoms, of_geoms
from physretarget.validation.selfcollision import SelfCollision
from physretarget.validation.smoothness import windowed_jerk
from physretarget.validation.support import (
    arrows,
    find_support,
    fit_support,
    skate,
    sliding,
)
from physretarget.validation.torque import TorqueLimits, contact_torque, without_stops

Floats = NDArray[np.float64]
Series = dict[str, NDArray[np.generic]]


@dataclass(frozen=True, eq=False)
class Chunk:
    """Frames of a clip with neighbours on both sides: ``keep`` are the ones to answer for.

    ``raw`` are the poses before the filter (the same array without one); ``reach`` how many
    frames a contact force is smeared; ``declared`` (T, K) which contact points the clip says to
    stand, None where it says nothing.
    """

    qpos: Floats
    raw: Floats
    time: Floats
    keep: slice
    reach: int
    declared: NDArray[np.bool_] | None = None

    @property
    def wide(self) -> slice:
        """The kept frames and those in reach of their forces."""
        return slice(
            max(0, self.keep.start - self.reach), min(len(self.time), self.keep.stop + self.reach)
        )

    @property
    def inner(self) -> slice:
        """The kept frames among the wide ones."""
        first = self.keep.start - self.wide.start
        return slice(first, first + self.keep.stop - self.keep.start)

    @property
    def step(self) -> float:
        """Seconds from frame to frame."""
        return float(self.time[1] - self.time[0]) if len(self.time) > 1 else 1.0


@dataclass(frozen=True, eq=False)
class Workspace:
    """What depends on the model alone."""

    character: Character
    points: Candidates
    solid: Candidates
    torque: TorqueLimits
    collision: SelfCollision
    elsewhere: Elsewhere
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
            elsewhere=Elsewhere.build(character, tolerance),
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
    if len(qacc) > 2:
        # A clip's first and last frame have no second difference of their own. Extrapolated, a
        # landing two frames on would seem to pull; the neighbour's is smeared by a frame more.
        qacc[0], qacc[-1] = qacc[1], qacc[-2]
    pose = kinematics.forward(character.tree, chunk.qpos)
    raw = pose if chunk.raw is chunk.qpos else kinematics.forward(character.tree, chunk.raw)
    keep = chunk.keep
    series: Series = {}
    _joints(series, work, chunk, qvel)
    series |= windowed_jerk(pose.position[:, character.bodies], chunk.time, keep, character)
    series |= work.collision.judge(chunk.qpos[keep])
    series |= work.elsewhere.judge(chunk.qpos[keep])
    touch = None
    if len(work.points):
        declared = None if chunk.declared is None else chunk.declared[chunk.wide]
        wide = find_touch(
            work.points, _part(pose, chunk.wide), character.floor_height, work.tolerance, declared
        )
        if chunk.declared is not None:
            series |= compare(
                chunk.declared, work.points, character.floor_height, work.tolerance,
                (pose, raw), keep, chunk.step,
            )  # fmt: skip
        touch = wide
        series |= wide.series(chunk.inner)
        series |= _penetration(work, chunk, (pose, raw), wide)
    if len(chunk.time) >= 4:
        _forces(series, work, chunk, (qvel, qacc), (pose, raw), touch)
    return series


def _part(pose: kinematics.Pose, frames: slice) -> kinematics.Pose:
    return kinematics.Pose(pose.position[frames], pose.rotation[frames])


def _penetration(
    work: Workspace, chunk: Chunk, poses: tuple[kinematics.Pose, kinematics.Pose], touch: Touch
) -> Series:
    """Deepest point as filtered or as given, whichever is higher: a filter bends paths, and
    noise lasts a frame."""
    depth, body = touch.lowest[chunk.inner], touch.lowest_body[chunk.inner]
    solid = work.solid if len(work.solid) else work.points
    floor = work.character.floor_height
    if solid is not work.points:
        depth, body = lowest(solid, _part(poses[0], chunk.keep), floor)
    if poses[1] is not poses[0]:
        given, given_body = lowest(solid, _part(poses[1], chunk.keep), floor)
        higher = given > depth
        depth, body = np.where(higher, given, depth), np.where(higher, given_body, body)
    return {"deepest": depth, "deepest_body": body}


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
) -> None:
    """Inverse dynamics of the kept frames, and the contact forces that explain it."""
    character, wide, inner = work.character, chunk.wide, chunk.inner
    qvel, qacc = motion
    wrench = required_wrench(character, chunk.qpos[wide], qvel[wide], qacc[wide])
    if not character.has_root:
        _torques(series, work, chunk.qpos[chunk.keep], wrench.joint_torque[inner])
        return
    weight, height = character.weight, max(character.com_height, 1e-3)
    force = wrench.force[inner] / weight
    arm = (wrench.root - wrench.com)[inner]
    moment = (wrench.moment[inner] / weight + np.cross(arm, force)) / height
    series["required_force"], series["required_moment"] = force, moment
    dofs = slice(character.root_dof, character.root_dof + 3)
    series["given_com"] = _com(character, _part(poses[1], chunk.keep))
    series["root_acceleration"] = np.linalg.norm(qacc[chunk.keep, dofs], axis=1)
    if touch is None:
        return
    support = find_support(touch, wrench.com, inner, chunk.reach)
    here = _part(poses[0], chunk.keep)
    both = poses if poses[1] is not poses[0] else poses[:1]
    stands = standing(chunk.declared, work.points, character.tree.nb)
    velocity = sliding(support, here, both, chunk.keep, chunk.step, work.tolerance, stands)
    fit = fit_support(
        support, np.hstack([force, moment]), velocity, friction=work.friction, height=height,
        tolerance=work.tolerance,
    )  # fmt: skip
    series["unexplained_force"] = np.linalg.norm(fit.residual[:, :3], axis=1)
    series["unexplained_moment"] = np.linalg.norm(fit.residual[:, 3:], axis=1)
    series["contact_force"] = fit.force.sum(axis=1)
    series["cop_outside"] = cop_outside(support.arm, support.mask, force, moment * height)
    series |= support.series()
    series |= arrows(support, fit.force)
    series |= skate(support, fit.force, velocity, work.friction)
    held = contact_torque(character, here, support, fit.force * weight, wrench.com[inner])
    _torques(series, work, chunk.qpos[chunk.keep], wrench.joint_torque[inner] - held)


def _com(character: Character, pose: kinematics.Pose) -> Floats:
    """(T, 3) centre of mass."""
    bodies = list(character.bodies)
    mass = character.model.body_mass[bodies]
    offset = mass[:, None] * character.model.body_ipos[bodies]
    moments = mass @ pose.position[:, bodies]
    moments += np.einsum("tbij,bj->ti", pose.rotation[:, bodies], offset)
    com: Floats = moments / mass.sum()
    return com


def _torques(series: Series, work: Workspace, qpos: Floats, torque: Floats) -> None:
    if work.torque.any:
        series |= work.torque.judge(without_stops(work.character, qpos, torque))
