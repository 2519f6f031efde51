"""How far differences and the low-pass smear a force in time, and what they may make of it.

A central second difference is the acceleration averaged over t - 1 to t + 1 with a hat for a
weight: the impulse of a landing shows one frame before and after anything touches. A zero-lag
Butterworth filter smears further. Its response to a shock,

    K(t) ~ exp(-x) (cos x + sin x),  x = sqrt(2) pi hz |t|,

crosses zero at x = 3 pi / 4, t = 0.53 / hz, and swings below by 4.3 % of its peak: filtered, a
floor that only pushes seems to pull a little on either side of a hard landing.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve1d
from scipy.signal import butter, sosfiltfilt

from physretarget.mjcf import smoothed

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

# First zero of the filter's response to a shock, in periods of its cut-off: 3 / (4 sqrt(2)).
MAIN_LOBE_PERIODS = 3 / (4 * math.sqrt(2))
# exp(-sqrt(2) pi 1.6) < 1e-3: what lies beyond is below any threshold.
_SUPPORT_PERIODS = 1.6
_STEPS = 60


def reach_frames(fps: float, lowpass_hz: float | None) -> int:
    """Frames by which a contact force may show before or after its contact."""
    lobe = 0.0 if lowpass_hz is None else MAIN_LOBE_PERIODS * fps / lowpass_hz
    return 1 + round(lobe)


def response(fps: float, hz: float) -> Floats:
    """(2 m + 1,) the filter's response to a shock of one frame; its sum is 1."""
    half = math.ceil(_SUPPORT_PERIODS * fps / hz)
    shock = np.zeros(4 * half + 1)
    shock[2 * half] = 1.0
    smooth = sosfiltfilt(butter(2, 2 * hz / fps, output="sos"), shock, padtype=None)
    kernel: Floats = smooth[half : 3 * half + 1] / smooth[half : 3 * half + 1].sum()
    return kernel


def pushed(required: Floats, allowed: Bools, fps: float, lowpass_hz: float | None) -> Floats:
    """(T,) what a force that only pushes, and only where ``allowed``, looks like after the filter.

    The push f >= 0 that comes nearest to ``required`` (T,) once filtered: projected gradient
    steps with momentum (Beck and Teboulle 2009) on 1/2 f.K f - f.required, K the filter.
    Without a filter it is ``required`` itself where that is allowed and positive.
    """
    push = np.where(allowed, np.maximum(required, 0.0), 0.0)
    if lowpass_hz is None or len(required) < 3 or not allowed.any():
        return push
    kernel = response(fps, lowpass_hz)
    ahead, momentum = push, 1.0
    for _ in range(_STEPS):
        step = ahead + required - convolve1d(ahead, kernel, mode="nearest")
        after = np.where(allowed, np.maximum(step, 0.0), 0.0)
        grown = 0.5 * (1 + math.sqrt(1 + 4 * momentum**2))
        ahead = after + (momentum - 1) / grown * (after - push)
        push, momentum = after, grown
    shown: Floats = convolve1d(push, kernel, mode="nearest")
    return shown


def straight(
    required: Floats, com: Floats, fps: float, lowpass_hz: float | None, gravity: float
) -> Floats:
    """(T, 3) BW, the force that the CoM's filtered path requires.

    Joints that swing fast carry the CoM along arcs, and filtered coordinates cut their corners:
    a hop's flight seems 0.1 BW off gravity at 6 Hz. ``required`` (T, 3) BW is the force of the
    filtered coordinates, ``com`` (T, 3) m the path before the filter. The same without a filter.
    """
    frames = len(com)
    if lowpass_hz is None or frames < 4:
        return required
    force = required.copy()
    for axis in range(3):  # one after the other: an hour's path is long
        path = smoothed(com[:, axis], fps, lowpass_hz)
        force[1:-1, axis] = (path[2:] - 2 * path[1:-1] + path[:-2]) * fps**2 / gravity
    force[1:-1, 2] += 1.0
    force[0], force[-1] = force[1], force[-2]
    return force


def dilated(flags: Bools, frames: int) -> Bools:
    """Stretches of True lengthened by so many frames at both ends."""
    wide = flags.copy()
    for k in range(1, min(frames, len(flags) - 1) + 1):
        wide[k:] |= flags[:-k]
        wide[:-k] |= flags[k:]
    return wide
