"""How uncertain a capture's values are, measured from the capture itself.

A device misreads values by a steady amount and times by a little: a late frame deviates by the
channel's speed times the delay. The steady part is read off the deviations from a short local
parabola where the channel is slow.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_coeffs, savgol_filter

Array = NDArray[np.float64]


def half_window(fps: float) -> int:
    """Frames on either side of the local parabola: about a twentieth of a second, at least 2."""
    return max(2, round(0.055 * fps))


def smoothed(values: Array, fps: float) -> Array:
    """Quadratic Savitzky-Golay over about a tenth of a second: extrema stay, noise halves."""
    window = 2 * half_window(fps) + 1
    if values.shape[-1] < window:
        return values.copy()
    return np.asarray(savgol_filter(values, window, 2, axis=-1), dtype=np.float64)


_WIDTHS = np.array([0.0, 0.3, 0.5, 0.7, 0.9, 1.1, 1.3, 1.6, 2.0, 2.5, 3.0])
_MEDIAN = 0.455  # of the square of a standard normal deviate
_LEAST = 2e-3  # of what the channel moves
_FEW = 12  # slow frames that a level may be read off
_PLAIN = 0.45  # frames: narrower smoothing than this is not told from none


def noise_level(values: Array, smooth: Array, fps: float, jitter: float = 1.0 / 3.0) -> Array:
    """(C,) standard deviation of steady noise, as it was before anybody smoothed the capture.

    A capture that has been smoothed has little noise from frame to frame, but over a span of keys
    as much as before. What is left of it beside the local parabola betrays the smoothing: white
    noise turns about from frame to frame, smoothed noise does not. Width and level are those of
    white noise under a Gaussian filter whose rest has this variance and neighbour correlation; one
    width for all channels of a take.

    Args:
        values: (C, M) channels.
        smooth: the same, by ``smoothed``.
        fps: frame rate.
        jitter: variance of the frames' times, frames squared.
    """
    window = 2 * half_window(fps) + 1
    if values.shape[-1] < 2 * window:
        return np.zeros(len(values))
    gain, turn = _betrayal(window)
    rest = values - smooth
    late = jitter * np.gradient(smooth, axis=1) ** 2
    typical = np.median(rest**2, axis=1, keepdims=True) / 0.45 + late * gain[0] + 1e-12
    clipped = np.clip(rest / np.sqrt(typical), -3.0, 3.0)
    correlation = np.sum(clipped[:, 1:] * clipped[:, :-1]) / max(float(np.sum(clipped**2)), 1e-12)
    width = float(np.interp(correlation, turn, _WIDTHS))
    kept = float(np.interp(width if width > _PLAIN else 0.0, _WIDTHS, gain))
    return np.array([_steady(r**2 / kept, slow) for r, slow in zip(rest, late, strict=True)])


def _steady(squared: Array, late: Array) -> float:
    """Deviation of the slow frames, by their median: blinks and other short swings do not count."""
    level = max(float(np.median(squared)) / _MEDIAN, _LEAST**2)
    for _ in range(6):
        slow = late <= level
        if slow.sum() < _FEW:
            slow = late <= np.sort(late)[min(_FEW, len(late)) - 1]
        own = float(np.median(squared[slow] - late[slow])) / _MEDIAN
        level = max(own, _LEAST**2)
    return float(np.sqrt(level))


@lru_cache(maxsize=8)
def _betrayal(window: int) -> tuple[Array, Array]:
    """Variance and neighbour correlation of what the parabola leaves of unit noise, per width."""
    count, half = 4096, window // 2
    kernel = np.zeros(count)
    weights = savgol_coeffs(window, 2)
    kernel[: half + 1], kernel[-half:] = weights[half:], weights[:half]
    frequency = np.fft.rfftfreq(count)
    rest = np.abs(1.0 - np.fft.rfft(kernel)) ** 2
    power = rest * np.exp(-((2 * np.pi * frequency * _WIDTHS[:, None]) ** 2))
    gain = 2.0 * np.trapezoid(power, frequency, axis=1)
    turn = 2.0 * np.trapezoid(power * np.cos(2 * np.pi * frequency), frequency, axis=1) / gain
    return gain, turn
