"""Planted points stay where they are, as far as that can be foreseen.

The same rules as in the batch path (:mod:`physretarget.contact`), applied to what is known of the
motion and what is foreseen of it: rigid bodies get one place per stance, corrections are blended
over flights, the root moves with the feet and inverse kinematics does the rest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from physretarget.capture.actor import CONTACT_POINTS
from physretarget.contact import ContactSettings
from physretarget.contact.carry import joint_weights, swivels
from physretarget.contact.pace import STILL, share_of_lead
from physretarget.contact.soles import sole_of, standing_bodies, turning_limit
from physretarget.mjcf import Character, Points
from physretarget.stream.body import Body, Solver
from physretarget.stream.foot import START, Foot, Path
from physretarget.stream.foresee import Flight, Going, Habit
from physretarget.stream.pace import Pace
from physretarget.stream.touch import Touch
from physretarget.stream.turns import matrix_quat

__all__ = ["Planter"]

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

NEAR = 0.002
"""A point is held while it is this near to its place, m."""
MISSED = 0.005
"""A foot whose points stay farther than this from their places lets go, m."""
NEARLY = 0.02
"""A second Gauss-Newton step follows one longer than this, rad or m: what the first leaves is of
the order of its square.
"""
AGAIN = 0.1
"""Stances are formed anew at least so often, s, and whenever a foot lifts or lands."""
_FEET = [
    (k, name.partition("_")[0])
    for k, name in enumerate(CONTACT_POINTS)
    if name.endswith(("_heel", "_toe"))
]
"""Places of the actor's feet among its contact points, and the side of each."""
BRISKLY, SLOWLY = 0.15, 0.3
"""Time constants of the velocities, and of the turning, that are continued, s."""


@dataclass(frozen=True, eq=False)
class _Frame:
    """One frame that waits for its turn; ``thrown``: when the actor took off last, s."""

    time: float
    placed: Array
    touch: Touch
    thrown: float


