"""Eq. (9) of Yamane 2010 frame by frame: corrections blended over flights that are foreseen.

As in the batch path (:mod:`physretarget.contact.track`) what is blended is the correction of a
body's rigid placement. Where the next stance will be is only foreseen: in every frame the cubic
begins anew, from where the correction is and how fast it goes. As long as what is foreseen stays
the same, that is the same cubic.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from physretarget.stream.foresee import Sample
from physretarget.stream.turns import Quat, about, quat_product, quat_rotvec, rotvec_quat, twist

__all__ = ["Blend"]

Array = NDArray[np.float64]

FASTEST = 1.2
"""Corrections change no faster than this times sqrt(g · height)."""


class Blend:
    """The correction (7,) of one sole: shift (3,), turn about the vertical, the rest's vector (3,).

    ``value`` is None before anything is known.
    """

    def __init__(self, height: float, gravity: float, value: Array | None) -> None:
        self.value = value
        self.rate = np.zeros(7)
        self.residual = np.zeros(7)
        self.fastest = FASTEST * math.sqrt(gravity * height)

    def between(self, sample: Sample, centre: Array, there: Quat) -> Array:
        """From a sample to a centre and a turn ``there`` from where the sole is flat."""
        yaw = math.remainder(twist(there) - sample.yaw, 2.0 * math.pi)
        if self.value is not None:  # no turn by a whole circle from frame to frame
            yaw += 2.0 * math.pi * round((float(self.value[3]) - yaw) / (2.0 * math.pi))
        w, x, y, z = quat_product(about(yaw), sample.quat)
        correction = np.empty(7)
        np.subtract(centre, sample.centre, out=correction[:3])
        correction[3] = yaw
        correction[4:] = quat_rotvec(quat_product(there, (w, -x, -y, -z)))
        return correction

    def leave(self) -> None:
        """A flight begins, from rest."""
        self.rate = np.zeros(7)

    def stay(self) -> None:
        """Go on in a flight to nowhere."""
        if self.value is None:
            self.value = np.zeros(7)

    def approach(self, goal: Array, step: float, left: float, *, linear: bool) -> None:
        """Go one ``step`` s of the cubic that reaches ``goal`` with no rate in ``left`` s.

        ``linear``: of a straight line instead.
        """
        assert self.value is not None
        goal = goal.copy()
        goal[3] = self.value[3] + math.remainder(goal[3] - self.value[3], 2.0 * math.pi)
        gap = goal - self.value
        left = max(left, self._lasts(gap))
        h = min(step / max(left, 1e-9), 1.0)
        if linear:
            self.rate = gap / max(left, 1e-9)
            self.value = self.value + h * gap
            return
        slope = self.rate * left
        self.value = self.value + h * h * (3.0 - 2.0 * h) * gap + h * (1.0 - h) ** 2 * slope
        rate = 6.0 * h * (1.0 - h) * gap + (1.0 - h) * (1.0 - 3.0 * h) * slope
        self.rate = rate / max(left, 1e-9)

    def land(self, goal: Array) -> None:
        """A stance begins that asks for ``goal``: what the correction lacks is to fade."""
        self.residual = np.zeros(7)
        if self.value is not None:
            self.residual = self.value - goal
            self.residual[3] = math.remainder(self.residual[3], 2.0 * math.pi)

    def stand(self, goal: Array, since: float, fade: float) -> None:
        """Go on in a stance that began ``since`` s ago; residuals fade in ``fade`` s or slower."""
        fade = max(fade, 1.5 * self._lasts(self.residual))
        share = min(since / fade, 1.0)
        self.value = goal + (1.0 - share * share * (3.0 - 2.0 * share)) * self.residual

    def turn(self) -> Quat:
        """By how much the correction turns the body."""
        assert self.value is not None
        return quat_product(rotvec_quat(self.value[4:]), about(float(self.value[3])))

    def _lasts(self, gap: Array) -> float:
        """The shortest time for a change of the correction, s."""
        return math.hypot(gap[0], gap[1]) / self.fastest
