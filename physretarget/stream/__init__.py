"""Frame in, pose out: the stages up to contact in real time, as Yamane 2010 section 7 wished.

    actor pose ─ features ─▶ latent point ─ ik ─▶ pose ─ centre of mass ─▶ place ─ contact ─▶ pose

Each stage is the batch path's with what only the past can tell; docs/measured/stream.md says
how far the two agree.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget import momentum
from physretarget.capture.actor import CONTACT_POINTS, NQ, ActorShape
from physretarget.errors import InputError
from physretarget.mapping.track import track
from physretarget.options.retargeting import LONGEST_DELAY
from physretarget.stream.body import Body
from physretarget.stream.place import Heading, Placer
from physretarget.stream.plant import Planter
from physretarget.stream.pose import Follower
from physretarget.stream.touch import Touch, Toucher
from physretarget.stream.turns import about, quat_product
from physretarget.trained import TrainedMapper

__all__ = ["LONGEST_DELAY", "Posed", "Streamer"]

Array = NDArray[np.float64]

NOWHERE = np.zeros(2)


@dataclass(frozen=True, eq=False)
class Posed:
    """One frame of the stream.

    ``qpos`` (nq,) the pose; ``mapped`` and ``placed`` (nq,) the same after those stages;
    ``active`` (nc,) contact points of the character that are held; ``touch`` the actor's
    contacts; ``variance`` m², the mapper's own doubt.
    """

    time: float
    qpos: Array
    mapped: Array
    placed: Array
    active: NDArray[np.bool_]
    touch: Touch
    variance: float


@dataclass(frozen=True, eq=False, slots=True)
class _Waiting:
    """A frame whose feet are not planted yet."""

    time: float
    mapped: Array
    placed: Array
    touch: Touch
    variance: float


class Streamer:
    """Turns poses of the reference actor into poses of a character, one by one."""

    def __init__(self, mapper: TrainedMapper, *, delay: float = 0.0) -> None:
        """``delay``: poses come so many s after their frames; what is seen meanwhile is known.

        Raises:
            InputError: a delay that is negative or longer than ``LONGEST_DELAY``.
        """
        if not 0.0 <= delay <= LONGEST_DELAY:
            raise InputError(f"the delay is {delay:g} s; it must lie in 0 to {LONGEST_DELAY:g}.")
        character = mapper.character
        self.mapper, self.character, self.delay = mapper, character, delay
        self.tracker = track(mapper.mapper)
        self.actor = Body(mapper.actor)
        self.body = Body(character)
        self.follower = Follower(character)
        self.root = character.root_qpos
        self.own_heading = Heading(character.front, character.up)
        self.actor_heading = Heading(mapper.actor.front, mapper.actor.up)
        one = np.ones((1, 3, 3))
        self.placer = Placer(momentum.scales(character, one, mapper.actor, one).size)
        self.toucher = Toucher(ActorShape.reference().leg_length)
        self.planter = Planter(character)
        self.order = [mapper.actor.tied.index(name) for name in CONTACT_POINTS]
        self.last = -math.inf
        self.frames = 0
        self.waiting: deque[_Waiting] = deque()

    def next(
        self, time: float, actor_qpos: Array, *, planted: NDArray[np.bool_] | None = None
    ) -> Posed | None:
        """Map one frame; the pose of the frame ``delay`` s before it, None if there is none yet.

        Args:
            time: s, later than that of the frame before.
            actor_qpos: (75,) of the reference actor, see :mod:`physretarget.capture.actor`.
            planted: (10,) which of ``CONTACT_POINTS`` stand, where it is known from elsewhere
                (pressure soles, a timetable); None to tell from the motion.

        Returns:
            The posed frame, or None while the delay is not over.

        Raises:
            InputError: the pose has another length or is not finite, or time stands still.
        """
        step = self._checked(time, actor_qpos)
        y, com, points, yaw = self._seen(actor_qpos)
        mapped = self.tracker.next(y)
        target = mapped.mean[0].reshape(-1, 3)
        nearest = self.mapper.nearest_pose(y[None])[0]
        local = self._facing_forward(self.follower.next(target, step, nearest))
        self.follower.before = local
        placed = self._moved(local, yaw, self.placer.next(yaw, com, self.body.com(local)))
        touch = self.toucher.next(points, step)
        if planted is not None:
            landing = np.where(planted, 0.0, np.where(touch.active, np.inf, touch.landing))
            touch = Touch(np.array(planted, dtype=bool), landing, touch.clearance)
        assert self.placer.com is not None
        self.planter.see(time, placed, touch, self.placer.com, com, yaw)
        self.waiting.append(_Waiting(time, local, placed, touch, float(mapped.variance[0])))
        self.last = time
        self.frames += 1
        return self._due() if self.waiting[0].time <= time - self.delay + 1e-9 else None

    def rest(self) -> Iterator[Posed]:
        """The frames that still wait when no more come."""
        while self.waiting:
            yield self._due()

    def play(self, frames: Iterable[tuple[float, Array]]) -> Iterator[Posed]:
        """The poses of all frames (time, actor qpos), in order.

        Args:
            frames: Time in s and (75,) pose of the reference actor, in order.

        Returns:
            The posed frames.
        """
        for time, qpos in frames:
            posed = self.next(time, qpos)
            if posed is not None:
                yield posed
        yield from self.rest()

    def _due(self) -> Posed:
        frame = self.waiting.popleft()
        qpos = self.planter.next() if len(self.character.contacts) else frame.placed
        active = self.planter.held.copy()
        return Posed(
            frame.time, qpos, frame.mapped, frame.placed, active, frame.touch, frame.variance
        )

    def _checked(self, time: float, actor_qpos: Array) -> float:
        if np.shape(actor_qpos) != (NQ,) or not np.isfinite(actor_qpos).all():
            raise InputError(f"an actor's pose is {NQ} finite numbers.", frame=self.frames)
        if not math.isfinite(time) or time <= self.last:
            raise InputError(f"time is {time:g} s after {self.last:g} s.", frame=self.frames)
        return time - self.last if math.isfinite(self.last) else 0.0

    def _seen(self, actor_qpos: Array) -> tuple[Array, Array, Array, float]:
        """Features (DY,), centre of mass, contact points (10, 3) and heading of the actor."""
        com = self.actor.com(actor_qpos)
        place, rotation = self.actor.frame()
        yaw = self.actor_heading.next(rotation)
        seen = self.actor.points(self.mapper.actor.markers)
        local = seen - (place[0], place[1], 0.0)
        local[:, :2] = local[:, :2] @ _rotation(yaw)
        points = self.actor.points(self.mapper.actor.contacts)
        return local.ravel(), com, points[self.order], yaw

    def _facing_forward(self, qpos: Array) -> Array:
        self.body.pose(qpos)
        self.own_heading.yaw = None  # each pose on its own, as in the batch path
        return self._moved(qpos, -self.own_heading.next(self.body.frame()[1]), NOWHERE)

    def _moved(self, qpos: Array, yaw: float, place: Array) -> Array:
        at = self.root
        moved = np.array(qpos)
        w, x, y, z = qpos[at + 3 : at + 7].tolist()
        moved[at + 3 : at + 7] = quat_product(about(yaw), (w, x, y, z))
        moved[at : at + 2] = place
        return moved


def _rotation(yaw: float) -> Array:
    """Matrix (2, 2) that takes rows of world x, y to heading axes, by multiplication from right."""
    cosine, sine = math.cos(yaw), math.sin(yaw)
    return np.array([[cosine, -sine], [sine, cosine]])
