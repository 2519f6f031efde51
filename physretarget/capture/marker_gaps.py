"""Markers that leap or are not seen: leaps become gaps, short gaps are interpolated."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import maximum_filter1d

from physretarget.capture.recording import Floats
from physretarget.kinematics import runs

_LEAP = 5.0  # m/s
_AROUND_LEAP = 0.05  # s
_AWAY = 0.5  # s; a second leap within this time is the way back


def leaps_blanked(position: Floats, fps: float, notes: list[str]) -> Floats:
    """Markers without the moments around a leap that no body makes.

    Labelling software swaps markers or fills gaps badly: then one step is faster, by more
    than 5 m/s, than the marker is two frames before and after.
    """
    if len(position) < 6:
        return position
    speed = np.linalg.norm(np.diff(position, axis=0), axis=-1) * fps
    around = np.fmax(np.nan_to_num(speed[:-4]), np.nan_to_num(speed[4:]))
    leap = np.zeros(position.shape[:2], dtype=bool)
    leap[2:-3] = np.nan_to_num(speed[2:-2]) > around + _LEAP
    if not leap.any():
        return position
    leapt = (int(leap.any(axis=0).sum()), int(leap.any(axis=1).sum()))
    for k in np.flatnonzero(leap.any(axis=0)):
        frames = np.flatnonzero(leap[:, k])
        for there, back in pairwise(frames):
            if back - there <= _AWAY * fps:
                leap[there:back, k] = True
    wide = max(1, round(_AROUND_LEAP * fps))
    doubtful = maximum_filter1d(leap, size=2 * wide + 1, axis=0)
    notes.append(
        f"{leapt[0]} {'marker leaps' if leapt[0] == 1 else 'markers leap'} in {leapt[1]} "
        f"{'frame' if leapt[1] == 1 else 'frames'}: {1000 * _AROUND_LEAP:.0f} ms on either "
        "side, and what lies between there and back, were taken for gaps"
    )
    return np.where(doubtful[..., None], np.nan, position)


def short_gaps_filled(position: Floats, longest: float, notes: list[str]) -> Floats:
    """Gaps of at most ``longest`` frames between visible ones, interpolated without overshoot."""
    filled = position.copy()
    count, long = 0, 0
    for k in range(position.shape[1]):
        seen = np.asarray(np.isfinite(position[:, k]).all(axis=-1))
        if seen.all():
            continue
        gaps = [(first, last + 1) for first, last in runs(~seen)]
        short = [(a, b) for a, b in gaps if b - a <= longest and a > 0 and b < len(seen)]
        long += len(gaps) - len(short)
        if short and seen.sum() >= 2:
            frames = np.flatnonzero(seen)
            curve = PchipInterpolator(frames, position[frames, k])
            for a, b in short:
                filled[a:b, k] = curve(np.arange(a, b))
            count += len(short)
    if count:
        many = "1 short marker gap was" if count == 1 else f"{count} short marker gaps were"
        notes.append(f"{many} interpolated")
    if long:
        many = "1 long marker gap was" if long == 1 else f"{long} long marker gaps were"
        notes.append(f"{many} left open: the other markers carry the pose")
    return filled
