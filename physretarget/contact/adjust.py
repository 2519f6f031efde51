"""Contact adjustment: planted points stay where they are (Yamane 2010, section 5.2)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.contact.carry import carried, followed, mean_shift, off_track
from physretarget.contact.clearance import above_floor, on_the_floor
from physretarget.contact.flight import grounded, throw_arc, thrown
from physretarget.contact.foot import Foot
from physretarget.contact.leg import stride_limit
from physretarget.contact.order import legs_in_turn
from physretarget.contact.phases import Phases
from physretarget.contact.reach import within_reach
from physretarget.contact.settings import ContactSettings
from physretarget.contact.sole import Sole, SoleMotion, sole_motion
from physretarget.contact.soles import sole_of, standing_bodies, turning_limit
from physretarget.contact.stances import Footing, find_footings
from physretarget.contact.track import fly, stand
from physretarget.errors import InputError
from physretarget.ik import continuous_qpos
from physretarget.kinematics import runs
from physretarget.mjcf import Character

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

TOUCHING = 1e-3
"""A point this near to its place on the floor (m) counts as planted, whoever bears the body."""
SHORTEST_TOUCH = 0.05
"""Shorter touches of points that bear nothing by the timetable are not reported (s), except where
the body lands or leaves the floor."""


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

    Returns:
        The moved clip, its stances and which points stand.

    Raises:
        InputError: frames, times and phases do not match, or a pose is not finite.
    """
    settings = settings or ContactSettings()
    _check(character, qpos, time, phases)
    phases = legs_in_turn(character, phases)
    pose = kinematics.forward(character.tree, qpos)
    feet, notes = _feet(character, pose, time, phases, settings)
    target = np.full((len(qpos), len(character.tied), 3), np.nan)
    if not feet:
        empty = np.zeros(target.shape[:2], dtype=bool)
        reason = "No contact point is planted at any time: the motion is as it was."
        return Contacted(qpos.copy(), empty, target, 0.0, 0.0, (), (reason,))
    moved = carried(character, qpos, time, feet, settings)
    if off_track(character, moved, feet) > 1e-5:
        moved, feet = _reached(character, qpos, moved, time, phases, feet, settings, notes)
    moved = above_floor(character, moved, time, feet, settings)
    moved = on_the_floor(character, moved, time, feet, settings)
    tracks = [foot.track for foot in feet]
    if settings.blend == "ballistic":
        moved = thrown(character, moved, time, grounded(character, phases, tracks), settings)
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
) -> tuple[list[Foot], list[str]]:
    """The bodies that stand at some time, with the path that each shall take.

    Where legs carry a trunk, first as if they could hold any place on which they stand: that says
    where the trunk goes. Then stances are cut where it takes a foot beyond its reach.
    """
    standing, notes = _planted(character, pose, time, phases, settings, None)
    feet = _flown(character, standing, time, phases, settings)
    if feet and not any(foot.sole.body == character.root_body for foot in feet):
        way = mean_shift(feet)[:, :2]
        standing, notes = _planted(character, pose, time, phases, settings, way)
        feet = _flown(character, standing, time, phases, settings)
    return feet, notes


def _planted(
    character: Character,
    pose: kinematics.Pose,
    time: Floats,
    phases: Phases,
    settings: ContactSettings,
    way: Floats | None,
) -> tuple[list[Foot], list[str]]:
    """The bodies that stand on their places, not flying yet; ``way`` (T, 2) moves the trunk."""
    found: list[Foot] = []
    notes: list[str] = []
    soles = [sole_of(character, body) for body in standing_bodies(character).tolist()]
    actives = [
        np.stack([phases.of(character.tied[i]) for i in sole.points], axis=1) for sole in soles
    ]
    stands = np.stack([active.any(axis=1) for active in actives]) if soles else np.zeros((0, 0))
    for number, (sole, active) in enumerate(zip(soles, actives, strict=True)):
        if not active.any():
            continue
        body, others = sole.body, np.delete(stands, number, axis=0)
        motion = sole_motion(sole, pose)
        reach = stride_limit(character, sole, settings)
        footings, remarks = find_footings(
            sole,
            active,
            _place(sole, motion),
            time,
            character.height,
            turning_limit(character, body, settings),
            settings,
            off=None if way is None else (motion.centre[:, :2] + way) / reach,
            up=None if way is None or not len(others) else 1.0 - others.mean(axis=0),
        )
        notes += [f"{character.model.body(body).name}: {remark}" for remark in remarks]
        floor = character.floor_height
        track = stand(sole, motion, footings, active, time, floor, settings)
        stands[number] = track.away == 0.0
        found.append(Foot(sole, motion, active, footings, track))
    return found, notes


