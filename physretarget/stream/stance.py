"""A stance that has begun: where its sole stands, how it is tilted, and what bears it."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from physretarget.contact.settings import ContactSettings
from physretarget.contact.sole import Sole, TiltCone
from physretarget.contact.stances import Footing
from physretarget.contact.track import level_ends, waddle
from physretarget.stream.foresee import Course, Sample
from physretarget.stream.turns import (
    Quat,
    about,
    quat_matrix,
    quat_product,
    rotvec_quat,
    turned,
)

__all__ = ["Members", "Stance", "Tread"]

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Members = frozenset[tuple[int, str]]
"""The phases of the actor's feet that a stance is made of: first frame and side."""


class Tread:
    """What all stances of one sole share.

    ``level`` height of its centre while it lies flat on the floor; ``arms`` (n, 3) of its points
    from there; ``several``: they are more than one, so that it has a heading and a tilt.
    """

    def __init__(self, sole: Sole, floor: float, settings: ContactSettings) -> None:
        self.sole, self.settings = sole, settings
        self.level = floor - float(sole.foot[:, 2].min())
        self.arms = sole.local - sole.centre
        self.several = len(sole.local) > 1
        self._cones: dict[bytes, TiltCone] = {}

    def cone(self, planted: Bools) -> TiltCone:
        """The tilts with points (n,) planted; made once, for the few sets of them that occur."""
        key = planted.tobytes()
        if key not in self._cones:
            self._cones[key] = TiltCone.of(self.sole, planted)
        return self._cones[key]


class Stance:
    """One sole on one place, which it keeps: ``place`` (3,) x, y, heading; ``prints`` (n, 3).

    ``bearing`` (F, n) are the points that bear each frame of its ``footing``, ``spread`` (F, n)
    those that do shortly before or after, ``roll`` (F, 3) the tilt onto the side that does.
    ``steep`` (F,) is how much of the tilt is left near a hop, 1 away from it.
    """

    def __init__(
        self,
        tread: Tread,
        footing: Footing,
        course: Course,
        members: Members,
        since: float,
        *,
        hopped: bool,
    ) -> None:
        """As planned in ``course``, from ``since`` s on; ``hopped``: it begins with a landing."""
        self.tread, self.members, self.since, self.hopped = tread, members, since, hopped
        self.place = footing.place.copy()
        turn = quat_matrix(about(float(footing.place[2])))
        self.prints = np.append(footing.place[:2], tread.level) + tread.sole.foot @ turn.T
        self._tilts: deque[tuple[float, Array]] = deque()
        self.bear(footing, course)

    def bear(self, footing: Footing, course: Course) -> None:
        """Which points bear each frame of the footing, as it is planned now."""
        sole, settings = self.tread.sole, self.tread.settings
        local = replace(
            footing, first=footing.first - course.first, last=footing.last - course.first
        )
        bearing = local.planted(sole, course.active)
        step = float(course.time[-1] - course.time[-2])
        spread = bearing.copy()
        for k in range(1, max(round(settings.settle / step), 1) + 1):
            spread[k:] |= bearing[:-k]
            spread[:-k] |= bearing[k:]
        time = course.time[local.first : local.last + 1]
        self.footing = footing
        self.bearing, self.spread = bearing, spread
        self.roll = waddle(sole, bearing, time, settings)
        ends = (self.hopped, local.last < len(course.time) - 1)
        self.steep = level_ends(time, ends, settings) if sole.two_sided else np.ones(len(time))

    def placed(self, sample: Sample, frame: int) -> tuple[Array, Quat, Bools]:
        """Where the sole stands at a frame: centre (3,), turn from flat, points that bear (n,)."""
        tread = self.tread
        row = min(max(frame - self.footing.first, 0), len(self.bearing) - 1)
        bearing = self.bearing[row]
        wanted = turned(sample.tilt, sample.yaw - self.place[2]) + self.roll[row]
        if tread.sole.two_sided:
            size = math.sqrt(float(wanted @ wanted))
            wanted = wanted * min(1.0, tread.settings.max_tilt / max(size, 1e-9))
        tilt = self._settled(sample.time, tread.cone(self.spread[row]).nearest(wanted))
        tilt *= self.steep[row]
        if tread.several:
            there = quat_product(about(float(self.place[2])), rotvec_quat(tilt))
            rotation = quat_matrix(there) @ tread.sole.flat
        else:
            there, rotation = sample.quat, sample.rotation
        pivot = int(bearing.argmax())
        return self.prints[pivot] - rotation @ tread.arms[pivot], there, bearing

    def _settled(self, time: float, tilt: Array) -> Array:
        """The mean of the last tilts: an average of members of a convex cone is a member."""
        settle = self.tread.settings.settle
        self._tilts.append((time, tilt))
        while self._tilts[0][0] < time - settle:
            self._tilts.popleft()
        slow = math.pi / settle
        weights = [1.01 + math.cos(slow * (time - t)) for t, _ in self._tilts]
        total: Array = np.zeros(3)
        for weight, (_, each) in zip(weights, self._tilts, strict=True):
            total += weight * each
        return total / sum(weights)
