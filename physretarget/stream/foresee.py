"""What a foot has done so far, and what it will do next if it keeps its habits.

The batch path forms stances from the whole timetable. So does the stream, of the timetable as far
as it is known and continued by habit: a foot stands and swings as long as it did before, and
touches down as much farther on as the body moves meanwhile.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from physretarget.capture.actor import CONTACT_POINTS
from physretarget.contact.sole import Sole
from physretarget.stream.touch import Touch
from physretarget.stream.turns import Quat

__all__ = ["Course", "Flight", "Going", "Habit", "Sample", "Seen"]

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

MEMORY = 1.2
"""How much of the past stances are formed from, s."""
HORIZON = 1.5
"""How far ahead stances are foreseen, s."""
LONGER = 0.25
"""Who has stood longer than usual stands on for this share of the time."""
OVERDUE = 0.1
"""A stance that should be over lasts at least this much longer, s."""
ALONE = 0.1
"""A foot that stands for so long after the other pushes off alone, s."""
UNSEEN = 0.04
"""A foot that is not seen falling does not touch down for so long, s."""
OVERLAP = 0.02
"""Who walks lifts a foot so long after the other one came down, s."""
PASSED = 0.9
"""The actor's way during one stance, m: 0.64 s at 1.4 m/s, 0.26 s at 3.5 m/s."""
SLIDE = 0.5
"""How fast a planted foot of the unplanted motion moves, as a share of the body's speed, until that
is known of the foot."""
BRISK = 0.3
"""Slides of a foot are learned from bodies faster than this many heights per second."""


@dataclass
class Habit:
    """How long the actor's feet stand and swing, s."""

    stance: float = 0.6
    swing: float = 0.4
    learned: bool = False

    def going(self, speed: float) -> None:
        """Until a whole stance has been seen: a body passes over its foot at ``speed`` m/s."""
        if not self.learned:
            self.stance = min(max(PASSED / max(speed, 1e-3), 0.2), 0.6)

    def stood(self, seconds: float) -> None:
        """A stance is over."""
        self.stance = 0.5 * (self.stance + min(max(seconds, 0.15), 1.5))
        self.learned = True

    def swung(self, seconds: float) -> None:
        """A swing is over."""
        self.swing = 0.5 * (self.swing + min(max(seconds, 0.12), 0.7))


@dataclass(frozen=True, eq=False, slots=True)
class Sample:
    """A sole at one instant, before it is planted.

    ``centre`` (3,) and ``rotation`` (3, 3) of the body; ``yaw`` continuous heading, ``tilt`` (3,)
    as in :class:`physretarget.contact.sole.SoleMotion`, ``quat`` the two in one; ``active`` (n,)
    points that the actor has planted.
    """

    time: float
    centre: Array
    rotation: Array
    yaw: float
    tilt: Array
    active: Bools
    quat: Quat = (1.0, 0.0, 0.0, 0.0)


@dataclass(eq=False)
class Going:
    """How the body moves: ``step`` s between frames, ``velocity`` (2,) m/s, ``turning`` rad/s.

    ``landing`` s until the actor comes down, 0 unless it flies; ``behind`` the foot that pushed
    off alone and so comes down last; ``falling`` s until each foot ("left", "right") touches
    down if it goes on falling as it does, left out where it does not.
    """

    step: float
    velocity: Array
    turning: float = 0.0
    landing: float = 0.0
    behind: str | None = None
    falling: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Course:
    """A sole from ``first`` on, as it was and will be: ``time`` (T,), ``active`` (T, n) and
    ``place`` (T, 3) x, y, heading.
    """

    first: int
    time: Array
    active: Bools
    place: Array


@dataclass
class _Side:
    """One of the actor's feet: since when it stands or swings, and where it last came down."""

    name: str
    mask: Bools
    points: list[int]
    pattern: Bools
    standing: bool = False
    since: float | None = None
    down: Array | None = None
    down_at: float = 0.0
    total: Array | None = None
    count: int = 0
    starts: list[int] = field(default_factory=list)


@dataclass
class _Steps:
    """When a foot lifts (before now if it swings), comes down next, and lifts again, s."""

    up: float
    down: float
    up_again: float

    def lift(self, soonest: float) -> None:
        """Not before."""
        late = max(soonest - self.up, 0.0)
        self.up, self.down, self.up_again = self.up + late, self.down + late, self.up_again + late


