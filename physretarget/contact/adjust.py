"""Contact adjustment: planted points stay where they are (Yamane 2010, section 5.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.contact.clearance import surface_points
from physretarget.contact.phases import Phases, any_point, runs
from physretarget.contact.settings import ContactSettings
from physretarget.contact.sole import Sole, SoleMotion, make_sole, sole_motion, yaw_quat
from physretarget.contact.stances import Footing, find_footings
from physretarget.contact.track import Track, fly, stand
from physretarget.errors import InputError
from physretarget.ik import continuous_qpos
from physretarget.kinematics import PointTargets
from physretarget.mjcf import Character

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

TOUCHING = 1e-3
"""A point this near to its place on the floor (m) counts as planted, whoever bears the body."""
FLOOR_SLACK = 1e-4
"""Carried bodies may be this far below the floor (m) without being lifted."""
SHORTEST_TOUCH = 0.05
"""Shorter touches of points that bear nothing by the timetable are not reported (s)."""


@dataclass(frozen=True, eq=False)
class Stance:
    """One stance of one body, for reports.

    ``body`` its name; ``points`` the contact points that bore it at some time; frames
    ``first`` to ``last``, ``start`` and ``end`` in s; ``position`` (2,) m and ``yaw`` rad of the
    sole's centre; ``hop`` whether the flight before it was made or lengthened.
    """

    body: str
    points: tuple[str, ...]
    first: int
    last: int
    start: float
    end: float
    position: Floats
    yaw: float
    hop: bool


@dataclass(frozen=True, eq=False)
class Contacted:
    """A clip whose contacts hold still.

    ``qpos`` (T, nq); ``active`` (T, nc) contact points that stand on the floor, as the final
    poses have them; ``target`` (T, nc, 3) where a point of a standing body belongs, NaN
    otherwise; ``slide_max_m`` farthest that an active point moves along the floor within a
    stance; ``sink_max_m`` deepest that one sinks; ``stances`` in order of time.
    """

    qpos: Floats
    active: Bools
    target: Floats
    slide_max_m: float
    sink_max_m: float
    stances: tuple[Stance, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _Foot:
    """A sole with its motion before the adjustment, its stances and the path it shall take."""

    sole: Sole
    motion: SoleMotion
    active: Bools
    footings: list[Footing]
    track: Track


def adjust(
    character: Character,
    qpos: Floats,
    time: Floats,
    phases: Phases,
    *,
    settings: ContactSettings | None = None,
) -> Contacted:
    """Plant the character's contact points when the actor's are planted.

    Every body that carries contact points gets one rigid place per stance, the mean of where
    the motion has it, on the floor. Corrections are blended over flights. The root moves with
    them and carries the whole pose; inverse kinematics does the rest.

    Args:
        character: its ``contacts`` are tied to the actor's by ``tied``; None is not planted.
        qpos: (T, nq) placed by momentum. time: (T,) s. phases: sampled at the same times.
        settings: defaults if None.

    Raises:
        InputError: frames, times and phases do not match, or a pose is not finite.
    """
    settings = settings or ContactSettings()
    _check(character, qpos, time, phases)
    pose = kinematics.forward(character.tree, qpos)
    feet, notes = _feet(character, pose, time, phases, settings)
    target = np.full((len(qpos), len(character.tied), 3), np.nan)
    if not feet:
        empty = np.zeros(target.shape[:2], dtype=bool)
        reason = "No contact point is planted at any time: the motion is as it was."
        return Contacted(qpos.copy(), empty, target, 0.0, 0.0, (), (reason,))
    moved = _carried(character, qpos, feet)
    if _off_track(character, moved, feet) > 1e-5:
        moved = _followed(character, moved, feet, settings)
    moved = _above_floor(character, moved, feet, settings)
    tracks = [foot.track for foot in feet]
    if settings.blend == "ballistic":
        moved = _thrown(character, moved, time, _grounded(character, phases, tracks), settings)
    moved = continuous_qpos(character, moved)
    for foot in feet:
        target[:, foot.sole.points] = foot.track.target
    return _measured(character, moved, time, feet, target, notes)


def _check(character: Character, qpos: Floats, time: Floats, phases: Phases) -> None:
    if not (len(qpos) == len(time) == len(phases.time)):
        raise InputError(
            f"the clip has {len(qpos)} frames, {len(time)} times and {len(phases.time)} frames "
            "of contact phases; all must be equal."
        )
    broken = ~np.isfinite(qpos).all(axis=1)
    if broken.any():
        raise InputError(f"{character.name}'s pose is not finite.", frame=int(np.argmax(broken)))


def _feet(
    character: Character,
    pose: kinematics.Pose,
    time: Floats,
    phases: Phases,
    settings: ContactSettings,
) -> tuple[list[_Foot], list[str]]:
    """The bodies that stand at some time, with the path that each shall take."""
    standing = kinematics.forward(character.tree, character.reference_qpos[None])
    found: list[tuple[Sole, SoleMotion, Bools, list[Footing], Track]] = []
    notes: list[str] = []
    tied = np.array([point is not None for point in character.tied], dtype=bool)
    for body in np.unique(character.contacts.body[tied]):
        index = np.flatnonzero((character.contacts.body == body) & tied)
        names = [str(character.tied[i]) for i in index]
        active = np.stack([phases.of(name) for name in names], axis=1)
        if not active.any():
            continue
        sole = make_sole(
            int(body),
            index,
            character.contacts.local[index],
            tuple(_side(name) for name in names),
            standing.rotation[0, body],
        )
        motion = sole_motion(sole, pose)
        heading = motion.yaw if len(index) > 1 else np.zeros(len(time))
        place = np.concatenate([motion.centre[:, :2], heading[:, None]], axis=1)
        footings, remarks = find_footings(sole, active, place, time, character.height, settings)
        notes += [f"{character.model.body(int(body)).name}: {remark}" for remark in remarks]
        floor = character.floor_height
        track = stand(sole, motion, footings, active, time, floor, settings)
        found.append((sole, motion, active, footings, track))
    grounded = _grounded(character, phases, [track for *_, track in found])
    return [
        _Foot(
            sole,
            motion,
            active,
            footings,
            fly(
                sole,
                motion,
                track,
                footings,
                grounded,
                time,
                character.floor_height,
                character.height,
                settings,
            ),
        )
        for sole, motion, active, footings, track in found
    ], notes


def _side(name: str) -> str:
    return name.split("_")[0] if name.startswith(("left_", "right_")) else name


def _carried(character: Character, qpos: Floats, feet: list[_Foot]) -> Floats:
    """The root corrected so that the feet are where they shall be, on the average.

    If the root itself is the body that stands on a face, its path is exact and nothing else
    has to move: the whole pose is carried along.
    """
    if not character.has_root:
        return qpos.copy()
    at = character.root_qpos
    moved = qpos.copy()
    own = [f for f in feet if f.sole.body == character.root_body and len(f.sole.local) > 2]
    if own:
        rotation, sole = own[0].track.rotation, own[0].sole
        moved[:, at : at + 3] = own[0].track.centre - rotation @ sole.centre
        moved[:, at + 3 : at + 7] = kinematics.matrix_to_quat(rotation)
        return moved
    # Feet count the more, the nearer in time they stand: the average stays continuous.
    weight = np.stack([1.0 / (1.0 + (f.track.away / 0.2) ** 2) for f in feet])
    weight += 1e-6
    weight /= weight.sum(axis=0)
    before = np.einsum("ft,ftc->tc", weight, np.stack([f.motion.centre for f in feet]))
    after = np.einsum("ft,ftc->tc", weight, np.stack([f.track.centre for f in feet]))
    turn = yaw_quat(np.einsum("ft,ft->t", weight, np.stack([_yaw_shift(f) for f in feet])))
    arm = qpos[:, at : at + 3] - before
    moved[:, at : at + 3] = after + kinematics.quat_rotate(turn, arm)
    moved[:, at + 3 : at + 7] = kinematics.quat_multiply(turn, qpos[:, at + 3 : at + 7])
    return moved


def _yaw_shift(foot: _Foot) -> Floats:
    """(T,) by how much a foot's heading is corrected, continuous."""
    if len(foot.sole.local) < 2:
        return np.zeros(len(foot.motion.yaw))
    change = foot.track.rotation @ np.swapaxes(foot.motion.rotation, 1, 2)
    quat = kinematics.continuous(kinematics.matrix_to_quat(change))
    shift: Floats = np.unwrap(2.0 * np.arctan2(quat[:, 3], quat[:, 0]))
    shift -= 2.0 * np.pi * np.round(shift[0] / (2.0 * np.pi))
    return shift


