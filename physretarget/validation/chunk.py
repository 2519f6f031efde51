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
* ``com`` (T, 3) m, the centre of mass
* ``moment_rest`` (T, 3) BW h: what remains when contact forces explain the force;
  ``contact_force`` (T, 3) BW: what was found; ``arm`` (T, 3) h, the mean arm about the CoM of
  what may bear, zero for nothing; ``grip`` the friction coefficient of what touches, NaN for
  nothing
* ``arrow_origin``, ``arrow_force`` (T, 4, 3) m and BW: the largest contact forces, to be drawn
* ``skate`` m/s, ``skate_free`` the part of it that friction does not brake
* ``elsewhere`` the geom, of nothing that is the floor's or its own, that the character touches; -1
* ``torque_ratio`` 1, share of a joint's limit that it needs at least; ``self_penetration`` m

Of the whole clip (see :mod:`physretarget.ground.response`): ``explained_force`` (T, 3) BW, the
nearest that forces in their cones near contacts look like after the filter, ``unexplained_force``
BW the rest; ``unexplained_moment`` BW h, ``moment_rest`` less ``side_lobes`` BW h that the filter
may make of shocks around; ``cop_outside`` m that the centre of pressure would have to lie outside
what supports, NaN where nothing does; ``ringing`` (T,) BW what the filter makes of pushes anywhere;
``friction_demand`` 1, NaN where nothing is supported.
"""

from __future__ import annotations

from dataclasses import dataclass
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
from physretarget.validation.smoothness import windowed_jerk
from physretarget.validation.torque import contact_torque

Floats = NDArray[np.float64]
Series = dict[str, NDArray[np.generic]]


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


def analyse_chunk(work: Workspace, chunk: Chunk) -> Series:
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
    series: Series = {}
    _joints(series, work, chunk, qvel)
    series |= windowed_jerk(pose.position[:, character.bodies], chunk.time, keep, character)
    series |= work.collision.judge(chunk.qpos[keep])
    series |= work.external.judge(chunk.qpos[keep])
    contacts = None
    if len(work.points):
        contacts = find_contacts(
            work.points, _part(pose, chunk.wide), character.floor_height, work.tolerance,
            work.friction,
        )  # fmt: skip
        series |= _touching(contacts, chunk.inner)
        series |= _penetration(work, chunk, pose, contacts)
        if chunk.declared is not None:
            series |= compare(
                chunk.declared, character, work.tolerance, (pose, chunk.raw_pose), keep, chunk.step
            )
    if len(chunk.time) >= 4:
        _forces(series, work, chunk, (qvel, qacc), pose, contacts)
    return series


def _part(pose: kinematics.Pose, frames: slice) -> kinematics.Pose:
    return kinematics.Pose(pose.position[frames], pose.rotation[frames])


def _touching(contacts: Contacts, inner: slice) -> Series:
    """The contacts of the kept frames, as they are kept."""
    rough = np.where(contacts.mask, contacts.friction, -1.0)[inner].max(axis=1, initial=-1.0)
    return {
        "lowest": contacts.lowest[inner],
        "lowest_body": contacts.lowest_body[inner],
        "clearance": contacts.clearance[inner],
        "touching": contacts.mask[inner].sum(axis=1),
        "touch": contacts.on[inner],
        "grip": np.where(rough < 0, np.nan, rough),
    }


def _penetration(
    work: Workspace, chunk: Chunk, pose: kinematics.Pose, contacts: Contacts
) -> Series:
    """Deepest point as filtered or as given, whichever is higher: a filter bends paths, and
    noise lasts a frame."""
    depth, body = contacts.lowest[chunk.inner], contacts.lowest_body[chunk.inner]
    if chunk.raw_pose is not pose:
        floor = work.character.floor_height
        given, given_body = lowest(work.points, _part(chunk.raw_pose, chunk.keep), floor)
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
    pose: kinematics.Pose,
    contacts: Contacts | None,
) -> None:
    """What the kept frames require, and the contact forces that explain it."""
    character, keep, inner = work.character, chunk.keep, chunk.inner
    qvel, qacc = motion
    needs = None
    if work.torque is not None:
        needs = required_wrench(character, chunk.qpos[keep], qvel[keep], qacc[keep])
    if not character.has_root:
        if work.torque is not None and needs is not None:
            series |= work.torque.judge(unsupported(chunk.qpos[keep], needs))
        return
    height = max(character.com_height, 1e-3)
    force, moment = chunk.force[keep], chunk.moment[keep]
    series["required_force"], series["required_moment"] = force, moment
    dofs = slice(character.root_dof, character.root_dof + 3)
    series["root_acceleration"] = np.linalg.norm(qacc[keep, dofs], axis=1)
    com = centre_of_mass(character, _part(pose, chunk.wide))
    series["com"] = com[inner]
    if contacts is None:
        return
    poses = (pose,) if chunk.raw_pose is pose else (pose, chunk.raw_pose)
    here = _part(pose, keep)
    velocity = sliding(contacts, _part(pose, chunk.wide), poses, chunk.wide.start, chunk.step)
    found = explain(
        contacts, com, inner, chunk.reach, force, moment, height=height, velocity=velocity
    )
    support = found.support
    series["supported"] = support.within
    series["moment_rest"], series["arm"] = found.moment, _mean_arm(support, height)
    series["contact_force"] = found.force.sum(axis=1)
    series |= arrows(support, found.force)
    series |= skate(support, found.force, found.slides)
    if work.torque is not None and needs is not None:
        bears = found.force * character.weight
        held = contact_torque(character, here, support, bears, com[inner])
        loads = Loads(
            chunk.qpos[keep], needs.joint_torque, needs.passive, held, bears, support, com[inner]
        )
        series |= work.torque.judge(loads)


def _mean_arm(support: Support, height: float) -> Floats:
    number = np.maximum(support.mask.sum(axis=1), 1)[:, None]
    mean: Floats = support.arm.sum(axis=1) / (number * height)
    return mean
