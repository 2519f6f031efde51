"""The path of one body that stands, frame by frame: planted, in flight, planted again.

As in the batch path (:mod:`physretarget.contact.track`) what is blended is the correction of the
body's rigid placement, by eq. (9) of Yamane 2010. Where the next stance will be is only foreseen:
in every frame the cubic begins anew, from where the correction is and how fast it goes. As long as
what is foreseen stays the same, that is the same cubic.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from physretarget.contact.settings import ContactSettings
from physretarget.contact.sole import Sole, TiltCone
from physretarget.contact.stances import Footing, find_footings
from physretarget.contact.track import lowest_rise, raised, waddle
from physretarget.stream.foresee import Course, Going, Habit, Sample, Seen

__all__ = ["Foot", "Path"]

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Quat = tuple[float, float, float, float]

START = 0.05
"""How long to look before the first stance is placed, s."""
FIRST = 0.2
"""The first stance's feet go to their places within so many s."""
LAND = 0.08
"""What is left of a flight's correction at touch-down is gone after so many s."""
CLOSING = 3.0
"""The time to the nearest stance changes at most so many times as fast as time itself."""
FASTEST = 1.2
"""Corrections change no faster than this times sqrt(g · height)."""
STRAYED = 0.2
"""A base that carries both feet takes a new place when it is so far off, in heights."""
SEAM = 0.06
"""Time constant with which the height follows a flight that is foreseen otherwise now, s."""


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


@dataclass(frozen=True)
class _Throw:
    """A parabola in time, ``rise`` m high."""

    start: float
    end: float
    rise: float

    def at(self, time: float) -> float:
        share = min(max((time - self.start) / max(self.end - self.start, 1e-9), 0.0), 1.0)
        return 4.0 * self.rise * share * (1.0 - share)


@dataclass(eq=False)
class _Stance:
    """One that has begun: it keeps its place. ``members`` name the phases it is made of."""

    footing: Footing
    members: frozenset[tuple[int, str]]
    place: Array
    prints: Array
    since: float
    bearing: Bools
    spread: Bools
    roll: Array


