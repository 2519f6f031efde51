"""One chunk of a clip: poses, forces and contacts in, per-frame series out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.ground.contacts import Contacts, find_contacts, lowest
from physretarget.ground.sliding import arrows, skate, sliding
from physretarget.ground.support import Support, explain
from physretarget.ground.undersides import Undersides, undersides
from physretarget.ground.wrench import centre_of_mass
from physretarget.mjcf import Character, derivatives, required_wrench
from physretarget.validation.declared import compare
from physretarget.validation.external_contacts import ExternalContacts
from physretarget.validation.least_torque import LeastTorque, Loads, unsupported
from physretarget.validation.selfcollision import SelfCollision
from physretarget.validation.series import (
    Bearing,
    FloorTouch,
    FrameSeries,
    JointSpeed,
    LimitExcess,
    Requirement,
)
from physretarget.validation.smoothness import windowed_jerk
from physretarget.validation.torque import contact_torque

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Chunk:
    """Frames of a clip with neighbours on both sides: ``keep`` are the ones to answer for.

    ``raw`` are the poses before the filter (the same array without one) and ``raw_pose`` their
    bodies; ``force`` (T, 3) BW and ``moment`` (T, 3) BW h what is required, filtered; ``reach`` how
    many frames a contact force shows; ``declared`` (T, P) which contact points the clip says to
    stand, None where it says nothing.
    """

    qpos: Floats
    raw: Floats
    raw_pose: kinematics.Pose
    force: Floats
    moment: Floats
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
    points: Undersides
    torque: LeastTorque | None
    collision: SelfCollision
    external: ExternalContacts
    scalars: NDArray[np.int64]
    tolerance: float
    friction: float | None

    @classmethod
    def build(cls, character: Character, *, tolerance: float, friction: float | None) -> Workspace:
        """Prepare a model; kept, since many clips share one."""
        return _workspace(character, tolerance, friction)

    @classmethod
    def fresh(cls, character: Character, tolerance: float, friction: float | None) -> Workspace:
        """Prepare a model: hulls of its meshes, a copy for self-collision, torque limits."""
        return cls(
            character=character,
            points=undersides(character),
            torque=LeastTorque.build(character),
            collision=SelfCollision.build(character),
            external=ExternalContacts.build(character, tolerance),
            scalars=np.array(
                [j.dof for j in character.tree.joints if j.kind in ("hinge", "slide")], dtype=int
            ),
            tolerance=tolerance,
            friction=friction,
        )


@lru_cache(maxsize=8)
def _workspace(character: Character, tolerance: float, friction: float | None) -> Workspace:
    return Workspace.fresh(character, tolerance, friction)


def analyse_chunk(work: Workspace, chunk: Chunk) -> FrameSeries:
    """Every series of the kept frames."""
    character = work.character
    qvel, qacc = derivatives(character, chunk.qpos, chunk.time)
    if len(qacc) > 2:
        # A clip's first and last frame have no second difference of their own: see ground.wrench.
        qacc[0], qacc[-1] = qacc[1], qacc[-2]
    pose = chunk.raw_pose
    if chunk.raw is not chunk.qpos:
        pose = kinematics.forward(character.tree, chunk.qpos)
    keep = chunk.keep
    series = FrameSeries(
        joint_speed=_joint_speed(work, chunk, qvel),
        limit_excess=_limit_excess(work, chunk),
        jerk=windowed_jerk(pose.position[:, character.bodies], chunk.time, keep, character),
        overlap=work.collision.judge(chunk.qpos[keep]),
        external=work.external.judge(chunk.qpos[keep]),
    )
    contacts = None
    if len(work.points):
        contacts = find_contacts(
            work.points, _part(pose, chunk.wide), character.floor_height, work.tolerance,
            work.friction,
        )  # fmt: skip
        series = replace(series, floor=_floor(work, chunk, pose, contacts))
        if chunk.declared is not None:
            declared = compare(
                chunk.declared, character, work.tolerance, (pose, chunk.raw_pose), keep, chunk.step
            )
            series = replace(series, declared=declared)
    if len(chunk.time) >= 4:
        return _with_forces(series, work, chunk, (qvel, qacc), pose, contacts)
    return series


def _part(pose: kinematics.Pose, frames: slice) -> kinematics.Pose:
    return kinematics.Pose(pose.position[frames], pose.rotation[frames])


def _floor(work: Workspace, chunk: Chunk, pose: kinematics.Pose, contacts: Contacts) -> FloorTouch:
    """The contacts of the kept frames.

    The deepest point is as filtered or as given, whichever is higher: a filter bends paths, and
    noise lasts a frame.
    """
    inner = chunk.inner
    rough = np.where(contacts.mask, contacts.friction, -1.0)[inner].max(axis=1, initial=-1.0)
    depth, body = contacts.lowest[inner], contacts.lowest_body[inner]
    if chunk.raw_pose is not pose:
        floor = work.character.floor_height
        given, given_body = lowest(work.points, _part(chunk.raw_pose, chunk.keep), floor)
        higher = given > depth
        depth, body = np.where(higher, given, depth), np.where(higher, given_body, body)
    return FloorTouch(
        lowest=contacts.lowest[inner], lowest_body=contacts.lowest_body[inner],
        deepest=depth, deepest_body=body, clearance=contacts.clearance[inner],
        points=contacts.mask[inner].sum(axis=1), bodies=contacts.on[inner],
        grip=np.where(rough < 0, np.nan, rough),
    )  # fmt: skip


def _joint_speed(work: Workspace, chunk: Chunk, qvel: Floats) -> JointSpeed | None:
    if not len(work.scalars):
        return None
    speed = np.abs(qvel[chunk.keep][:, work.scalars])
    worst = speed.argmax(axis=1)
    return JointSpeed(speed[np.arange(len(speed)), worst], work.scalars[worst])


def _limit_excess(work: Workspace, chunk: Chunk) -> LimitExcess | None:
    character, raw = work.character, chunk.raw[chunk.keep]
    if not (np.isfinite(character.lower).any() or np.isfinite(character.upper).any()):
        return None
    excess = np.maximum(character.lower - raw, raw - character.upper)
    worst = excess.argmax(axis=1)
    return LimitExcess(np.maximum(excess[np.arange(len(raw)), worst], 0.0), worst)


def _with_forces(
    series: FrameSeries,
    work: Workspace,
    chunk: Chunk,
    motion: tuple[Floats, Floats],
    pose: kinematics.Pose,
    contacts: Contacts | None,
) -> FrameSeries:
    """With what the kept frames require, and the contact forces that explain it."""
    character, keep, inner = work.character, chunk.keep, chunk.inner
    qvel, qacc = motion
    needs = None
    if work.torque is not None:
        needs = required_wrench(character, chunk.qpos[keep], qvel[keep], qacc[keep])
    if not character.has_root:
        if work.torque is not None and needs is not None:
            held_up = unsupported(chunk.qpos[keep], needs)
            return replace(series, torque=work.torque.judge(held_up))
        return series
    height = max(character.com_height, 1e-3)
    force, moment = chunk.force[keep], chunk.moment[keep]
    dofs = slice(character.root_dof, character.root_dof + 3)
    com = centre_of_mass(character, _part(pose, chunk.wide))
    acceleration = np.linalg.norm(qacc[keep, dofs], axis=1)
    series = replace(series, required=Requirement(force, moment, com[inner], acceleration))
    if contacts is None:
        return series
    poses = (pose,) if chunk.raw_pose is pose else (pose, chunk.raw_pose)
    here = _part(pose, keep)
    velocity = sliding(contacts, _part(pose, chunk.wide), poses, chunk.wide.start, chunk.step)
    found = explain(
        contacts, com, inner, chunk.reach, force, moment, height=height, velocity=velocity
    )
    support = found.support
    arm = _mean_arm(support, height)
    series = replace(
        series,
        bearing=Bearing(support.within, found.force.sum(axis=1), found.moment, arm),
        arrows=arrows(support, found.force),
        skate=skate(support, found.force, found.slides),
    )
    if work.torque is not None and needs is not None:
        bears = found.force * character.weight
        held = contact_torque(character, here, support, bears, com[inner])
        loads = Loads(
            chunk.qpos[keep], needs.joint_torque, needs.passive, held, bears, support, com[inner]
        )
        series = replace(series, torque=work.torque.judge(loads))
    return series


def _mean_arm(support: Support, height: float) -> Floats:
    number = np.maximum(support.mask.sum(axis=1), 1)[:, None]
    mean: Floats = support.arm.sum(axis=1) / (number * height)
    return mean
