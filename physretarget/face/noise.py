"""How uncertain each frame of a capture is, measured from the capture itself.

A device misreads values by a steady amount and times by a little: late or early frames deviate by
the channel's speed times the delay. Both parts are read off the deviations from a short local
parabola, which are regressed on the squared speed; frames then count by their reliability.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_coeffs, savgol_filter

Array = NDArray[np.float64]
_MOST_JITTER = 0.6  # frames: one frame early or late, evenly spread, has a deviation of 0.577


@dataclass(frozen=True)
class Noise:
    """Standard deviations: steady, in the channel's units; jitter of the frames' times, frames."""

    steady: float
    jitter: float


def half_window(fps: float) -> int:
    """Frames on either side of the local parabola: about a twentieth of a second, at least 2."""
    return max(2, round(0.055 * fps))


def smoothed(values: Array, fps: float) -> Array:
    """Quadratic Savitzky-Golay over about a tenth of a second: extrema stay, noise halves."""
    window = 2 * half_window(fps) + 1
    if values.shape[-1] < window:
        return values.copy()
    return np.asarray(savgol_filter(values, window, 2, axis=-1), dtype=np.float64)


def measure_noise(values: Array, smooth: Array, fps: float) -> Noise:
    """Both parts for one channel (M,) and its smoothed self, by reweighted least squares."""
    window = 2 * half_window(fps) + 1
    if len(values) < 2 * window:
        return Noise(0.0, 0.0)
    kept = 1.0 - float(savgol_coeffs(window, 2)[window // 2])  # share of noise not smoothed away
    squared = (values - smooth) ** 2 / kept
    speed = np.gradient(smooth) ** 2
    steady, jitter = float(squared.mean()), 0.0
    floor = 1e-12 + 1e-6 * float(np.ptp(smooth)) ** 2
    for _ in range(6):
        scale = 1.0 / (steady + jitter * speed + floor)
        steady, jitter = _two_parts(squared * scale, scale, speed * scale)
    return Noise(float(np.sqrt(steady)), min(_MOST_JITTER, float(np.sqrt(jitter))))


def _two_parts(target: Array, one: Array, other: Array) -> tuple[float, float]:
    """Least squares target = a * one + b * other with neither below zero."""
    aa, ab, bb = float(one @ one), float(one @ other), float(other @ other)
    at, bt = float(one @ target), float(other @ target)
    det = aa * bb - ab * ab
    if det > 1e-12 * aa * bb:
        a, b = (at * bb - bt * ab) / det, (bt * aa - at * ab) / det
        if a >= 0 and b >= 0:
            return a, b
    alone_a = max(0.0, at / aa) if aa > 0 else 0.0
    alone_b = max(0.0, bt / bb) if bb > 0 else 0.0
    # Whichever part alone explains more.
    return (alone_a, 0.0) if alone_a * at >= alone_b * bt else (0.0, alone_b)


def reliability(smooth: Array, noise: Noise, fidelity: float) -> Array:
    """(M,) weight of every frame, 1 where the channel rests: fidelity beside the jitter's part."""
    late = (noise.jitter * np.gradient(smooth)) ** 2
    weights: Array = fidelity**2 / (fidelity**2 + late)
    return weights
