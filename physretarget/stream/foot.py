"""The path of one body that stands, frame by frame: planted, in flight, planted again.

The rules of the batch path (:mod:`physretarget.contact`), for a timetable that is known up to now
and foreseen from there on (:mod:`physretarget.stream.foresee`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from physretarget.contact.settings import ContactSettings
from physretarget.contact.sole import Sole
from physretarget.contact.stances import Footing, find_footings, hop_time
from physretarget.contact.track import lowest_rise, raised
from physretarget.stream.arc import Arc, Throw
from physretarget.stream.blend import Blend
from physretarget.stream.foresee import Course, Going, Habit, Sample, Seen
from physretarget.stream.stance import Members, Stance, Tread
from physretarget.stream.turns import (
    about,
    matrix_quat,
    quat_matrix,
    quat_product,
    quat_rotvec,
    turned,
    twist,
)

__all__ = ["Foot", "Path"]

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

START = 0.05
"""How long to look before the first stance is placed, s."""
FIRST = 0.2
"""The first stance's feet go to their places within so many s."""
LAND = 0.08
"""What is left of a flight's correction at touch-down is gone after so many s."""
CLOSING = 3.0
"""The time to the nearest stance changes at most so many times as fast as time itself."""
STRAYED = 0.2
"""A base that carries both feet takes a new place when it is so far off, in heights."""


@dataclass(frozen=True, eq=False)
class Path:
    """Where a sole shall be now.

    ``centre`` (3,), ``rotation`` (3, 3) of the body; ``shift`` (3,) from where the motion has it;
    ``away`` s to the nearest stance; ``prints`` (n, 3) where its points belong, None in flight;
    ``bearing`` (n,) those that bear.
    """

    centre: Array
    rotation: Array
    shift: Array
    yaw: float
    away: float
    prints: Array | None
    bearing: Bools

    def points(self, arms: Array) -> Array:
        """World places of points of the body, ``arms`` (K, 3) from the sole's centre."""
        result: Array = arms @ self.rotation.T
        result += self.centre
        return result