class Foot:
    """One sole between its motion and the floor."""

    def __init__(
        self, sole: Sole, habit: Habit, limit: float, floor: float, height: float,
        settings: ContactSettings, *, walks: bool,
    ) -> None:  # fmt: skip
        """``limit`` rad, how far the motion may turn over a stance; ``walks``: it is a foot."""
        self.walks = walks
        self.sole, self.limit, self.floor, self.height = sole, limit, floor, height
        self.settings = settings
        self.seen = Seen(sole, height, habit)
        self.course: Course | None = None
        self.footings: list[Footing] = []
        self.cones: dict[bytes, TiltCone] = {}
        self.stance: _Stance | None = None
        self.given_up: frozenset[tuple[int, str]] = frozenset()
        self.strayed: tuple[frozenset[tuple[int, str]], int] | None = None
        self.going: Going | None = None
        self.left: Footing | None = None
        self.left_at = -math.inf
        self.correction: Array | None = None if walks else np.zeros(7)
        self.rate = np.zeros(7)
        self.residual = np.zeros(7)
        self.tilts: deque[tuple[float, Array]] = deque()
        # Height and tilt that the motion had when the sole last touched down.
        self.touched: tuple[float, Array] | None = None
        self.away = math.inf
        self.throw: tuple[_Throw, ...] = ()
        self.arc_residual = 0.0
        self.before: Sample | None = None
        self.whole = np.concatenate([sole.local, sole.under]) - sole.centre
        self.flat = np.ascontiguousarray(sole.flat.T)
        self.arms = sole.local - sole.centre
        self.several = len(sole.local) > 1
        self.level = floor - float(sole.foot[:, 2].min())

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
        quat = _matrix_quat(rotation @ self.flat)
        yaw = 2.0 * math.atan2(quat[3], quat[0])
        if len(self.seen.samples):
            last = self.seen.samples[-1].yaw
            yaw = last + math.remainder(yaw - last, 2.0 * math.pi)
        tilt = np.array(_quat_rotvec(_quat_product(_about(-yaw), quat)))
        centre = place + rotation @ self.sole.centre
        return Sample(time, centre, rotation, yaw, tilt, active, quat)

    def plan(self, going: Going) -> None:
        """Form stances anew from what is known and foreseen."""
        if not self.used:
            return
        self.going = going
        self.course = course = self.seen.course(going)
        if not course.active.any():
            self.footings = []
            return
        place = course.place
        if len(self.sole.local) < 2:
            place = place * (1.0, 1.0, 0.0)
        found, _ = find_footings(
            self.sole, course.active, place, course.time, self.height, self.limit, self.settings
        )
        self.footings = []
        for each in found:
            if self.strayed is not None and self._members(each) & self.strayed[0]:
                rest = place[max(each.first, self.strayed[1] - course.first) : each.last + 1]
                each = replace(each, place=rest.mean(axis=0) if len(rest) else each.place)
            first, last = each.first + course.first, each.last + course.first
            members, length = each.members, each.length
            self.footings.append(Footing(first, last, each.place, members, length, each.hop))

    def decide(self, frame: int) -> None:
        """Stand or leave at a frame."""
        sample = self.seen[frame]
        if self.given_up and sample.time > self.left_at + self.settings.min_piece:
            self.given_up = frozenset()
        here = self._at(frame)
        if self.stance is not None:
            lasted = sample.time - self.stance.since
            going_on = here or (self._next(frame) if lasted < self.settings.min_piece else None)
            if going_on is self.stance.footing:
                same = True
            else:
                same = going_on is not None and bool(self._members(going_on) & self.stance.members)
            if going_on is not None and same and not self._strayed(going_on, sample):
                if going_on is not self.stance.footing:
                    self.stance.members |= self._members(going_on)
                if here is not None and here is not self.stance.footing:
                    self._bear(here)
            else:
                if same:
                    self.strayed = (self.stance.members, frame)
                self.leave(frame)
                if same and self.going is not None:
                    self.plan(self.going)
                    here = self._at(frame)
        ready = here is not None and self._begun() and sample.time >= self._earliest(here)
        if self.stance is None and here is not None and ready:
            self._land(here, frame)

    def _begun(self) -> bool:
        return self.seen.samples[-1].time >= self.seen.started + START

    def _strayed(self, here: Footing, sample: Sample) -> bool:
        """Whether the stance's place is too far from where it should be by now."""
        assert self.stance is not None
        if sample.time - self.stance.since < self.settings.min_piece:
            return False
        x, y, yaw = self.stance.place.tolist()
        away = math.hypot(here.place[0] - x, here.place[1] - y)
        turned = abs(sample.yaw - yaw) if self.several else 0.0
        return turned > self.limit or (self.sole.two_sided and away > STRAYED * self.height)

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
        self.rate = np.zeros(7)
        self.tilts.clear()

    def _members(self, footing: Footing) -> frozenset[tuple[int, str]]:
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
        down = self._time(target.first)
        return max(down, self._earliest(target), self.seen[frame].time)

    def _earliest(self, footing: Footing) -> float:
        """When a footing can be reached, s: a hop takes its time, but only a share of a stance."""
        if self.left is None:
            return -math.inf
        x, y, yaw = self.left.place.tolist()
        way = math.hypot(footing.place[0] - x, footing.place[1] - y)
        way += abs(float(footing.place[2]) - yaw) * self.sole.radius
        need = math.sqrt(2.0 * way * math.tan(self.settings.hop_angle) / self.settings.gravity)
        latest = self._time(footing.first) + self.settings.hop_share * footing.length
        soonest = self.left_at + self.settings.min_flight
        return max(min(self.left_at + need, latest), soonest) - 1e-9

    def _time(self, frame: int) -> float:
        assert self.course is not None
        return float(self.course.time[max(frame - self.course.first, 0)])

    def _land(self, footing: Footing, frame: int) -> None:
        """Begin a stance: from now on its place is fixed."""
        sample = self.seen[frame]
        turn = _quat_matrix(_about(float(footing.place[2])))
        prints = np.append(footing.place[:2], self.level) + self.sole.foot @ turn.T
        none = np.zeros((0, len(self.sole.local)), dtype=bool)
        self.stance = _Stance(
            footing, self._members(footing), footing.place.copy(), prints, sample.time,
            none, none, np.zeros((0, 3)),
        )  # fmt: skip
        self._bear(footing)
        self.touched = (float(sample.centre[2]), sample.tilt)
        goal = self._standing(sample, frame)[0]
        self.residual = np.zeros(7)
        if self.correction is not None:
            self.residual = self.correction - goal
            self.residual[3] = math.remainder(self.residual[3], 2.0 * math.pi)

    def _bear(self, footing: Footing) -> None:
        """Which points bear the stance in each of its frames, as it is planned now."""
        assert self.stance is not None
        assert self.course is not None
        course = self.course
        local = replace(
            footing, first=footing.first - course.first, last=footing.last - course.first
        )
        bearing = local.planted(self.sole, course.active)
        reach = max(round(self.settings.settle / self._step), 1)
        spread = bearing.copy()
        for k in range(1, reach + 1):
            spread[k:] |= bearing[:-k]
            spread[:-k] |= bearing[k:]
        time = course.time[local.first : local.last + 1]
        self.stance.footing = footing
        self.stance.bearing, self.stance.spread = bearing, spread
        self.stance.roll = waddle(self.sole, bearing, time, self.settings)

    @property
    def _step(self) -> float:
        assert self.course is not None
        return float(self.course.time[-1] - self.course.time[-2])

    def _cone(self, planted: Bools) -> TiltCone:
        key = planted.tobytes()
        if key not in self.cones:
            self.cones[key] = TiltCone.of(self.sole, planted)
        return self.cones[key]

    def _standing(self, sample: Sample, frame: int) -> tuple[Array, Bools]:
        """The correction (7,) that puts the sole on its place, and the points that bear it."""
        stance = self.stance
        assert stance is not None
        row = min(max(frame - stance.footing.first, 0), len(stance.bearing) - 1)
        bearing = stance.bearing[row]
        aside = sample.yaw - stance.place[2]
        wanted = _turned(sample.tilt, aside) + stance.roll[row]
        if self.sole.two_sided:
            size = math.sqrt(float(wanted @ wanted))
            wanted = wanted * min(1.0, self.settings.max_tilt / max(size, 1e-9))
        tilt = self._settled(sample.time, self._cone(stance.spread[row]).nearest(wanted))
        if self.several:
            there = _quat_product(_about(float(stance.place[2])), _rotvec_quat(tilt))
            rotation = _quat_matrix(there) @ self.sole.flat
        else:
            there, rotation = sample.quat, sample.rotation
        pivot = int(bearing.argmax())
        centre = stance.prints[pivot] - rotation @ self.arms[pivot]
        return self._correction(sample, centre, there), bearing

    def _settled(self, time: float, tilt: Array) -> Array:
        """The mean of the last tilts: an average of members of a convex cone is a member."""
        self.tilts.append((time, tilt))
        while self.tilts[0][0] < time - self.settings.settle:
            self.tilts.popleft()
        slow = math.pi / self.settings.settle
        weights = [1.01 + math.cos(slow * (time - t)) for t, _ in self.tilts]
        total: Array = np.zeros(3)
        for weight, (_, each) in zip(weights, self.tilts, strict=True):
            total += weight * each
        return total / sum(weights)

    def _correction(self, sample: Sample, centre: Array, there: Quat) -> Array:
        """From the sample to a centre and a turn ``there`` from where the sole is flat."""
        yaw = math.remainder(2.0 * math.atan2(there[3], there[0]) - sample.yaw, 2.0 * math.pi)
        if self.correction is not None:  # no turn by a whole circle from frame to frame
            yaw += 2.0 * math.pi * round((float(self.correction[3]) - yaw) / (2.0 * math.pi))
        w, x, y, z = _quat_product(_about(yaw), sample.quat)
        correction = np.empty(7)
        np.subtract(centre, sample.centre, out=correction[:3])
        correction[3] = yaw
        correction[4:] = _quat_rotvec(_quat_product(there, (w, -x, -y, -z)))
        return correction

    def path(self, frame: int, throw: tuple[float, float] | None, *, linear: bool) -> Path:
        """Where the sole shall be at a frame.

        ``throw``: when the flight of the whole character began and will end, s; ``linear``:
        corrections go linearly in time, since nothing bears the character.
        """
        sample = self.seen[frame]
        time = sample.time
        step = time - self.before.time if self.before is not None else 0.0
        bearing = np.zeros(len(self.sole.local), dtype=bool)
        arc, away = 0.0, math.inf
        if self.stance is not None:
            goal, bearing = self._standing(sample, frame)
            fade = max(LAND if self.left else FIRST, 1.5 * self._lasts(self.residual))
            share = min((time - self.stance.since) / fade, 1.0)
            correction = goal + (1.0 - share * share * (3.0 - 2.0 * share)) * self.residual
            arc, away = self._eased(time, ()), 0.0
        else:
            correction, arc, away = self._flying(frame, sample, step, throw, linear)
        self.correction = correction
        turn = _quat_product(_rotvec_quat(correction[4:]), _about(float(correction[3])))
        rotation = sample.rotation
        if self.several:
            rotation = _quat_matrix(turn) @ sample.rotation
        centre = sample.centre + correction[:3]
        low = float((self.whole @ rotation[2]).min() + centre[2] - self.floor)
        self.arc_residual *= math.exp(-step / SEAM)
        arc = max(arc + self.arc_residual, 0.0)
        if self.stance is None:
            centre[2] += raised(low, arc) - low
        else:
            centre[2] += max(-low, 0.0) + max(arc - max(low, 0.0), 0.0)
        change = CLOSING * step if self.before is not None else math.inf
        self.away = min(max(away, self.away - change), self.away + change)
        if not math.isfinite(self.away):
            self.away = away
        self.before = sample
        prints = self.stance.prints if self.stance is not None else None
        shift = centre - sample.centre
        yaw_shift = float(correction[3])
        return Path(centre, rotation, shift, yaw_shift, self.away, prints, bearing)

    def _flying(
        self, frame: int, sample: Sample, step: float, throw: tuple[float, float] | None,
        linear: bool,
    ) -> tuple[Array, float, float]:  # fmt: skip
        """Correction (7,), height over the floor and time to the nearest stance."""
        time, target = sample.time, self._next(frame)
        if target is None:
            return (np.zeros(7) if self.correction is None else self.correction), 0.0, math.inf
        goal, planned = self._goal(target, sample)
        down = max(planned, self._earliest(target), time)
        if self.correction is None:
            return goal, 0.0, down - time
        if not self._begun():
            return self.correction, 0.0, down - time
        goal[3] = self.correction[3] + math.remainder(goal[3] - self.correction[3], 2.0 * math.pi)
        left = down - (time - step)
        correction = self._approached(goal, step, left, linear)
        arc = self._arc(time, down, target, throw)
        return correction, arc, min(time - self.left_at, down - time)

    def _approached(self, goal: Array, step: float, left: float, linear: bool) -> Array:
        """One step of the cubic that reaches ``goal`` with no rate in ``left`` s."""
        assert self.correction is not None
        gap = goal - self.correction
        left = max(left, self._lasts(gap))
        h = min(step / max(left, 1e-9), 1.0)
        if linear:
            self.rate = gap / max(left, 1e-9)
            return self.correction + h * gap
        slope = self.rate * left
        moved: Array = self.correction + h * h * (3.0 - 2.0 * h) * gap + h * (1.0 - h) ** 2 * slope
        rate = 6.0 * h * (1.0 - h) * gap + (1.0 - h) * (1.0 - 3.0 * h) * slope
        self.rate = rate / max(left, 1e-9)
        return moved

    def _lasts(self, gap: Array) -> float:
        """The shortest time for a change of the correction, s."""
        fastest = FASTEST * math.sqrt(self.settings.gravity * self.height)
        return math.hypot(gap[0], gap[1]) / fastest

    def _arc(
        self, time: float, down: float, target: Footing, throw: tuple[float, float] | None
    ) -> float:
        """How high the sole shall be; what is foreseen otherwise now is eased in."""
        if self.left is None:
            return 0.0
        rise = lowest_rise(self.left, target, down - self.left_at, self.height, self.settings)
        plan = [_Throw(self.left_at, down, rise)]
        if throw is not None:
            lasts = throw[1] - throw[0]
            rise = self.settings.gravity * lasts**2 / 8.0
            plan.append(_Throw(*throw, min(rise, self.settings.hop_height * self.height)))
        return self._eased(time, tuple(plan))

    def _eased(self, time: float, plan: tuple[_Throw, ...]) -> float:
        """The height by a plan, with what it differs from the last one fading."""
        now = max((each.at(time) for each in plan), default=0.0)
        if plan != self.throw:
            was = max((each.at(time) for each in self.throw), default=0.0) if self.throw else 0.0
            self.arc_residual += was - now
            self.throw = plan
        return now

    def _goal(self, target: Footing, sample: Sample) -> tuple[Array, float]:
        """The correction (7,) at touch-down as foreseen, and when that is, s."""
        course = self.course
        assert course is not None
        row = target.first - course.first
        landing = course.place[row]
        goal = np.zeros(7)
        goal[:2] = target.place[:2] - landing[:2]
        goal[3] = target.place[2] - landing[2] if self.several else 0.0
        if target.first < self.seen.end:  # known already
            then = self.seen[target.first]
            height, tilt = float(then.centre[2]), then.tilt
        else:
            height, tilt = self.touched or (self.level, np.zeros(3))
        goal[2] = self.level - height
        if self.several:
            goal[4:] = -_turned(tilt, float(target.place[2]))
        return goal, float(course.time[row])


