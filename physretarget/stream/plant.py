"""Planted points stay where they are, as far as that can be known at the moment.

The batch path knows where each stance will be on average, and blends corrections over the flights
between (Yamane 2010, eq. (9)). A stream knows neither: a point is held where it touches down,
and whatever changes (a touch-down, a release, a new place) is eased in by the same cubic.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget.capture.actor import CONTACT_POINTS
from physretarget.mjcf import Character
from physretarget.stream.touch import Touch

__all__ = ["PlantSettings", "Planter"]

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]


NEAR = 0.002
"""A point is held while it is this near to its place, m."""
MOVED = 0.001
"""A known place that differs by this much from the last one is a new one, m."""
SUNK, LIFTED = 0.0005, 0.03
"""A free point of a standing body stands once it is this deep in the floor, until the motion has
it this high over it, m."""


@dataclass(frozen=True, kw_only=True)
class PlantSettings:
    """Times in s over which a point goes to the floor, is let go, or changes its place;
    ``reach``: distance between where a point is held and where the motion has it, as a share
    of the height, beyond which it takes a new place, lifted by ``hop`` of the height.
    """

    land: float = 0.08
    release: float = 0.25
    change: float = 0.25
    reach: float = 0.15
    hop: float = 0.04


class Planter:
    """Corrections of the character's contact points, frame by frame."""

    def __init__(self, character: Character, settings: PlantSettings | None = None) -> None:
        self.settings = settings or PlantSettings()
        self.character = character
        tied = [CONTACT_POINTS.index(t) if t in CONTACT_POINTS else -1 for t in character.tied]
        self.tied = np.array(tied, dtype=np.int64)
        count = len(tied)
        bodies = character.contacts.body
        self.same = bodies[:, None] == bodies[None]
        self.active = np.zeros(count, dtype=bool)
        self.target = np.zeros((count, 3))
        self.correction = np.zeros((count, 3))
        self.residual = np.zeros((count, 3))
        self.since = np.full(count, np.inf)
        self.over = np.full(count, 1.0)
        self.arc = np.zeros(count)
        self.reached = np.full((count, 3), np.inf)
        self.sunk = np.zeros(count, dtype=bool)
        self.shift, self.shift_residual, self.shift_since = np.zeros(3), np.zeros(3), np.inf

    def _with(self, points: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """(n,) which points are on one body with any of ``points`` (n,)."""
        return np.asarray((self.same & points).any(axis=1))

    @property
    def held(self) -> NDArray[np.bool_]:
        """(n,) which points stand and have come to rest where they shall."""
        near = np.linalg.norm(self.reached - self.target, axis=1) < NEAR
        return np.asarray(self.active & (self.since >= self.over) & near)

    @property
    def idle(self) -> NDArray[np.bool_]:
        """(n,) which points are free while another one of the same body stands."""
        return ~self.active & self._with(self.active)

    def next(
        self, touch: Touch, place: Array, step: float, known: Array | None = None
    ) -> tuple[Array, Array]:
        """Corrections (n, 3) of points that the motion has at ``place`` (n, 3); shift (3,) of all.

        The shift carries the whole body with the points that stand. ``known`` (n, 3): where
        points belong that stand, NaN for those that do not, if that is known from elsewhere.
        """
        told, floor = self.settings, self.character.floor_height
        active = (self.tied >= 0) & touch.active[self.tied]
        if known is not None:
            active = np.asarray(np.isfinite(known).all(axis=1))
        # What sinks while its body stands stands too, until the motion lifts it.
        sunk = (self.reached[:, 2] < floor - SUNK) | self.sunk
        self.sunk = sunk & self._with(active) & (place[:, 2] < floor + LIFTED)
        self.sunk &= known is None
        active = active | self.sunk
        self.since += step
        self.shift_since += step
        landed, left = active & ~self.active, self.active & ~active
        # A body that stands already is where it is, not where the motion has it.
        standing = self._with(self.active & active)
        come = np.where(standing[:, None], self.reached, place + self.correction)
        self.target[landed] = come[landed]
        self.target[landed, 2] = floor
        far = self._moved_on(active & ~landed, place, known)
        if known is not None:
            self.target[active] = known[active]
        changed = landed | left | far
        changes_shift = bool(changed.any())
        self.active = active
        goal = np.where(active[:, None], self.target - place, 0.0)
        shift_goal = goal[active].mean(axis=0) if active.any() else np.zeros(3)
        if changes_shift:
            self.shift_residual, self.shift_since = self.shift - shift_goal, 0.0
        fade = 1.0 - _eased(self.shift_since / told.change)
        self.shift = shift_goal + fade * self.shift_residual
        goal[~active] = self.shift
        self.residual[changed] = self.correction[changed] - goal[changed]
        self.since[changed] = 0.0
        self.over[landed], self.over[left], self.over[far] = told.land, told.release, told.change
        self.arc[changed] = 0.0
        self.arc[far] = told.hop * self.character.height if known is None else 0.0
        share = np.minimum(self.since / self.over, 1.0)
        self.correction = goal + (1.0 - _eased(share))[:, None] * self.residual
        self.correction[:, 2] += 4.0 * self.arc * share * (1.0 - share)
        low = floor - place[:, 2]
        self.correction[:, 2] = np.maximum(self.correction[:, 2], low)
        return self.correction, self.shift

    def _moved_on(self, standing: Bools, place: Array, known: Array | None) -> Bools:
        """(n,) which of the standing points take a new place now; the whole sole goes along."""
        if known is not None:
            away = np.linalg.norm(np.nan_to_num(known - self.target), axis=1)
            return np.asarray(standing & (away > MOVED))
        away = np.linalg.norm((self.target - place)[:, :2], axis=1)
        far = np.asarray(standing & (away > self.settings.reach * self.character.height))
        if far.any():
            far |= standing & self._with(far)
            self.target[far] = place[far]
            self.target[far, 2] = self.character.floor_height
        return far


def _eased(share: Array | float) -> Array:
    """Eq. (9)'s weight h²(3 - 2h), one from the end on."""
    h = np.minimum(share, 1.0)
    result: Array = h * h * (3.0 - 2.0 * h)
    return result