class Planter:
    """Plants a character's feet, frame by frame, ``delay`` s after they were seen."""

    def __init__(self, character: Character, settings: ContactSettings | None = None) -> None:
        self.settings = settings or ContactSettings(cut_grid=1.0 / 12.0)
        self.character = character
        self.habit = Habit()
        self.feet = [self._foot(body) for body in standing_bodies(character).tolist()]
        self.tied = [
            np.array([CONTACT_POINTS.index(str(character.tied[i])) for i in foot.sole.points])
            for foot in self.feet
        ]
        used = {name for name in character.tied if name}
        self.others = np.array([name not in used for name in CONTACT_POINTS])
        self.body = Body(character)
        root = character.root_body if character.has_root else -1
        own = [f for f in self.feet if f.sole.body == root and len(f.sole.local) > 2]
        self.own = own[0] if own else None
        self.swivels = swivels(character) if own else []
        self.pace = Pace(self.settings, character.height)
        self.root = character.root_qpos if character.has_root else 0
        self._solvers()
        self.waiting: list[_Frame] = []
        self.done = 0
        self.going = Going(1.0 / 60.0, np.zeros(2))
        self.latest: Array | None = None
        self.seen_at = self.started = -math.inf
        self.rates, self.turning = np.zeros(5), 0.0
        self.planned_at = -math.inf
        self.flight = Flight(self.settings.gravity)
        self.borne_at = -math.inf
        self.reached = np.zeros((len(character.contacts), 3))
        self.held = np.zeros(len(character.contacts), dtype=bool)
        self.offset: Array | None = None

    def _foot(self, body: int) -> Foot:
        character, told = self.character, self.settings
        sole = sole_of(character, body)
        tied = [str(character.tied[i]) for i in sole.points]
        return Foot(
            sole,
            self.habit,
            turning_limit(character, body, told),
            character.floor_height,
            character.height,
            told,
            walks=any(name.endswith(("heel", "toe")) for name in tied),
        )

    def _solvers(self) -> None:
        character, markers = self.character, self.character.markers
        prior = joint_weights(character, self.settings.joint_weight)
        if self.own is not None:
            keep = np.flatnonzero(markers.body != character.root_body)
            self.carried = Points(
                tuple(markers.names[i] for i in keep), markers.body[keep], markers.local[keep]
            )
            self.solver = Solver(character, self.carried, steps=2)
            self.solver.hold(prior)
            self.solver.lock(np.arange(character.root_dof, character.root_dof + 6))
            return
        names, bodies, local = list(markers.names), [markers.body], [markers.local]
        for foot in self.feet:
            sole = foot.sole
            count = len(sole.local) + len(sole.under)
            names += [f"{sole.body}_{k}" for k in range(count)]
            bodies.append(np.full(count, sole.body))
            local += [sole.local, sole.under]
        points = Points(tuple(names), np.concatenate(bodies), np.concatenate(local))
        # A leg that is stretched to a place out of its reach is singular.
        self.solver = Solver(character, points, steps=2, longest=0.3)
        self.solver.hold(prior)
        self.weight = np.ones(len(points))
        self.target = np.zeros((len(points), 3))

    def see(
        self, time: float, placed: Array, touch: Touch, com: Array, actor_com: Array, yaw: float
    ) -> None:
        """The latest frame: placed pose (nq,), contacts, centres of mass (character's: x, y) and
        heading.
        """
        self.body.pose(placed)
        going = self._follow(time, com, actor_com, yaw)
        going.landing, going.behind = self.flight.next(time, actor_com, touch)
        going.falling = _falling(touch)
        event = time < self.started + 2.0 * START
        for foot, tied in zip(self.feet, self.tied, strict=True):
            body = foot.sole.body
            sample = foot.sample(
                time,
                self.body.place[body].copy(),
                self.body.turn[body].copy(),
                touch.active[tied],
            )
            event |= foot.seen.add(sample, going.velocity)
        self.waiting.append(_Frame(time, placed, touch, self.flight.began))
        overdue = going.landing > 0.0 or time - self.planned_at > AGAIN
        if event or overdue or any(self._surprised(foot) for foot in self.feet):
            self.planned_at = time
            for foot in self.feet:
                foot.plan(going)

    @staticmethod
    def _surprised(foot: Foot) -> bool:
        """Whether the latest frame is not what was foreseen."""
        if foot.course is None:
            return foot.used
        row = foot.seen.end - 1 - foot.course.first
        if row >= len(foot.course.active):
            return True
        latest = foot.seen.samples[-1].active
        if (latest == foot.course.active[row]).all():
            return False
        for side in foot.seen.sides:
            if latest[side.mask].any() != foot.course.active[row][side.mask].any():
                return True
        return False

    def _follow(self, time: float, com: Array, actor_com: Array, yaw: float) -> Going:
        """How the body goes on."""
        now = np.array([*com[:2], *actor_com[:2], yaw])
        if self.latest is None:
            self.latest, self.seen_at, self.started = now, time, time
            return self.going
        going, step, age = self.going, time - self.seen_at, time - self.started
        going.step = step
        # At first the mean since the start, later one of the latest past.
        share = max(1.0 - math.exp(-step / BRISKLY), step / age)
        self.rates += share * ((now - self.latest) / step - self.rates)
        share = max(1.0 - math.exp(-step / SLOWLY), step / age)
        self.turning += share * ((yaw - self.latest[4]) / step - self.turning)
        going.velocity = self.rates[:2]
        going.turning = self.turning * (1.0 - math.exp(-age / SLOWLY))
        self.habit.going(math.hypot(self.rates[2], self.rates[3]))
        self.latest, self.seen_at = now, time
        return going

    def next(self) -> Array:
        """The pose (nq,) of the oldest frame that waits."""
        frame = self.waiting.pop(0)
        index = self.done
        self.done += 1
        feet = [foot for foot in self.feet if foot.used]
        for foot in feet:
            foot.decide(index)
        throw, linear = self._thrown(frame)
        paths = {foot.sole.body: foot.path(index, throw, linear=linear) for foot in feet}
        qpos = self._posed(frame, paths)
        self._measure(frame.time, qpos, paths)
        for foot in self.feet:
            foot.seen.forget(index)
        return qpos

    def _thrown(self, frame: _Frame) -> tuple[tuple[float, float] | None, bool]:
        """The flight of the whole: from when to when, and whether corrections go linearly."""
        borne = bool(frame.touch.active[self.others].any())
        borne |= any(foot.standing for foot in self.feet)
        if borne:
            self.borne_at = frame.time
            return None, False
        down = min((foot.comes_down(self.done - 1) for foot in self.feet), default=math.inf)
        lasts = down - self.borne_at
        if not lasts <= self.settings.longest_flight:
            return None, not math.isfinite(down)
        return (max(self.borne_at, min(frame.thrown, frame.time)), down), True

    def _posed(self, frame: _Frame, paths: dict[int, Path]) -> Array:
        character, placed = self.character, frame.placed
        if not paths:
            return placed
        if self.own is not None:
            path = paths[self.own.sole.body]
            return self._carried(placed, path, self.pace.lead(frame.time, path.shift[:2]))
        markers = character.markers
        if len(self.waiting):  # otherwise it is the frame that was just seen
            self.body.pose(placed)
        near = [1.0 / (1.0 + (p.away / 0.2) ** 2) + 1e-6 for p in paths.values()]
        shift = np.zeros(3)
        for share, path in zip(near, paths.values(), strict=True):
            shift += (share / sum(near)) * path.shift
        moved = np.array(placed)
        moved[self.root : self.root + 3] += shift
        at = len(markers)
        self.target[:at] = self.body.points(markers) + shift
        for foot in self.feet:
            path_, count, under = paths.get(foot.sole.body), len(foot.whole), len(foot.sole.under)
            weight = 0.0
            if path_ is not None:
                self.target[at : at + count] = path_.points(foot.whole)
                weight = self._weight(path_.away)
            self.weight[at : at + count] = weight
            if under:
                flank = self.settings.flank_weight / under * weight
                self.weight[at + count - under : at + count] = flank
            at += count
        self.solver.weigh(self.weight)
        start = np.array(moved)
        model = self.solver.body.model
        if self.offset is not None:  # the change of the frame before is a good first guess
            mujoco.mj_integratePos(model, start, self.offset, 1.0)
        else:
            self.offset = np.zeros(model.nv)
        qpos = self.solver.solve(start, self.target, near=moved, tolerance=NEARLY)
        mujoco.mj_differentiatePos(model, self.offset, 1.0, moved, qpos)
        return qpos

    def _weight(self, away: float) -> float:
        """Of a sole's points, in steps, since every other weight costs time."""
        told = self.settings
        flight = told.flight_weight / (1.0 + (away / told.fade) ** 2) ** 2
        weight = flight + (told.stance_weight - flight) * math.exp(-((away / 0.04) ** 2))
        return float(2.0 ** round(math.log2(max(weight, 1e-3))))

    def _carried(self, placed: Array, path: Path, lead: Array) -> Array:
        """The whole pose carried along with the root on its path, facing where it faced.

        What is carried leans by ``lead`` (2,) m.
        """
        foot = self.own
        assert foot is not None
        moved, at = np.array(placed), self.root
        moved[at : at + 3] = path.centre - path.rotation @ foot.sole.centre
        moved[at + 3 : at + 7] = matrix_quat(path.rotation)
        turned, back = self._swivelled(moved, -math.remainder(path.yaw, 2.0 * math.pi))
        lean = 1.0 - float(path.rotation[2] @ foot.sole.flat[2])
        askew = abs(back) * math.sqrt(2.0 * max(lean, 0.0)) > 1e-3
        leans = math.hypot(lead[0], lead[1]) > STILL * self.character.height
        if not (askew or leans):
            return turned
        self.body.pose(moved if askew else turned)
        target = self.body.points(self.carried) - path.centre
        if askew:
            c, s = math.cos(back), math.sin(back)
            x, y = target[:, 0].copy(), target[:, 1].copy()
            target[:, 0], target[:, 1] = c * x - s * y, s * x + c * y
        target[:, :2] += share_of_lead(target[:, 2], self.character.height)[:, None] * lead
        return self.solver.solve(turned, path.centre + target, near=turned)

    def _swivelled(self, moved: Array, back: float) -> tuple[Array, float]:
        """The pose turned back on its swivel by ``back`` rad, and how much of that it can."""
        if not self.swivels or abs(back) < 1e-6:
            return moved, 0.0
        character, turned = self.character, np.array(moved)
        for joint, sign in self.swivels:
            value = min(
                max(moved[joint] + sign * back, character.lower[joint]), character.upper[joint]
            )
            reached = sign * (value - moved[joint])
            back = reached if abs(reached) < abs(back) else back
        for joint, sign in self.swivels:
            turned[joint] = moved[joint] + sign * back
        return turned, back

    def _measure(self, time: float, qpos: Array, paths: dict[int, Path]) -> None:
        """Which points are held; a foot that does not reach its place lets go."""
        self.body.pose(qpos)
        self.reached = self.body.points(self.character.contacts)
        self.held[:] = False
        missed: list[Foot] = []
        for foot in self.feet:
            path = paths.get(foot.sole.body)
            if path is None or path.prints is None:
                continue
            reached = self.reached[foot.sole.points]
            away = reached - path.prints
            self.held[foot.sole.points] = np.einsum("nc,nc->n", away, away) < NEAR**2
            away = reached - path.points(foot.tread.arms)
            if np.einsum("nc,nc->n", away, away).max() > MISSED**2:
                missed.append(foot)
        if not missed or self.own is not None:
            return
        standing = [foot for foot in self.feet if foot.stance is not None]
        oldest = min(standing, key=lambda f: f.stance.since if f.stance else math.inf)
        assert oldest.stance is not None
        if len(standing) > 1 or time - oldest.stance.since > self.settings.min_piece:
            oldest.leave(self.done - 1, out_of_reach=True)


def _falling(touch: Touch) -> dict[str, float]:
    """When each foot touches down, if it falls."""
    found: dict[str, float] = {}
    landing = touch.landing.tolist()
    for k, side in _FEET:
        if 0.0 < landing[k] < math.inf:
            found[side] = min(landing[k], found.get(side, math.inf))
    return found
