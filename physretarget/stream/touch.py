"""Contact phases as they happen: the thresholds of the batch path, without its look ahead."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget.capture.actor import CONTACT_POINTS
from physretarget.contact.detect import FEET, DetectionSettings

__all__ = ["Touch", "Toucher"]

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

LEG = 0.9
"""Length of the leg that the thresholds are stated for, m."""
HORIZON = 0.15
"""Touch-downs are foreseen this far ahead, s."""
AGAIN = 0.05
"""Rest heights are found anew so often, s."""
BIN, LOWEST = 0.002, -0.5
"""Slow heights are counted in bins of 2 mm from half a metre below zero."""


@dataclass(frozen=True, eq=False)
class Touch:
    """The actor's contact points at one instant, in the order of ``CONTACT_POINTS``.

    ``active`` (10,) planted now. ``landing`` (10,) s until touch-down if the point goes on
    falling as it does; infinite where none is foreseen, zero while planted. ``clearance`` m from
    the lowest foot to the floor.
    """

    active: Bools
    landing: Array
    clearance: float = 0.0


class Toucher:
    """Hysteresis on height and speed of each point, one frame after the other.

    Speeds are backward differences, smoothed as strongly as the batch path's filter; the rest
    height of a foot point is the lower decile of its slow heights so far.
    """

    def __init__(self, leg_length: float, settings: DetectionSettings | None = None) -> None:
        self.settings = settings or DetectionSettings()
        self.scale = leg_length / LEG
        self.active = np.zeros(len(CONTACT_POINTS), dtype=bool)
        self.before: Array | None = None
        self.velocity = np.zeros((len(CONTACT_POINTS), 3))
        self.feet = np.array([CONTACT_POINTS.index(name) for name in FEET])
        self.counts = np.zeros((len(FEET), round(-2.0 * LOWEST / BIN)))
        self.rest = np.zeros(len(CONTACT_POINTS))
        self.age = 0.0

    def next(self, place: Array, step: float) -> Touch:
        """Points at ``place`` (10, 3), ``step`` s after the last ones."""
        told = self.settings
        if self.before is not None and step > 0:
            share = 1.0 - math.exp(-step * 2.0 * math.pi * told.lowpass_hz)
            self.velocity += share * ((place - self.before) / step - self.velocity)
        self.before = np.array(place)
        speed = np.sqrt(np.einsum("nc,nc->n", self.velocity, self.velocity)) / self.scale**0.5
        self._rest(place[:, 2], speed, step)
        height = (place[:, 2] - self.rest) / self.scale
        low = height < told.height_on
        hold = (height < told.height_off) & (speed < told.speed_off)
        hold |= low & (speed < told.speed_slide)
        self.active = (low & (speed < told.speed_on)) | (self.active & hold)
        falling = self.velocity[:, 2] / -self.scale
        landing: Array = np.maximum(height, 1e-3) / np.maximum(falling, 1e-9)
        landing[(falling <= 0.05) | (landing > HORIZON)] = np.inf
        landing[self.active] = 0.0
        clearance = float(height[self.feet].min()) * self.scale
        return Touch(self.active.copy(), landing, max(clearance, 0.0))

    def _rest(self, height: Array, speed: Array, step: float) -> None:
        feet = height[self.feet]
        for k, (high, fast) in enumerate(
            zip(feet.tolist(), speed[self.feet].tolist(), strict=True)
        ):
            where = int((high - LOWEST) / BIN)
            if fast < self.settings.speed_off and 0 <= where < self.counts.shape[1]:
                self.counts[k, where] += 1.0
        self.age += step
        if 0.0 < self.age < AGAIN:  # the deciles move slowly, and take time to find
            return
        self.age = 0.0
        total = np.cumsum(self.counts, axis=1)
        seen = total[:, -1] > 0
        decile = np.argmax(total >= 0.1 * total[:, -1:], axis=1) * BIN + LOWEST + 0.5 * BIN
        if self.settings.floor_m is not None:
            floor = self.settings.floor_m
        else:
            floor = float(decile[seen].min()) if seen.any() else float(feet.min())
        self.rest[:] = floor
        near = seen & (np.abs(decile - floor) < self.settings.rest_spread * self.scale)
        self.rest[self.feet[near]] = decile[near]
