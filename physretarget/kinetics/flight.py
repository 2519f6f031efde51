"""What flights say about a fitted body: nothing but gravity acts on it while nothing touches.

The centre of mass of a fitted actor follows markers and rigid segments. Organs and muscles do
not: when a body bounces they lag behind its frame. Hopping in place, nine kilograms of viscera
move against it by 5 to 8 cm (Minetti and Belli 1994), which is 6 to 10 mm of the centre of mass,
and in the flights of runs the accelerations of published kinematic models are 14 to 36 % of
gravity off (Le Mouel 2025). No table of segment masses can tell, but the flights of the very
capture can: their acceleration must be g.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget.kinematics import runs

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

GRAVITY = 9.81  # m/s², MuJoCo's and this package's

_EDGE = 0.015  # s left out at both ends of a flight, and 1.5 frames: as contacts are found
_EDGE_FRAMES = 1.5
_NOISE = 5e-4  # m, of a fitted centre of mass about a parabola: 0.2 to 0.5 mm in jumps
_SCATTER = 0.05  # between the flights of one body, as a share of g: limbs move differently
_SPREAD = 0.2  # between bodies: the middle of the 14 to 36 % of Le Mouel 2025, either way
WORST = (
    0.36  # off g: the worst model of Le Mouel 2025; more is no body's but a clock's or a scale's
)
_FALLS = (0.5, 1.6)  # g: what falls slower or faster is no flight but an unseen support


@dataclass(frozen=True, kw_only=True)
class Flights:
    """What the flights of a motion show.

    Attributes:
        count: of flights that can be measured.
        fall: their mean acceleration, in g; 1 where there are none.
        gain: change of predicted vertical force per change of the true one; 1 is perfect, and
            stands where ``fall`` is so far off that it cannot be the body's (``WORST``).
    """

    count: int = 0
    fall: float = 1.0
    gain: float = 1.0


def measure_flights(height: Floats, airborne: Bools, time: Floats) -> Flights:
    """By how much a fitted centre of mass moves more than the body's, and from how many flights.

    Every flight gives the acceleration of a parabola through it, in g; their mean, weighted by
    what noise leaves of each, is drawn to 1 as far as it is uncertain. Without flights it is 1.

    Args:
        height: (T,) m of the centre of mass, not filtered: a filter carries stance into flight.
        airborne: (T,) frames in which nothing touches.
        time: (T,) s.
    """
    if len(time) < 4:
        return Flights()
    edge = max(_EDGE, _EDGE_FRAMES * float(time[-1] - time[0]) / (len(time) - 1)) - 1e-6
    accelerations, weights = [], []
    for first, last in runs(airborne):
        if first == 0 or last == len(time) - 1:
            continue  # it may have begun or ended elsewhere than in flight
        span = time[first : last + 1]
        clear = (span > time[first - 1] + edge) & (span < time[last + 1] - edge)
        inside = first + np.flatnonzero(clear)
        if len(inside) < 3:
            continue
        moment = time[inside] - time[inside].mean()
        fall = -2 * float(np.polyfit(moment, height[inside], 2)[0]) / GRAVITY
        if not _FALLS[0] < fall < _FALLS[1]:
            continue
        accelerations.append(fall)
        weights.append(1 / (_parabola_error(moment) ** 2 + _SCATTER**2))
    if not accelerations:
        return Flights()
    certainty, usual = float(np.sum(weights)), 1 / _SPREAD**2
    fall = float(np.dot(weights, accelerations)) / certainty
    gain = (certainty * fall + usual) / (certainty + usual)
    bodily = abs(fall - 1) <= WORST
    return Flights(count=len(accelerations), fall=fall, gain=gain if bodily else 1.0)


def _parabola_error(time: Floats) -> float:
    """Standard error, in g, of a parabola's acceleration through noisy heights at ``time``."""
    columns = np.stack([np.ones_like(time), time, time**2], axis=1)
    covariance = np.linalg.inv(columns.T @ columns)
    return 2 * _NOISE * float(np.sqrt(covariance[2, 2])) / GRAVITY