def _off_track(character: Character, qpos: Floats, feet: list[_Foot]) -> float:
    """The farthest that a point of any path is missed, m."""
    pose = kinematics.forward(character.tree, qpos)
    return max(
        float(np.abs(_points(pose, foot.sole) - foot.track.points(foot.sole)).max())
        for foot in feet
    )


def _points(pose: kinematics.Pose, sole: Sole) -> Floats:
    bodies = np.full(len(sole.local), sole.body)
    return kinematics.points(pose, bodies, sole.local)


def _followed(
    character: Character,
    qpos: Floats,
    feet: list[_Foot],
    settings: ContactSettings,
    *,
    frames: Ints | None = None,
    lifted: PointTargets | None = None,
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
    if lifted is not None:
        targets.append(lifted)
    # Joints that the points leave undetermined (the twist of a straight leg) stay put.
    prior = np.full(character.tree.nv, settings.joint_weight * character.height**2)
    if character.has_root:
        prior[character.root_dof : character.root_dof + 6] = 0.0
    found = kinematics.solve(
        character.tree,
        qpos,
        targets,
        lower=character.lower,
        upper=character.upper,
        prior_weight=prior,
        iterations=20,
        tolerance=1e-4,
    )
    return found.qpos


def _above_floor(
    character: Character, qpos: Floats, feet: list[_Foot], settings: ContactSettings
) -> Floats:
    """Lift what is carried below the floor onto it; frames with nothing below stay as they are.

    A body is lifted as a whole by the depth of its lowest point, as far as it is deeper than in
    the reference pose. That moves its neighbours: a few rounds.
    """
    stood_on = [foot.sole.body for foot in feet]
    body, local = surface_points(character, np.setdiff1d(character.bodies, stood_on))
    slack = FLOOR_SLACK + _depth(character, character.reference_qpos[None], body, local)[0]
    share = np.array([settings.clearance_weight / (body == one).sum() for one in body])
    moved = qpos.copy()
    frames = np.arange(len(qpos))
    for _ in range(4):
        depth = _depth(character, moved[frames], body, local)
        low = (depth > slack).any(axis=1)
        frames = frames[low]
        if not len(frames):
            break
        depth = np.where(depth[low] > slack, depth[low] - slack, np.nan)
        target = kinematics.points(kinematics.forward(character.tree, moved[frames]), body, local)
        target[..., 2] += depth
        lift = PointTargets(body, local, target, share)
        moved[frames] = _followed(
            character, moved[frames], feet, settings, frames=frames, lifted=lift
        )
    return moved


def _depth(character: Character, qpos: Floats, body: Ints, local: Floats) -> Floats:
    """(T, K) for each point how deep the lowest point of its body is below the floor, m."""
    where = kinematics.points(kinematics.forward(character.tree, qpos), body, local)
    depth = np.zeros(where.shape[:2])
    for one in np.unique(body):
        mine = body == one
        below = character.floor_height - where[:, mine, 2].min(axis=1, keepdims=True)
        depth[:, mine] = np.maximum(below, 0.0)
    return depth


def _grounded(character: Character, phases: Phases, tracks: list[Track]) -> Bools:
    """(T,) whether anything bears the character, or the actor.

    Hands or back that the character has no counterpart of bear the actor as well.
    """
    others = [name not in character.tied for name in phases.names]
    grounded = any_point(phases.active[:, others])
    for track in tracks:
        grounded |= track.standing
    return grounded


def _thrown(
    character: Character, qpos: Floats, time: Floats, grounded: Bools, settings: ContactSettings
) -> Floats:
    """Flights in which the centre of mass moves straight on, as seen from above.

    Whatever the limbs do in the air, only the floor could push the whole sideways. The root
    is shifted; where a flight begins and ends nothing changes.
    """
    if not character.has_root:
        return qpos
    moved, at = qpos.copy(), character.root_qpos
    mass = np.array(character.model.body_mass)[character.bodies]
    local = np.array(character.model.body_ipos)[character.bodies]
    for first, last in runs(~grounded):
        before, after = first - 1, last + 1
        if before < 0 or after >= len(qpos):
            continue
        if time[after] - time[before] > settings.longest_flight:
            continue
        pose = kinematics.forward(character.tree, qpos[before : after + 1])
        centres = kinematics.points(pose, character.bodies, local)[..., :2]
        centre = np.einsum("b,tbc->tc", mass / mass.sum(), centres)
        share = (time[before : after + 1] - time[before]) / (time[after] - time[before])
        straight = centre[0] + share[:, None] * (centre[-1] - centre[0])
        moved[before : after + 1, at : at + 2] += straight - centre
    return moved


def _measured(
    character: Character,
    qpos: Floats,
    time: Floats,
    feet: list[_Foot],
    target: Floats,
    notes: list[str],
) -> Contacted:
    """What the final poses do: which points really stand, how far they slide and sink."""
    pose = kinematics.forward(character.tree, qpos)
    floor = character.floor_height
    active = np.zeros(target.shape[:2], dtype=bool)
    slide, sink = 0.0, 0.0
    stances: list[Stance] = []
    for foot in feet:
        index = foot.sole.points
        points = _points(pose, foot.sole)
        miss = np.linalg.norm(points - foot.track.target, axis=-1)  # NaN in flight
        touching = np.nan_to_num(miss, nan=np.inf) < TOUCHING
        planted = touching & foot.track.planted
        active[:, index] = planted | _long_enough(touching & ~planted, time)
        for footing in foot.footings:
            part = slice(footing.first, footing.last + 1)
            on = active[part, :][:, index]
            for k in np.flatnonzero(on.any(axis=0)):
                held = points[part, k][on[:, k]]
                slide = max(slide, float(np.linalg.norm(np.ptp(held[:, :2], axis=0))))
                sink = max(sink, float(np.max(floor - held[:, 2])))
            stances.append(_stance(character, foot, footing, time))
        missed = float((foot.track.planted & ~touching).sum() / max(foot.track.planted.sum(), 1))
        if missed > 0:
            name = character.model.body(foot.sole.body).name
            notes.append(f"{name}: {missed:.1%} of its planted points are out of reach.")
    stances.sort(key=lambda s: (s.first, s.body))
    return Contacted(qpos, active, target, slide, sink, tuple(stances), tuple(notes))


def _long_enough(touching: Bools, time: Floats) -> Bools:
    kept = np.zeros_like(touching)
    for k in range(touching.shape[1]):
        for first, last in runs(touching[:, k]):
            if time[last] - time[first] >= SHORTEST_TOUCH:
                kept[first : last + 1, k] = True
    return kept


def _stance(character: Character, foot: _Foot, footing: Footing, time: Floats) -> Stance:
    bore = foot.track.planted[footing.first : footing.last + 1].any(axis=0)
    return Stance(
        body=character.model.body(foot.sole.body).name,
        points=tuple(character.contacts.names[i] for i in foot.sole.points[bore]),
        first=footing.first,
        last=footing.last,
        start=float(time[footing.first]),
        end=float(time[footing.last]),
        position=footing.place[:2].copy(),
        yaw=float(footing.place[2]),
        hop=footing.hop,
    )