class _Rows:
    """Times, contacts and places of the samples that still matter: rows ``first`` to ``end``."""

    def __init__(self, count: int) -> None:
        self.first = self.end = 0
        self.time = np.empty(512)
        self.active = np.empty((512, count), dtype=bool)
        self.place = np.empty((512, 3))

    def add(self, sample: Sample) -> None:
        """The latest one; what came before the first is overwritten where room is needed."""
        if self.end == len(self.time):
            count = self.end - self.first
            for name in ("time", "active", "place"):
                old = getattr(self, name)
                new = np.empty((max(2 * count, len(old)), *old.shape[1:]), dtype=old.dtype)
                new[:count] = old[self.first :]
                setattr(self, name, new)
            self.first, self.end = 0, count
        self.time[self.end], self.active[self.end] = sample.time, sample.active
        self.place[self.end, :2], self.place[self.end, 2] = sample.centre[:2], sample.yaw
        self.end += 1


class Seen:
    """All samples of one sole that still matter, and its course from there."""

    def __init__(self, sole: Sole, height: float, habit: Habit) -> None:
        self.sole, self.height, self.habit = sole, height, habit
        self.samples: deque[Sample] = deque()
        self.first = 0
        self.kept = _Rows(len(sole.sides))
        self.started = math.inf
        self.slide: float | None = None
        sides = dict.fromkeys(sole.sides)
        masks = {side: np.array([s == side for s in sole.sides]) for side in sides}
        self.sides = [
            _Side(side, mask, np.flatnonzero(mask).tolist(), mask.copy())
            for side, mask in masks.items()
        ]

    def __getitem__(self, frame: int) -> Sample:
        return self.samples[frame - self.first]

    @property
    def end(self) -> int:
        """The number of frames so far."""
        return self.first + len(self.samples)

    def add(self, sample: Sample, velocity: Array) -> bool:
        """The latest frame; ``velocity`` (2,) of the body. Whether a foot lands or lifts."""
        if not self.samples:
            self.started = sample.time
        self.samples.append(sample)
        self.kept.add(sample)
        event, active = False, sample.active.tolist()
        for side in self.sides:
            standing = any(active[k] for k in side.points)
            event |= self._follow(side, sample, velocity, standing)
        return event

    def forget(self, frame: int) -> None:
        """Drop what is older than the memory, but nothing from ``frame`` on."""
        oldest = self[frame].time - MEMORY
        while self.first < frame and self.samples[0].time < oldest:
            self.samples.popleft()
            self.kept.first += 1
            self.first += 1

    def _follow(self, side: _Side, sample: Sample, velocity: Array, standing: bool) -> bool:
        here = sample.centre[:2]
        if standing:
            side.pattern = sample.active & side.mask
        if standing and side.standing and side.total is not None:
            side.total += here
            side.count += 1
        if standing == side.standing:
            return False
        if standing:
            if side.since is not None and side.since > self.started:
                self.habit.swung(sample.time - side.since)
            side.down, side.down_at = here.copy(), sample.time
            side.starts = [*side.starts[-9:], self.end - 1]
            side.total, side.count = here.copy(), 1
        elif side.since is not None and side.total is not None and side.down is not None:
            lasted = sample.time - side.since
            if side.since > self.started:
                self.habit.stood(lasted)
            speed = float(np.linalg.norm(velocity))
            if speed > BRISK * self.height and 0.15 < lasted < 1.5 and not self.sole.two_sided:
                way = (side.total / side.count - side.down) @ velocity / speed
                slide = min(max(2.0 * float(way) / (speed * lasted), -0.5), 1.0)
                self.slide = slide if self.slide is None else 0.5 * (self.slide + slide)
        side.standing, side.since = standing, sample.time
        return True

    def began(self, frame: int, name: str) -> int:
        """The frame at which a foot touched down for the stance that a frame belongs to."""
        starts = next(side.starts for side in self.sides if side.name == name)
        if frame >= self.end or not starts:
            return frame
        return starts[max(bisect_right(starts, frame) - 1, 0)]

    def course(self, going: Going) -> Course:
        """What was and will be."""
        step, velocity, turning = going.step, going.velocity, going.turning
        latest = self.samples[-1]
        ahead = step * np.arange(1, int(HORIZON / step) + 1)
        time = latest.time + ahead
        active = np.zeros((len(ahead), len(self.sole.sides)), dtype=bool)
        place = np.empty((len(ahead), 3))
        place[:, :2] = latest.centre[:2] + ahead[:, None] * velocity
        place[:, 2] = latest.yaw + turning * np.minimum(ahead, 0.2)
        steps = [self._steps(side, latest.time, going) for side in self.sides]
        if self.sole.two_sided and self.habit.stance > self.habit.swing:  # nobody runs
            comes = max(
                (s.down for s, o in zip(steps, self.sides, strict=True) if not o.standing),
                default=0.0,
            )
            for one, side in zip(steps, self.sides, strict=True):
                if side.standing and not all(each.standing for each in self.sides):
                    one.lift(comes + OVERLAP)
        for side, each in zip(self.sides, steps, strict=True):
            up, down, up_again = each.up, each.down, each.up_again
            now = time <= up
            again = (time >= down) & (time <= up_again)
            active[now] |= side.pattern
            active[again] |= side.mask
            if not self.sole.two_sided:
                slid = (SLIDE if self.slide is None else self.slide) * velocity
                place[now, :2] = latest.centre[:2] + ahead[now, None] * slid
                from_here = side.down is None
                base = latest.centre[:2] if side.down is None else side.down
                way = (down - (latest.time if from_here else side.down_at)) * velocity
                later = (time[again] - down)[:, None] * slid
                place[again, :2] = base + way + later
        past = slice(self.kept.first, self.kept.end)
        return Course(
            self.first,
            np.concatenate([self.kept.time[past], time]),
            np.concatenate([self.kept.active[past], active]),
            np.concatenate([self.kept.place[past], place]),
        )

    def _steps(self, side: _Side, now: float, going: Going) -> _Steps:
        """When a foot lifts (before now if it swings), comes down next, and lifts again."""
        since = side.since if side.since is not None else now
        if side.standing:
            elapsed = now - since
            if since <= self.started:  # it had begun before
                elapsed += 0.5 * self.habit.stance
            up = now + max(self.habit.stance - elapsed, LONGER * (now - since), OVERDUE)
            down = up + self.habit.swing
        else:
            up = now - going.step
            soon = going.falling.get(side.name, UNSEEN)
            down = max(since + self.habit.swing, now + 1.5 * going.step, now + min(soon, UNSEEN))
            if going.landing > 0.0:
                landing = now + going.landing
                down = max(down, landing) if side.name == going.behind else landing
        return _Steps(up, down, down + self.habit.stance)


