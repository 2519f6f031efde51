"""How high a sole is thrown in its flights, where their ends are foreseen anew in every frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = ["Arc", "Throw"]

SEAM = 0.06
"""Time constant with which the height follows a flight that is foreseen otherwise now, s."""


@dataclass(frozen=True)
class Throw:
    """A parabola in time, from ``start`` to ``end`` s, ``rise`` m high."""

    start: float
    end: float
    rise: float

    def at(self, time: float) -> float:
        """The height at a time, m; zero before and after."""
        share = min(max((time - self.start) / max(self.end - self.start, 1e-9), 0.0), 1.0)
        return 4.0 * self.rise * share * (1.0 - share)


class Arc:
    """The highest of the throws foreseen; what another forecast changes at once is eased in."""

    def __init__(self) -> None:
        self.throws: tuple[Throw, ...] = ()
        self.residual = 0.0

    def foresee(self, time: float, throws: tuple[Throw, ...]) -> float:
        """The height by these throws from now on, m, before :meth:`eased`; none while standing."""
        now = _highest(throws, time)
        if throws != self.throws:
            self.residual += _highest(self.throws, time) - now
            self.throws = throws
        return now

    def eased(self, height: float, step: float) -> float:
        """With what remains, ``step`` s later, of the leaps between forecasts; never negative."""
        self.residual *= math.exp(-step / SEAM)
        return max(height + self.residual, 0.0)


def _highest(throws: tuple[Throw, ...], time: float) -> float:
    return max((throw.at(time) for throw in throws), default=0.0)
