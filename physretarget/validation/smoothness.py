"""Smoothness: dimensionless jerk of body origins over a sliding window."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from physretarget.mjcf import Character

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

# Hogan and Sternad 2009: D^3 / v_peak^2 times the integral of squared jerk over a movement of
# duration D. A minimum-jerk reach scores 204.8.
WINDOW_S = 0.5
# Slower than this many CoM heights per second counts as this: at rest the ratio is 0/0.
_SLOWEST = 0.5
# The third difference leaves out three frames at the ends, a tenth of a second at 30 frames/s: the
# same time is left out at any rate, or a finer clip would show more of its ends.
EDGE_S = 0.1
# Finer clips are looked at over steps of this rate. A foot's blow lasts milliseconds: from 500
# frames/s on, every step of a simulation would count as trembling. Tremor has 12 Hz at most.
_RATE = 120.0


@dataclass(frozen=True, eq=False)
class Jerk:
    """Dimensionless jerk in the window around each frame.

    Attributes:
        worst: (T,) of the body that has most.
        body: (T,) which that is.
    """

    worst: Floats
    body: Ints


def edge_frames(fps: float) -> int:
    """Frames at a clip's ends of which jerk is not judged: filters and splines whip there."""
    return max(3, math.ceil(EDGE_S * fps))


def windowed_jerk(position: Floats, time: Floats, keep: slice, character: Character) -> Jerk | None:
    """Jerk of bodies at ``position`` (T, nb, 3), with neighbours; None for clips shorter than the
    seven points that the difference formula needs.
    """
    frames = len(time)
    if frames < 7:
        return None
    step = float(time[1] - time[0])
    span = max(1, round(1 / (step * _RATE)))
    if frames <= 6 * span:
        return None
    jerk = _jerk(position, span, span * step)
    p = position
    edge = edge_frames(1 / step)
    jerk[:edge], jerk[-edge:] = 0, 0
    speed = np.zeros(p.shape[:2])
    speed[1:-1] = np.linalg.norm(p[2:] - p[:-2], axis=2) / (2 * step)
    squared = np.sum(jerk**2, axis=2)
    half = WINDOW_S / step / 2
    area = np.zeros_like(squared)
    area[1:] = np.cumsum(0.5 * (squared[1:] + squared[:-1]) * step, axis=0)
    integral = _shifted(area, half) - _shifted(area, -half)
    slowest = _SLOWEST * max(character.com_height, 1e-3)
    peak = np.maximum(_window_max(speed, half), slowest)
    bodies = np.asarray(character.bodies, dtype=np.int64)
    ratio = (WINDOW_S**3 * integral / peak**2)[keep]
    worst = ratio.argmax(axis=1)
    return Jerk(ratio[np.arange(len(ratio)), worst], bodies[worst])


def _jerk(position: Floats, span: int, step: float) -> Floats:
    """Third differences of fourth order over points ``span`` frames, ``step`` s, apart.

    Exact enough that 30 and 120 Hz agree; zero at the ends, which have no neighbours.
    """
    inner = len(position) - 6 * span
    p = [position[k * span : k * span + inner] for k in range(7)]
    jerk = np.zeros_like(position)
    jerk[3 * span : -3 * span] = p[0] - 8 * p[1] + 13 * p[2] - 13 * p[4] + 8 * p[5] - p[6]
    jerk /= 8 * step**3
    return jerk


def _shifted(values: Floats, frames: float) -> Floats:
    """Values (T, n) so many frames later, between frames by interpolation; ends go on.

    A window of whole frames would be 7 % too long at 30 frames/s, and a foot's speed at its rim
    changes faster than that.
    """
    place = np.clip(np.arange(len(values)) + frames, 0, len(values) - 1)
    before = np.floor(place).astype(np.int64)
    share = (place - before)[:, None]
    after = np.minimum(before + 1, len(values) - 1)
    between: Floats = (1 - share) * values[before] + share * values[after]
    return between


def _window_max(values: Floats, half: float) -> Floats:
    """The largest value within ``half`` frames, which need not be whole."""
    wide = maximum_filter1d(values, 2 * math.floor(half) + 1, axis=0, mode="nearest")
    for rim in (-half, half):
        wide = np.maximum(wide, _shifted(values, rim))
    return wide