def _place(sole: Sole, motion: SoleMotion) -> Floats:
    """(T, 3) x, y and heading of a sole; a single point has no heading."""
    heading = motion.yaw if len(sole.local) > 1 else np.zeros(len(motion.yaw))
    return np.concatenate([motion.centre[:, :2], heading[:, None]], axis=1)


def _flown(
    character: Character,
    standing: list[Foot],
    time: Floats,
    phases: Phases,
    settings: ContactSettings,
) -> list[Foot]:
    """The same feet with their paths between the stances."""
    tracks = [foot.track for foot in standing]
    if not tracks:
        return []
    borne = grounded(character, phases, tracks)
    arc = throw_arc(borne, tracks, time, character.height, settings)
    floor, height = character.floor_height, character.height

    def flown(way: Floats | None) -> list[Foot]:
        return [
            replace(
                foot,
                track=fly(
                    foot.sole,
                    foot.motion,
                    foot.track,
                    foot.footings,
                    borne,
                    arc,
                    time,
                    floor,
                    height,
                    settings,
                    way=way,
                ),
            )
            for foot in standing
        ]

    feet = flown(None)
    if any(foot.sole.body == character.root_body for foot in feet):
        return feet
    way = mean_shift(feet)
    way[:, 2] = 0.0  # how high feet swing and are thrown is theirs
    return flown(way)


def _reached(
    character: Character,
    qpos: Floats,
    moved: Floats,
    time: Floats,
    phases: Phases,
    feet: list[Foot],
    settings: ContactSettings,
    notes: list[str],
) -> tuple[Floats, list[Foot]]:
    """Poses with the feet on their paths; stances too far apart for the legs become shorter.

    Of the poses ``qpos`` before the adjustment a shortened stance takes its place anew;
    ``moved`` are those with the root corrected. What was shortened is added to ``notes``.
    """
    cut = 0
    root = slice(character.root_qpos, character.root_qpos + 7 * character.has_root)
    step_s = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    solved, turned = followed(character, moved, feet, settings, step_s)
    for _ in range(settings.releases):
        pose = kinematics.forward(character.tree, solved)
        shorter, changed = _shortened(turned, pose, time, settings)
        if not changed:
            break
        cut += changed
        standing = [
            _standing(character, foot, footings, time, settings)
            for foot, footings in zip(feet, shorter, strict=True)
        ]
        feet = _flown(character, standing, time, phases, settings)
        moved = carried(character, qpos, time, feet, settings)
        start = np.concatenate([moved[:, root], solved[:, root.stop :]], axis=1)
        solved, turned = followed(character, moved, feet, settings, step_s, start=start)
    if cut:
        notes.append(f"Stances shortened where legs do not reach from one to the next: {cut}.")
    return solved, turned


def _shortened(
    feet: list[Foot], pose: kinematics.Pose, time: Floats, settings: ContactSettings
) -> tuple[list[list[Footing]], int]:
    """Stances that the legs reach, and how many changed: ends first, so that feet take turns."""
    for late in (True, False):
        shorter = [
            within_reach(
                foot,
                foot.points(pose),
                foot.undersides(pose),
                _place(foot.sole, foot.motion),
                time,
                settings,
                late=late,
            )
            for foot in feet
        ]
        changed = sum(
            len(set(foot.footings) - set(footings))
            for foot, footings in zip(feet, shorter, strict=True)
        )
        if changed:
            return shorter, changed
    return shorter, 0


def _standing(
    character: Character,
    foot: Foot,
    footings: list[Footing],
    time: Floats,
    settings: ContactSettings,
) -> Foot:
    """A foot with other stances, not flying yet."""
    track = stand(
        foot.sole, foot.motion, footings, foot.active, time, character.floor_height, settings
    )
    return replace(foot, footings=footings, track=track)


def _measured(
    character: Character,
    qpos: Floats,
    time: Floats,
    feet: list[Foot],
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
        points = foot.points(pose)
        miss = np.linalg.norm(points - foot.track.target, axis=-1)  # NaN in flight
        touching = np.nan_to_num(miss, nan=np.inf) < TOUCHING
        planted = touching & foot.track.planted
        blows = np.zeros(len(time), dtype=bool)
        blows[[frame for f in foot.footings for frame in (f.first, f.last)]] = True
        active[:, index] = planted | _lasting(touching & ~planted, blows, time)
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


def _lasting(touching: Bools, blows: Bools, time: Floats) -> Bools:
    """Touches (T, n) that last, or that take part in a landing or a push-off (T,)."""
    kept = np.zeros_like(touching)
    for k in range(touching.shape[1]):
        for first, last in runs(touching[:, k]):
            lasts = time[last] - time[first] >= SHORTEST_TOUCH
            if lasts or blows[first : last + 1].any():
                kept[first : last + 1, k] = True
    return kept


def _stance(character: Character, foot: Foot, footing: Footing, time: Floats) -> Stance:
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
