"""Jitter: dimensionless jerk of body origins over a sliding window."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from physretarget.mjcf import Character

Floats = NDArray[np.float64]
Series = dict[str, NDArray[np.generic]]

# Hogan and Sternad 2009: D^3 / v_peak^2 times the integral of squared jerk over a movement of
# duration D. A minimum-jerk reach scores 204.8.
WINDOW_S = 0.5
# Slower than this many CoM heights per second counts as this: at rest the ratio is 0/0.
_SLOWEST = 0.5
_CUTS = (-1.0, -0.5, 0.0, 0.5, 1.0)


def windowed_jerk(position: Floats, time: Floats, keep: slice, character: Character) -> Series:
    """(T,) worst dimensionless jerk over the bodies, in the window around each frame.

    ``jerk`` is the textbook's; ``jitter`` leaves single shocks out.

    ``position`` (T, nb, 3) with neighbours; nothing is returned for clips shorter than the
    seven frames that the difference formula needs.
    """
    frames = len(time)
    if frames < 7:
        return {}
    step = float(time[1] - time[0])
    p = position
    # Fourth-order third difference: exact enough that 30 and 120 Hz agree.
    jerk = np.zeros_like(p)
    jerk[3:-3] = (p[:-6] - 8 * p[1:-5] + 13 * p[2:-4] - 13 * p[4:-2] + 8 * p[5:-1] - p[6:]) / (
        8 * step**3
    )
    speed = np.zeros(p.shape[:2])
    speed[1:-1] = np.linalg.norm(p[2:] - p[:-2], axis=2) / (2 * step)
    squared = np.sum(jerk**2, axis=2)
    half = max(1, round(WINDOW_S / step / 2))
    total = np.vstack([np.zeros(p.shape[1]), np.cumsum(squared, axis=0)])
    cuts = [np.clip(np.arange(frames) + round(half * c), 0, frames) for c in _CUTS]
    parts = np.stack([total[b] - total[a] for a, b in pairwise(cuts)]) * step
    integral = parts.sum(axis=0)
    # One landing fills one quarter of the window, two where it lies on a cut: trembling fills
    # them all. The second smallest stands for every quarter.
    steady = len(parts) * np.partition(parts, 1, axis=0)[1]
    slowest = _SLOWEST * max(character.com_height, 1e-3)
    peak = np.maximum(_sliding_max(speed, half), slowest)
    bodies = np.asarray(character.bodies, dtype=np.int64)
    series: Series = {}
    for name, value in (("jerk", integral), ("jitter", steady)):
        ratio = (WINDOW_S**3 * value / peak**2)[keep]
        worst = ratio.argmax(axis=1)
        series[name] = ratio[np.arange(len(ratio)), worst]
        series[f"{name}_body"] = bodies[worst]
    return series


def _sliding_max(values: Floats, half: int) -> Floats:
    wide: Floats = maximum_filter1d(values, 2 * half + 1, axis=0, mode="nearest")
    return wide
