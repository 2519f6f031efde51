"""Moving the character to where its feet shall be: the root first, then the joints."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.contact.foot import Foot
from physretarget.contact.pace import kept_pace
from physretarget.contact.settings import ContactSettings
from physretarget.contact.sole import yaw_quat
from physretarget.kinematics import PointTargets
from physretarget.mjcf import Character

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

UPRIGHT = 0.95
"""A hinge is a swivel if the cosine between its axis and the vertical exceeds this."""
SOFT = 1e-4
"""Damping at first: it must be small against the markers' weight of 1, not that of the contacts."""


def carried(
    character: Character, qpos: Floats, time: Floats, feet: list[Foot], settings: ContactSettings
) -> Floats:
    """The root corrected so that the feet are where they shall be, on the average.

    If the root itself is the body that stands on a face, its path is exact; what it carries
    goes with it, but keeps facing where it faced as far as a swivel allows, and keeps its pace.
    Otherwise the root is shifted and keeps its orientation; legs take up what a foot's heading
    differs.
    """
    if not character.has_root:
        return qpos.copy()
    own = [f for f in feet if f.sole.body == character.root_body and len(f.sole.local) > 2]
    if own:
        moved = _swivelled(character, _on_track(character, qpos, own[0]), own[0], settings)
        return kept_pace(character, moved, time, own[0], settings)
    # Feet count the more, the nearer in time they stand: the average stays continuous.
    weight = np.stack([1.0 / (1.0 + (f.track.away / 0.2) ** 2) for f in feet])
    weight += 1e-6
    weight /= weight.sum(axis=0)
    shift = np.stack([f.track.centre - f.motion.centre for f in feet])
    moved = qpos.copy()
    at = character.root_qpos
    moved[:, at : at + 3] += np.einsum("ft,ftc->tc", weight, shift)
    return moved


def _on_track(character: Character, qpos: Floats, foot: Foot) -> Floats:
    """The whole pose carried along with the root on its path."""
    moved, at = qpos.copy(), character.root_qpos
    rotation = foot.track.rotation
    moved[:, at : at + 3] = foot.track.centre - rotation @ foot.sole.centre
    moved[:, at + 3 : at + 7] = kinematics.matrix_to_quat(rotation)
    return moved


def swivels(character: Character) -> list[tuple[int, float]]:
    """Hinges about the vertical on which all stands that the root carries, none if any does not.

    Address in qpos and the sign of the axis, +1 if it points up.
    """
    tree = character.tree
    found: list[tuple[int, float]] = []
    pose = kinematics.forward(tree, character.reference_qpos[None])
    for body in np.flatnonzero(tree.parent == character.root_body):
        if body == character.root_body:
            continue
        joints = tree.joints_of[int(body)]
        if not joints or joints[0].kind != "hinge":
            return []
        fixed = kinematics.quat_to_matrix(tree.rotation[body])
        axis = pose.rotation[0, character.root_body] @ fixed @ joints[0].axis
        if abs(axis[2]) < UPRIGHT:
            return []
        found.append((joints[0].qpos, float(np.sign(axis[2]))))
    return found


def _swivelled(
    character: Character, moved: Floats, foot: Foot, settings: ContactSettings
) -> Floats:
    """What the root carries turned back by as much as the root was turned to its stance.

    The swivel does it alone on a level base; where the base is tilted as well, inverse
    kinematics finds the joints that keep the carried bodies as they were in the world.
    """
    shift = foot.yaw_shift()
    joints = swivels(character)
    if not joints or np.abs(shift).max() < 1e-6:
        return moved
    turned = moved.copy()
    back = -shift
    for at, sign in joints:
        turned[:, at] = np.clip(
            moved[:, at] + sign * back, character.lower[at], character.upper[at]
        )
        reached = sign * (turned[:, at] - moved[:, at])
        back = np.where(np.abs(reached) < np.abs(back), reached, back)
    for at, sign in joints:  # several swivels turn by what all of them can
        turned[:, at] = moved[:, at] + sign * back
    lean = 1.0 - foot.track.rotation[:, 2] @ foot.sole.flat.T[:, 2]
    frames = np.flatnonzero(np.abs(back) * np.sqrt(2.0 * np.maximum(lean, 0.0)) > 1e-3)
    if len(frames):
        turned[frames] = _kept(
            character, moved[frames], turned[frames], back[frames], foot, frames, settings
        )
    return turned


