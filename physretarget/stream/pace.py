"""What a hopping base carries keeps its pace, as far as the past tells it.

As in the batch path (:mod:`physretarget.contact.pace`) what is carried follows the base's
correction without the hops in it. There a Gaussian takes them out; here two exponential means, one
of the other, which know no future.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from physretarget.contact.pace import bounded
from physretarget.contact.settings import ContactSettings

__all__ = ["Pace"]

Array = NDArray[np.float64]


class Pace:
    """The lead of what is carried, frame by frame."""

    def __init__(self, settings: ContactSettings, height: float) -> None:
        self.lasting, self.most = settings.pace, settings.lean * height
        self._means: list[Array] = []
        self._time = 0.0

    def lead(self, time: float, shift: Array) -> Array:
        """(2,) m, how far what is carried leans, the base being shifted by ``shift`` (2,) m."""
        if self.lasting <= 0.0 or self.most <= 0.0:
            return np.zeros(2)
        if not self._means:
            self._means = [shift.copy(), shift.copy()]
        share = 1.0 - math.exp((self._time - time) / self.lasting)
        self._time = time
        entering = shift
        for mean in self._means:
            mean += share * (entering - mean)
            entering = mean
        return bounded(entering - shift, self.most)