def _about(yaw: float) -> Quat:
    return (math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw))


def _rotvec_quat(vector: Array) -> Quat:
    x, y, z = vector.tolist()
    angle = math.sqrt(x * x + y * y + z * z)
    half = math.sin(0.5 * angle) / angle if angle > 1e-12 else 0.5
    return (math.cos(0.5 * angle), half * x, half * y, half * z)


def _quat_product(a: Quat, b: Quat) -> Quat:
    w, x, y, z = a
    p, q, r, s = b
    return (
        w * p - x * q - y * r - z * s,
        w * q + x * p + y * s - z * r,
        w * r - x * s + y * p + z * q,
        w * s + x * r - y * q + z * p,
    )


def _matrix_quat(matrix: Array) -> Quat:
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, matrix.reshape(9))
    w, x, y, z = quat.tolist()
    return (w, x, y, z)


def _quat_matrix(quat: Quat) -> Array:
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, quat)
    return matrix.reshape(3, 3)


def _quat_rotvec(quat: Quat) -> tuple[float, float, float]:
    w, x, y, z = quat
    size = math.sqrt(x * x + y * y + z * z)
    angle = math.remainder(2.0 * math.atan2(size, w), 2.0 * math.pi)
    share = angle / size if size > 1e-15 else 0.0
    return (share * x, share * y, share * z)


def _turned(vector: Array, angle: float) -> Array:
    """A vector (3,) turned about the vertical."""
    c, s = math.cos(angle), math.sin(angle)
    x, y, z = vector.tolist()
    return np.array([c * x - s * y, s * x + c * y, z])