class Flight:
    """How long the actor stays in the air: a body that is thrown comes down as it went up."""

    def __init__(self, gravity: float) -> None:
        self.gravity = gravity  # m/s²
        self.height = 0.0
        self.speed = 0.0
        self.began = -math.inf
        self.fastest = -math.inf
        self.before: tuple[float, float] | None = None
        self.stood = {"left": -math.inf, "right": -math.inf}
        self.sides = [name.partition("_")[0] for name in CONTACT_POINTS]

    def next(self, time: float, com: Array, touch: Touch) -> tuple[float, str | None]:
        """Seconds until something touches down, 0 if something does; the foot that comes last.

        ``com`` (3,) the actor's centre of mass.
        """
        height = float(com[2])
        if self.before is not None:
            speed = (height - self.before[1]) / (time - self.before[0])
            self.speed += 0.7 * (speed - self.speed)
        self.before = (time, height)
        if touch.active.any():
            self.height, self.began, self.fastest = height, time, -math.inf
            for side, on in zip(self.sides, touch.active.tolist(), strict=True):
                if on and side in self.stood:
                    self.stood[side] = time
            return 0.0, None
        if self.speed > self.fastest:  # the floor still pushes, whatever the feet look like
            self.began, self.fastest = time, self.speed
        fall = self.speed * self.speed + 2.0 * self.gravity * (height - self.height)
        left = (self.speed + math.sqrt(max(fall, 0.0))) / self.gravity
        if self.speed < 0.0:  # by now the feet show where the floor is
            fall = self.speed * self.speed + 2.0 * self.gravity * touch.clearance
            left = (self.speed + math.sqrt(fall)) / self.gravity
        first, last = sorted(self.stood, key=self.stood.__getitem__)
        alone = self.stood[last] - self.stood[first] > ALONE
        return max(left, 1e-3), last if alone else None
