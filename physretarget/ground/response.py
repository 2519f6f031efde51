"""What differences and a low-pass make of a force: how far it shows, and how it rings.

A central second difference is the acceleration averaged over t - 1 to t + 1 with a hat for a
weight: the impulse of a landing shows one frame before and after anything touches. A zero-lag
Butterworth filter smears further. Its response to a shock,

    K(t) ~ exp(-x) (cos x + sin x),  x = sqrt(2) pi hz |t|,

crosses zero at x = 3 pi / 4, t = 0.53 / hz, and swings below by 4.3 % of its peak: filtered, a
floor that only pushes seems to pull a little on either side of a hard landing.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve1d, maximum_filter1d
from scipy.signal import butter, sosfiltfilt

from physretarget.ground.support import nearest_force

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

# First zero of the filter's response to a shock, in periods of its cut-off: 3 / (4 sqrt(2)).
MAIN_LOBE_PERIODS = 3 / (4 * math.sqrt(2))
# exp(-sqrt(2) pi 1.6) < 1e-3: what lies beyond is below any threshold.
_SUPPORT_PERIODS = 1.6
_STEPS = 60
# Frames after which the filter has forgotten its start, cut-offs near half the frame rate too.
_RINGS = 40


def reach_frames(fps: float, lowpass_hz: float | None) -> int:
    """Frames by which a contact force may show before or after its contact."""
    lobe = 0.0 if lowpass_hz is None else MAIN_LOBE_PERIODS * fps / lowpass_hz
    return 1 + round(lobe)


@lru_cache(maxsize=64)
def response(fps: float, hz: float) -> Floats:
    """(2 m + 1,) the filter's response to a shock of one frame, read-only; its sum is 1."""
    half = math.ceil(_SUPPORT_PERIODS * fps / hz)
    shock = np.zeros(4 * half + 1)
    shock[2 * half] = 1.0
    smooth = sosfiltfilt(butter(2, 2 * hz / fps, output="sos"), shock, padtype=None)
    kernel: Floats = smooth[half : 3 * half + 1] / smooth[half : 3 * half + 1].sum()
    kernel.flags.writeable = False  # every caller has the same
    return kernel


def filtered(values: Floats, fps: float, hz: float | None) -> Floats:
    """Forces or moments (T, n) after the filter, as if they went on beyond the ends mirrored."""
    if hz is None or len(values) < 3:
        return values
    pad = min(len(values) - 1, math.ceil(3 * fps / hz) + _RINGS)
    smooth: Floats = sosfiltfilt(
        butter(2, 2 * hz / fps, output="sos"), values, axis=0, padtype="even", padlen=pad
    )
    return smooth


def explained_force(
    required: Floats, friction: Floats, fps: float, lowpass_hz: float | None
) -> Floats:
    """(T, 3) the force nearest to ``required`` (T, 3) that contacts can give, after the filter.

    ``friction`` (T,) is the coefficient where contacts may act, NaN where nothing touches. The
    forces f in their cones that come nearest once filtered: projected gradient steps with momentum
    (Beck and Teboulle 2009) on 1/2 f.K f - f.required, K the filter. Without a filter each frame is
    projected on its cone, and that is all.
    """
    allowed = ~np.isnan(friction)
    rough = np.where(allowed, friction, 0.0)

    def admissible(force: Floats) -> Floats:
        return np.where(allowed[:, None], nearest_force(force, rough), 0.0)

    push = admissible(required)
    if lowpass_hz is None or len(required) < 3 or not allowed.any():
        return push
    kernel = response(fps, lowpass_hz)
    ahead, momentum = push, 1.0
    for _ in range(_STEPS):
        step = ahead + required - convolve1d(ahead, kernel, axis=0, mode="mirror")
        after = admissible(step)
        grown = 0.5 * (1 + math.sqrt(1 + 4 * momentum**2))
        ahead = after + (momentum - 1) / grown * (after - push)
        push, momentum = after, grown
    shown: Floats = convolve1d(push, kernel, axis=0, mode="mirror")
    return shown


def side_lobes(force: Floats, arm: Floats, fps: float, lowpass_hz: float | None) -> Floats:
    """(T,) moment that the filter's side lobes may show of forces (T, 3) on arms (T, 3).

    A shock that shows as K(0) where it happens shows as K(t) elsewhere, and where that is below 0
    no contact gives it. What acts there on the same arm is only less for it; the rest is as long
    as the way between the arms.
    """
    size: Floats = np.linalg.norm(force, axis=1)
    shown = np.zeros(len(size))
    if lowpass_hz is None:
        return shown
    kernel = response(fps, lowpass_hz)
    middle = len(kernel) // 2
    for away in (np.flatnonzero(kernel < 0) - middle).tolist():
        if abs(away) >= len(size):
            continue
        share = -kernel[middle + away] / kernel[middle]
        there = slice(max(0, away), len(size) + min(0, away))
        source = slice(max(0, -away), len(size) - max(0, away))
        way = np.linalg.norm(arm[source] - arm[there], axis=1)
        shown[there] = np.maximum(shown[there], share * size[source] * way)
    return shown


def near_contact(friction: Floats) -> Floats:
    """(T,) friction where contacts act, NaN elsewhere: also in the frames before and after.

    What acts between two frames shows in both.
    """
    grip = np.nan_to_num(friction, nan=-1.0)
    wide = maximum_filter1d(grip, 3, mode="nearest") if len(grip) else grip
    # A clip's first and last frame take their force from their neighbours, a frame further on.
    if len(grip) > 2:
        wide[0], wide[-1] = max(wide[0], wide[1]), max(wide[-1], wide[-2])
    return np.where(wide < 0, np.nan, wide)


def dilated(flags: Bools, frames: int) -> Bools:
    """Stretches of True lengthened by so many frames at both ends."""
    wide = flags.copy()
    for k in range(1, min(frames, len(flags) - 1) + 1):
        wide[k:] |= flags[:-k]
        wide[:-k] |= flags[k:]
    return wide
