"""From the timetable of one body's points to its stances: where it stands, and how long.

A body that carries points of both feet cannot stand in two places at once. Stances of the
two feet that overlap are either one stance (the actor stands) or, when they are meant for
different places (the actor walks), separated by a short hop.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from physretarget.contact.phases import any_point
from physretarget.contact.settings import ContactSettings
from physretarget.contact.sole import Sole
from physretarget.contact.turns import cuts
from physretarget.kinematics import runs

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Footing:
    """One stance of one body: frames ``first`` to ``last`` at one rigid place.

    ``place`` (3,) x, y (m) and heading (rad) of the sole's centre; ``members`` (first, last,
    side) of the foot's phases that it is made of; ``length`` its duration before any hop was
    cut out of it, s; ``hop`` True if the flight before it was made or lengthened.
    """

    first: int
    last: int
    place: Floats
    members: tuple[tuple[int, int, str], ...]
    length: float
    hop: bool = False

    def planted(self, sole: Sole, active: Bools) -> Bools:
        """(last-first+1, n) the points that bear the body; never none.

        A frame without any, in a pause too short to be a flight, keeps those of before.
        """
        part = active[self.first : self.last + 1]
        mine = np.zeros_like(part)
        for first, last, side in self.members:
            rows = slice(max(first - self.first, 0), max(last - self.first + 1, 0))
            mine[rows] |= part[rows] & np.array([s == side for s in sole.sides])
        known = np.flatnonzero(mine.any(axis=1))
        latest = np.searchsorted(known, np.arange(len(mine)), side="right") - 1
        return mine[known[np.maximum(latest, 0)]]


def find_footings(
    sole: Sole,
    active: Bools,
    place: Floats,
    time: Floats,
    height: float,
    limit: float,
    settings: ContactSettings,
    *,
    off: Floats | None = None,
    up: Floats | None = None,
) -> tuple[list[Footing], list[str]]:
    """The stances of a body, in order and apart from each other, and notes on what was cut.

    ``active`` (T, n) the timetable of its points; ``place`` (T, 3) x, y and heading of the
    sole before the adjustment; ``height`` of the character, m; ``limit`` how far the heading
    may be from its mean over a stance, rad; ``off`` (T, 2) x and y of the sole on a trunk that goes
    where its feet take it, over the leg's reach; ``up`` (T,) the share of the other bodies that
    are in the air.
    """
    phases: list[tuple[int, int, str]] = []
    for side in dict.fromkeys(sole.sides):
        mine = np.array([s == side for s in sole.sides])
        phases += [(*run, side) for run in runs(any_point(active[:, mine]))]
    merged: list[Footing] = []
    for first, last, side in sorted(phases, key=lambda p: (p[0], -p[1], p[2])):
        new = _footing(first, last, ((first, last, side),), place, time)
        if merged and _together(sole, merged[-1], new, time, height, settings):
            old = merged.pop()
            new = _footing(
                old.first, max(old.last, last), (*old.members, *new.members), place, time
            )
        merged.append(new)
    pieces = [p for whole in merged for p in _turning(whole, place, time, limit, settings, off, up)]
    footings, notes = _apart(sole, pieces, time, height, settings)
    if len(pieces) > len(merged):
        notes.append(
            f"Stances cut because the motion turns or goes on: {len(pieces) - len(merged)}."
        )
    return footings, notes


def _turning(
    whole: Footing,
    place: Floats,
    time: Floats,
    limit: float,
    settings: ContactSettings,
    off: Floats | None,
    up: Floats | None,
) -> list[Footing]:
    """A stance in as many pieces as one place and heading each suffices for."""
    inside = slice(whole.first, whole.last + 1)
    edges = [edge for first, last, _ in whole.members for edge in (first, last)]
    steps = time[[edge for edge in edges if whole.first < edge < whole.last]]
    there = None if off is None else off[inside]
    others = None if up is None else up[inside]
    heading = place[inside, 2]
    at = whole.first + cuts(heading, time[inside], limit, steps, settings, off=there, up=others)
    if not len(at):
        return [whole]
    pieces = []
    for first, after in pairwise([whole.first, *at.tolist(), whole.last + 1]):
        members = tuple(
            (max(a, first), min(b, after - 1), side)
            for a, b, side in whole.members
            if a < after and b >= first
        )
        pieces.append(_footing(first, after - 1, members, place, time))
    return pieces


def _footing(
    first: int, last: int, members: tuple[tuple[int, int, str], ...], place: Floats, time: Floats
) -> Footing:
    mean = place[first : last + 1].mean(axis=0)  # Yamane 2010, 5.2: the mean over the phase
    return Footing(first, last, mean, members, float(time[last] - time[first]))


def _together(
    sole: Sole, old: Footing, new: Footing, time: Floats, height: float, settings: ContactSettings
) -> bool:
    """Whether two consecutive stances share one rigid target."""
    if new.last <= old.last:
        return True  # the body cannot leave while its other side stays planted
    pause = float(time[new.first] - time[old.last])
    shorter = max(min(old.length, new.length), 1e-9)
    if -pause > settings.shared * shorter:
        return True
    near = _travel(sole, old, new)[0] < settings.same_place * height
    turned = abs(new.place[2] - old.place[2]) < settings.same_heading
    return pause < settings.min_flight and near and turned


def _travel(sole: Sole, old: Footing, new: Footing) -> tuple[float, float]:
    """Distance between two places, m, and the same with the arc of a turn added."""
    distance = float(np.linalg.norm(new.place[:2] - old.place[:2]))
    return distance, distance + abs(float(new.place[2] - old.place[2])) * sole.radius


def _apart(
    sole: Sole, footings: list[Footing], time: Floats, height: float, settings: ContactSettings
) -> tuple[list[Footing], list[str]]:
    """Leave enough time between consecutive stances to get from one place to the next."""
    kept: list[Footing] = []
    dropped, hops = 0, 0
    for new in footings:
        current: Footing | None = new
        while kept and current is not None:
            pair = _separated(sole, kept[-1], current, time, height, settings)
            if pair is not None:
                kept[-1], current = pair
                break
            dropped += 1
            if current.length <= kept[-1].length:
                current = None
            else:
                kept.pop()
        if current is not None:
            hops += current.hop
            kept.append(current)
    notes = []
    if hops:
        notes.append(f"Hops made or lengthened between stances at different places: {hops}.")
    if dropped:
        notes.append(f"Stances dropped, too short or too far to be reached: {dropped}.")
    return kept, notes


def hop_time(sole: Sole, travel: float, settings: ContactSettings) -> float:
    """How long a hop over a distance takes at least, s: that of the flattest throw allowed."""
    slope = math.tan(settings.hop_angle)
    if sole.two_sided:
        steep = 1.0 / max(settings.grip * sole.friction, 1e-9)
        slope = max(slope, min(steep, settings.steepest))
    return math.sqrt(2.0 * travel * slope / settings.gravity)


def _spared(stance: Footing, settings: ContactSettings, *, cut: bool) -> float:
    """How much of a stance may be given up to a hop, s.

    Of one that the clip's first or last frame cuts off nobody knows how long it lasted.
    """
    return stance.length if cut else settings.hop_share * stance.length


def _separated(
    sole: Sole, old: Footing, new: Footing, time: Floats, height: float, settings: ContactSettings
) -> tuple[Footing, Footing] | None:
    """Both stances with a long enough flight between them, or None if there is no room."""
    travel = _travel(sole, old, new)[1]
    need = max(hop_time(sole, travel, settings), settings.min_flight)
    flight = float(time[new.first] - time[old.last])
    if flight >= need:
        return old, new
    middle = 0.5 * float(time[old.last] + time[new.first])
    early = _spared(old, settings, cut=old.first == 0)
    late = _spared(new, settings, cut=new.last == len(time) - 1)
    until = max(middle - 0.5 * need, float(time[old.last]) - early)
    since = min(middle + 0.5 * need, float(time[new.first]) + late)
    tiny = 1e-9
    last = min(int(np.searchsorted(time, until - tiny)), old.last)
    first = max(int(np.searchsorted(time, since + tiny, side="right")) - 1, new.first)
    if last < old.first or first > new.last or first - last < 2:
        return None
    speed = travel / float(time[first] - time[last])
    if speed > settings.max_speed * math.sqrt(settings.gravity * height):
        return None
    return replace(old, last=last), replace(new, first=first, hop=True)