class Foot:
    """One sole between its motion and the floor."""

    def __init__(
        self, sole: Sole, habit: Habit, limit: float, floor: float, height: float,
        settings: ContactSettings, *, walks: bool,
    ) -> None:  # fmt: skip
        """``limit`` rad, how far the motion may turn over a stance; ``walks``: it is a foot."""
        self.sole, self.limit, self.floor, self.height = sole, limit, floor, height
        self.settings, self.walks = settings, walks
        self.whole = np.concatenate([sole.local, sole.under]) - sole.centre
        self.flat = np.ascontiguousarray(sole.flat.T)
        self.tread = Tread(sole, floor, settings)

        # What was seen and is foreseen, and the stances planned from it.
        self.seen = Seen(sole, height, habit)
        self.going: Going | None = None
        self.course: Course | None = None
        self.footings: list[Footing] = []

        # The present stance, None in flight, and when and from where that began.
        self.stance: Stance | None = None
        self.left: Footing | None = None
        self.left_at = -math.inf
        # Height and tilt that the motion had when the sole last touched down.
        self.touched: tuple[float, Array] | None = None
        # Stances out of reach, and one that takes another place from a frame on.
        self.given_up: Members = frozenset()
        self.strayed: tuple[Members, int] | None = None

        # The path up to now.
        self.blend = Blend(height, settings.gravity, None if walks else np.zeros(7))
        self.arc = Arc()
        self.away = math.inf
        self.before: Sample | None = None

    @property
    def used(self) -> bool:
        """Whether it counts: a hand only once the actor has set it down."""
        return self.walks or any(side.starts for side in self.seen.sides)

    @property
    def standing(self) -> bool:
        """Whether the sole is planted now."""
        return self.stance is not None

    def sample(self, time: float, place: Array, rotation: Array, active: Bools) -> Sample:
        """The sole of a body at ``place`` (3,)."""
        if not (self.used or active.any()):  # neither heading nor tilt matter yet
            return Sample(time, place, rotation, 0.0, np.zeros(3), active)
        quat = matrix_quat(rotation @ self.flat)
        yaw = twist(quat)
        if len(self.seen.samples):
            last = self.seen.samples[-1].yaw
            yaw = last + math.remainder(yaw - last, 2.0 * math.pi)
        tilt = np.array(quat_rotvec(quat_product(about(-yaw), quat)))
        centre = place + rotation @ self.sole.centre
        return Sample(time, centre, rotation, yaw, tilt, active, quat)

    def plan(self, going: Going) -> None:
        """Form stances anew from what is known and foreseen."""
        if not self.used:
            return
        self.going = going
        self.course = course = self.seen.course(going)
        self.footings = []
        if not course.active.any():
            return
        place = course.place
        if not self.tread.several:
            place = place * (1.0, 1.0, 0.0)
        found, _ = find_footings(
            self.sole, course.active, place, course.time, self.height, self.limit, self.settings
        )
        for each in found:
            middle = each.place
            if self.strayed is not None and self._members(each) & self.strayed[0]:
                rest = place[max(each.first, self.strayed[1] - course.first) : each.last + 1]
                middle = rest.mean(axis=0) if len(rest) else middle
            first, last = each.first + course.first, each.last + course.first
            self.footings.append(replace(each, first=first, last=last, place=middle))

    def decide(self, frame: int) -> None:
        """Stand or leave at a frame."""
        sample = self.seen[frame]
        if self.given_up and sample.time > self.left_at + self.settings.min_piece:
            self.given_up = frozenset()
        if self.stance is not None:
            self._stay_or_leave(self.stance, sample, frame)
        if self.stance is None and self._begun():
            here = self._at(frame)
            if here is not None and sample.time >= self._earliest(here):
                self._land(here, sample, frame)

    def _stay_or_leave(self, stance: Stance, sample: Sample, frame: int) -> None:
        assert self.course is not None
        here = target = self._at(frame)
        if target is None and sample.time - stance.since < self.settings.min_piece:
            target = self._next(frame)
        if target is None:
            self.leave(frame)
            return
        anew = target is not stance.footing
        if anew and not self._members(target) & stance.members:
            self.leave(frame)
        elif not self._strayed(stance, target, sample):
            if anew:
                stance.members |= self._members(target)
            if anew and here is not None:
                stance.bear(here, self.course)
        else:
            self.strayed = (stance.members, frame)
            self.leave(frame)
            if self.going is not None:
                self.plan(self.going)

    def _begun(self) -> bool:
        return self.seen.samples[-1].time >= self.seen.started + START

    def _strayed(self, stance: Stance, here: Footing, sample: Sample) -> bool:
        """Whether the stance's place is too far from where it should be by now."""
        if sample.time - stance.since < self.settings.min_piece:
            return False
        x, y, yaw = stance.place.tolist()
        away = math.hypot(here.place[0] - x, here.place[1] - y)
        turned_by = abs(sample.yaw - yaw) if self.tread.several else 0.0
        return turned_by > self.limit or (self.sole.two_sided and away > STRAYED * self.height)

    def leave(self, frame: int, *, out_of_reach: bool = False) -> None:
        """Take off, after the frame before; ``out_of_reach``: and stay away for a while."""
        if self.stance is None or self.before is None:
            return
        if out_of_reach:
            self.given_up = self.stance.members
            self.strayed = (self.stance.members, frame)
        self.left = replace(self.stance.footing, place=self.stance.place)
        self.left_at = self.before.time
        self.stance = None
        self.blend.leave()

    def _members(self, footing: Footing) -> Members:
        assert self.course is not None
        first = self.course.first
        return frozenset(
            (self.seen.began(member + first, side), side) for member, _, side in footing.members
        )

    def _at(self, frame: int) -> Footing | None:
        """The footing planned for a frame."""
        for footing in self.footings:
            if footing.first <= frame <= footing.last:
                return None if self._is_given_up(footing) else footing
        return None

    def _is_given_up(self, footing: Footing) -> bool:
        return bool(self.given_up) and bool(self._members(footing) & self.given_up)

    def _next(self, frame: int) -> Footing | None:
        """The footing that the flight goes to."""
        for footing in self.footings:
            if footing.last >= frame and not self._is_given_up(footing):
                return footing
        return None

    def comes_down(self, frame: int) -> float:
        """When the flight ends, as far as that can be foreseen, s; infinite if not at all."""
        target = self._next(frame)
        if target is None or self.course is None:
            return math.inf
        return self._touch_down(target, self.seen[frame].time)

    def _touch_down(self, target: Footing, now: float) -> float:
        """When a footing is reached, s."""
        return max(self._time(target.first), self._earliest(target), now)

    def _earliest(self, footing: Footing) -> float:
        """When a footing can be reached, s: a hop takes its time, but only a share of a stance."""
        if self.left is None:
            return -math.inf
        x, y, yaw = self.left.place.tolist()
        way = math.hypot(footing.place[0] - x, footing.place[1] - y)
        way += abs(float(footing.place[2]) - yaw) * self.sole.radius
        need = hop_time(self.sole, way, self.settings)
        latest = self._time(footing.first) + self.settings.hop_share * footing.length
        soonest = self.left_at + self.settings.min_flight
        return max(min(self.left_at + need, latest), soonest) - 1e-9

    def _time(self, frame: int) -> float:
        assert self.course is not None
        return float(self.course.time[max(frame - self.course.first, 0)])

    def _land(self, footing: Footing, sample: Sample, frame: int) -> None:
        """Begin a stance: from now on its place is fixed."""
        assert self.course is not None
        members = self._members(footing)
        self.stance = Stance(
            self.tread,
            footing,
            self.course,
            members,
            sample.time,
            hopped=self.left is not None,
        )
        self.touched = (float(sample.centre[2]), sample.tilt)
        centre, there, _ = self.stance.placed(sample, frame)
        self.blend.land(self.blend.between(sample, centre, there))

    def path(self, frame: int, throw: tuple[float, float] | None, *, linear: bool) -> Path:
        """Where the sole shall be at a frame.

        ``throw``: when the flight of the whole character began and will end, s; ``linear``:
        corrections go linearly in time, since nothing bears the character.
        """
        sample, stance = self.seen[frame], self.stance
        step = sample.time - self.before.time if self.before is not None else 0.0
        if stance is not None:
            bearing = self._stand(stance, sample, frame)
            arc, away, prints = self.arc.foresee(sample.time, ()), 0.0, stance.prints
        else:
            bearing, prints = np.zeros(len(self.sole.local), dtype=bool), None
            arc, away = self._fly(frame, sample, step, throw, linear)
        correction = self.blend.value
        assert correction is not None
        rotation = sample.rotation
        if self.tread.several:
            rotation = quat_matrix(self.blend.turn()) @ sample.rotation
        centre = sample.centre + correction[:3]
        centre[2] += self._lift(centre, rotation, self.arc.eased(arc, step))
        self._close_in(away, step)
        self.before = sample
        shift = centre - sample.centre
        return Path(centre, rotation, shift, float(correction[3]), self.away, prints, bearing)

    def _stand(self, stance: Stance, sample: Sample, frame: int) -> Bools:
        """Blend into the stance's place; the points that bear."""
        centre, there, bearing = stance.placed(sample, frame)
        goal = self.blend.between(sample, centre, there)
        self.blend.stand(goal, sample.time - stance.since, LAND if self.left else FIRST)
        return bearing

    def _fly(
        self, frame: int, sample: Sample, step: float, throw: tuple[float, float] | None,
        linear: bool,
    ) -> tuple[float, float]:  # fmt: skip
        """Blend towards the next place; height over the floor and time to the nearest stance."""
        time, target = sample.time, self._next(frame)
        if target is None:
            self.blend.stay()
            return 0.0, math.inf
        goal = self._goal(target, sample)
        down = self._touch_down(target, time)
        if self.blend.value is None:
            self.blend.value = goal
            return 0.0, down - time
        if not self._begun():
            return 0.0, down - time
        self.blend.approach(goal, step, down - (time - step), linear=linear)
        arc = self.arc.foresee(time, self._throws(down, target, throw))
        return arc, min(time - self.left_at, down - time)

    def _throws(
        self, down: float, target: Footing, throw: tuple[float, float] | None
    ) -> tuple[Throw, ...]:
        """The sole's own flight to its next place, and that of the whole character."""
        if self.left is None:
            return ()
        rise = lowest_rise(self.left, target, down - self.left_at, self.height, self.settings)
        own = Throw(self.left_at, down, rise)
        if throw is None:
            return (own,)
        rise = self.settings.gravity * (throw[1] - throw[0]) ** 2 / 8.0
        return own, Throw(*throw, min(rise, self.settings.hop_height * self.height))

    def _lift(self, centre: Array, rotation: Array, arc: float) -> float:
        """How much higher the sole must be to be above the floor, and in flight on its arc, m."""
        low = float((self.whole @ rotation[2]).min() + centre[2] - self.floor)
        if self.stance is None:
            return float(raised(low, arc) - low)
        return max(-low, 0.0) + max(arc - max(low, 0.0), 0.0)

    def _close_in(self, away: float, step: float) -> None:
        """The time to the nearest stance does not leap when it is foreseen otherwise."""
        change = CLOSING * step if self.before is not None else math.inf
        self.away = min(max(away, self.away - change), self.away + change)
        if not math.isfinite(self.away):
            self.away = away

    def _goal(self, target: Footing, sample: Sample) -> Array:
        """The correction (7,) at touch-down as foreseen."""
        course = self.course
        assert course is not None
        landing = course.place[target.first - course.first]
        goal = np.zeros(7)
        goal[:2] = target.place[:2] - landing[:2]
        goal[3] = target.place[2] - landing[2] if self.tread.several else 0.0
        if target.first < self.seen.end:  # known already
            then = self.seen[target.first]
            height, tilt = float(then.centre[2]), then.tilt
        else:
            height, tilt = self.touched or (self.tread.level, np.zeros(3))
        goal[2] = self.tread.level - height
        if self.tread.several:
            goal[4:] = -turned(tilt, float(target.place[2]))
        return goal