def _kept(
    character: Character,
    moved: Floats,
    start: Floats,
    back: Floats,
    foot: Foot,
    frames: Ints,
    settings: ContactSettings,
) -> Floats:
    """Joints that bring the carried markers to where ``moved`` has them, turned by ``back``."""
    pose = kinematics.forward(character.tree, moved)
    index = character.markers.body != character.root_body
    body, local = character.markers.body[index], character.markers.local[index]
    centre = foot.track.centre[frames, None]
    turn = kinematics.quat_to_matrix(yaw_quat(back))
    arm = kinematics.points(pose, body, local) - centre
    target = centre + np.einsum("tij,tkj->tki", turn, arm)
    locked = np.zeros(character.tree.nv, dtype=bool)
    locked[character.root_dof : character.root_dof + 6] = True
    return kinematics.solve(
        character.tree,
        start,
        [PointTargets(body, local, target)],
        lower=character.lower,
        upper=character.upper,
        locked=locked,
        prior_weight=settings.joint_weight * character.height**2,
        iterations=4,
        tolerance=1e-3,
    ).qpos


def off_track(character: Character, qpos: Floats, feet: list[Foot]) -> float:
    """The farthest that a point of any path is missed, m."""
    pose = kinematics.forward(character.tree, qpos)
    return max(
        float(np.abs(foot.points(pose) - foot.track.points(foot.sole)).max()) for foot in feet
    )


def followed(
    character: Character,
    qpos: Floats,
    feet: list[Foot],
    settings: ContactSettings,
    *,
    frames: Ints | None = None,
    lifted: PointTargets | None = None,
    iterations: int = 30,
) -> Floats:
    """Inverse kinematics: contact points on their paths, everything else as it was.

    ``qpos`` are the poses of ``frames``, by default all; ``lifted`` are further targets.
    """
    frames = np.arange(len(qpos)) if frames is None else frames
    pose = kinematics.forward(character.tree, qpos)
    markers = character.markers
    here = kinematics.points(pose, markers.body, markers.local)
    targets = [PointTargets(markers.body, markers.local, here)]
    for foot in feet:
        sole, away = foot.sole, foot.track.away[frames]
        flight = settings.flight_weight / (1.0 + (away / settings.fade) ** 2) ** 2
        near = np.exp(-((away / 0.04) ** 2))
        weight = (flight + (settings.stance_weight - flight) * near)[:, None]
        weight = np.broadcast_to(weight, (len(qpos), len(sole.local)))
        bodies = np.full(len(sole.local), sole.body)
        path = foot.track.points(sole)[frames]
        targets.append(PointTargets(bodies, sole.local, path, weight))
        if len(sole.under):
            flank = settings.flank_weight / len(sole.under) * weight[:, :1]
            under = np.full(len(sole.under), sole.body)
            path = foot.track.undersides(sole)[frames]
            every = np.broadcast_to(flank, (len(qpos), len(under)))
            targets.append(PointTargets(under, sole.under, path, every))
    if lifted is not None:
        targets.append(lifted)
    return kinematics.solve(
        character.tree,
        qpos,
        targets,
        lower=character.lower,
        upper=character.upper,
        # Joints that the points leave undetermined (the twist of a straight leg) stay put.
        prior_weight=joint_weights(character, settings.joint_weight),
        iterations=iterations,
        damping=SOFT,
        tolerance=1e-4,
    ).qpos


def joint_weights(character: Character, weight: float) -> Floats:
    """(nv,) what changes of joints weigh against 1 for a marker, ``weight`` per rad² and height².

    The free root has none.
    """
    weights = np.full(character.tree.nv, weight * character.height**2)
    if character.has_root:
        weights[character.root_dof : character.root_dof + 6] = 0.0
    return weights
