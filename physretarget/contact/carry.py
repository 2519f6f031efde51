"""Moving the character to where its feet shall be: the root first, then the joints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.contact.foot import Foot
from physretarget.contact.leg import as_the_leg_has_it, within_budget, yielding
from physretarget.contact.pace import kept_pace
from physretarget.contact.settings import ContactSettings
from physretarget.contact.sole import yaw_quat
from physretarget.ik import IkSettings, motion_price
from physretarget.kinematics import PointTargets
from physretarget.mjcf import Character

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

UPRIGHT = 0.95
"""A hinge is a swivel if the cosine between its axis and the vertical exceeds this."""
HINT = 0.1
"""What the points of a foot weigh that its leg cannot hold, against its centre: the degrees of
freedom that the leg has follow the path."""
TURNS = 2
"""So often a foot takes on the rotation that its leg gives it."""
ITERATIONS = 8
"""Steps of a clip at most: it is solved again and again as stances become shorter."""
SOFT = 1e-5
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
    moved = qpos.copy()
    at = character.root_qpos
    moved[:, at : at + 3] += mean_shift(feet)
    return moved


def mean_shift(feet: list[Foot]) -> Floats:
    """(T, 3) by how much the paths of the feet are off the motion, on the average.

    Feet count the more, the nearer in time they stand: the average stays continuous.
    """
    weight = np.stack([1.0 / (1.0 + (f.track.away / 0.2) ** 2) for f in feet])
    weight += 1e-6
    weight /= weight.sum(axis=0)
    shift = np.stack([f.track.centre - f.motion.centre for f in feet])
    mean: Floats = np.einsum("ft,ftc->tc", weight, shift)
    return mean


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
    step_s: float,
    *,
    start: Floats | None = None,
) -> tuple[Floats, list[Foot]]:
    """Inverse kinematics over a clip: contact points on their paths, everything else as it was.

    Also the feet with the paths that were followed: those that their legs cannot hold in all
    degrees of freedom turn as the legs have them. The trunk keeps within its budget of what it
    was. ``qpos`` (T, nq), ``step_s`` s apart; the search begins at ``start``.
    """
    weak, before = dict.fromkeys(yielding(character, feet), 0.0), feet
    clip = _Clip(character, qpos, settings, step_s)
    found = clip.solved(feet, qpos if start is None else start, hint=weak)
    found, beyond = within_budget(character, found, qpos, settings)
    firm = dict.fromkeys(weak, HINT)
    for _ in range(TURNS if weak else 0):
        found = clip.solved(feet, found, hint=firm, trunk=False)
        feet = [
            as_the_leg_has_it(character, foot, found) if foot in firm else foot for foot in feet
        ]
        firm = {foot: 1.0 for foot, old in zip(feet, before, strict=True) if old in weak}
    if weak or beyond:
        found = clip.solved(feet, found, trunk=False)
    return found, feet


@dataclass(frozen=True, eq=False)
class _Clip:
    """Poses (T, nq) that follow the paths of feet, as near to ``qpos`` and as evenly as can be."""

    character: Character
    qpos: Floats
    settings: ContactSettings
    step_s: float

    def solved(
        self,
        feet: list[Foot],
        start: Floats,
        *,
        hint: Mapping[Foot, float] | None = None,
        trunk: bool = True,
    ) -> Floats:
        """Those with a ``hint`` only with their centres, and their points as firmly as that says.

        ``trunk`` False holds its height and rotation at the start.
        """
        character, settings = self.character, self.settings
        targets = [_as_it_was(character, self.qpos)]
        frames = np.arange(len(self.qpos))
        for foot in feet:
            targets += _targets(foot, frames, settings, (hint or {}).get(foot, 1.0))
        locked = np.zeros(character.tree.nv, dtype=bool)
        if not trunk:
            locked[character.root_dof + 2 : character.root_dof + 6] = True
        return kinematics.solve_trajectory(
            character.tree,
            [start],
            targets,
            step_s=self.step_s,
            price=motion_price(character, IkSettings()),
            reference=self.qpos,
            lower=character.lower,
            upper=character.upper,
            locked=locked,
            # Joints that the points leave undetermined (the twist of a straight leg) stay put.
            prior=self.qpos,
            prior_weight=joint_weights(character, settings.joint_weight),
            iterations=ITERATIONS,
            damping=SOFT,
            tolerance=1e-3,
        ).qpos


def lifted(
    character: Character,
    qpos: Floats,
    feet: list[Foot],
    settings: ContactSettings,
    step_s: float,
    frames: Ints,
    targets: PointTargets,
) -> Floats:
    """Poses of consecutive frames that also bring further points to their places.

    ``qpos`` (n, nq) are poses that follow the paths. The trunk keeps its rotation.
    """
    locked = np.zeros(character.tree.nv, dtype=bool)
    if character.has_root:
        locked[character.root_dof + 3 : character.root_dof + 6] = True
    every = [_as_it_was(character, qpos), targets]
    for foot in feet:
        every += _targets(foot, frames, settings, 1.0)
    return kinematics.solve_trajectory(
        character.tree,
        [qpos],
        every,
        step_s=step_s,
        price=motion_price(character, IkSettings()),
        reference=qpos,
        lower=character.lower,
        upper=character.upper,
        locked=locked,
        prior=qpos,
        prior_weight=joint_weights(character, settings.joint_weight),
        iterations=8,
        damping=SOFT,
        tolerance=1e-4,
    ).qpos


def _as_it_was(character: Character, qpos: Floats) -> PointTargets:
    """The markers where a pose has them."""
    markers = character.markers
    pose = kinematics.forward(character.tree, qpos)
    here = kinematics.points(pose, markers.body, markers.local)
    return PointTargets(markers.body, markers.local, here)


def _targets(
    foot: Foot, frames: Ints, settings: ContactSettings, hint: float
) -> list[PointTargets]:
    """Where a foot's points shall be. ``hint`` below 1: its centre, and the points so much less."""
    sole, track, away = foot.sole, foot.track, foot.track.away[frames]
    count = len(sole.local)
    flight = (settings.flight_weight / (1.0 + (away / settings.fade) ** 2) ** 2)[:, None]
    near = np.exp(-((away / 0.04) ** 2))[:, None]
    stance = (settings.stance_weight - flight) * near
    hint = hint if count > 1 else 1.0
    weight = flight + hint * stance
    bodies = np.full(count, sole.body)
    every = np.broadcast_to(weight, (len(frames), count))
    targets = [PointTargets(bodies, sole.local, track.points(sole)[frames], every)]
    if hint < 1.0:
        held = count * (1.0 - hint) * stance
        centre = track.centre[frames, None]
        targets.append(PointTargets(bodies[:1], sole.centre[None], centre, held))
    if len(sole.under):
        flank = settings.flank_weight / len(sole.under) * weight
        under = np.full(len(sole.under), sole.body)
        path = track.undersides(sole)[frames]
        every = np.broadcast_to(flank, (len(frames), len(under)))
        targets.append(PointTargets(under, sole.under, path, every))
    return targets


def joint_weights(character: Character, weight: float) -> Floats:
    """(nv,) what changes of joints weigh against 1 for a marker, ``weight`` per rad² and height².

    The free root has none.
    """
    weights = np.full(character.tree.nv, weight * character.height**2)
    if character.has_root:
        weights[character.root_dof : character.root_dof + 6] = 0.0
    return weights
