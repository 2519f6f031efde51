"""What is measured of a result (never by counting keys alone).

Recovery: a curve the library has not seen is turned into pseudo-capture and matched; how many of
the animator's keys come back, and how close is the curve to the clean one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.stats import wasserstein_distance

from physretarget.face.curve import Curve

Array = NDArray[np.float64]


def key_f1(found: Array, true: Array, tolerance: float) -> tuple[float, float, float]:
    """F1, precision and recall of key times; every key pairs with at most one other.

    Both lists ascending; pairing neighbours greedily in order of time is optimal on a line.
    """
    i = j = hits = 0
    while i < len(found) and j < len(true):
        apart = found[i] - true[j]
        if abs(apart) <= tolerance + 1e-9:
            hits, i, j = hits + 1, i + 1, j + 1
        elif apart < 0:
            i += 1
        else:
            j += 1
    precision = hits / len(found) if len(found) else 0.0
    recall = hits / len(true) if len(true) else 0.0
    total = precision + recall
    return (2 * precision * recall / total if total else 0.0), precision, recall


def pseudo_capture(
    curve: Curve, fps: float, rng: np.random.Generator, *, noise: float = 0.01, jitter: float = 1.0
) -> tuple[Array, Array]:
    """Dense samples of an animator's curve as a capture device would give them.

    Args:
        curve: the clean curve; frames run from its first to its last key.
        fps: frame rate.
        rng: source of randomness.
        noise: standard deviation, as a fraction of the curve's range.
        jitter: each frame is taken up to so many frames early or late (uniform).

    Returns:
        Clean and noisy values (T,).
    """
    count = max(2, int(np.floor((curve.end - curve.start) * fps + 0.5)) + 1)
    time = curve.start + np.arange(count) / fps
    clean = curve.evaluate(time)
    late = rng.uniform(-jitter, jitter, count) / fps
    noisy = curve.evaluate(time + late) + rng.normal(0.0, noise * np.ptp(clean), count)
    return clean, noisy


def pseudo_take(
    curves: Sequence[Curve],
    fps: float,
    rng: np.random.Generator,
    *,
    noise: float = 0.01,
    jitter: float = 1.0,
    smooth: float = 0.0,
) -> tuple[Array, Array, float]:
    """One capture of curves that were drawn together, from the first key to the last of all.

    Args:
        curves: the clean curves on one clock.
        fps: frame rate.
        rng: source of randomness.
        noise: standard deviation, as a fraction of each curve's range.
        jitter: each frame is taken up to so many frames early or late, for all channels alike.
        smooth: standard deviation, in frames, of a Gaussian that the capture then goes through.

    Returns:
        Clean and noisy values (C, T), and the time of the first frame.
    """
    start, end = min(c.start for c in curves), max(c.end for c in curves)
    count = max(2, int(np.floor((end - start) * fps + 0.5)) + 1)
    time = start + np.arange(count) / fps
    late = time + rng.uniform(-jitter, jitter, count) / fps
    clean = np.stack([c.evaluate(time) for c in curves])
    spread = noise * np.ptp(clean, axis=1, keepdims=True)
    noisy = np.stack([c.evaluate(late) for c in curves]) + spread * rng.normal(size=clean.shape)
    if smooth > 0:
        noisy = gaussian_filter1d(noisy, smooth, axis=1, mode="nearest")
    return clean, noisy, start


def extrema(values: Array, least: float) -> NDArray[np.intp]:
    """Frames of turning points that stand out by at least so much on both sides."""
    turns: list[int] = []
    low = high = 0
    direction = 0
    for frame, value in enumerate(values):
        if value > values[high]:
            high = frame
        if value < values[low]:
            low = frame
        if direction >= 0 and values[high] - value >= least:
            if direction > 0 or high > 0:
                turns.append(high)
            direction, low = -1, frame
            high = frame
        elif direction <= 0 and value - values[low] >= least:
            if direction < 0 or low > 0:
                turns.append(low)
            direction, high = 1, frame
            low = frame
    return np.array(turns, dtype=np.intp)


def extremum_timing(result: Array, capture: Array, least: float) -> float:
    """Mean distance in frames from the capture's turning points to the result's nearest."""
    wanted, got = extrema(capture, least), extrema(result, 0.5 * least)
    if not len(wanted):
        return 0.0
    if not len(got):
        return float("nan")
    return float(np.abs(wanted[:, None] - got[None]).min(axis=1).mean())


@dataclass(frozen=True)
class Timing:
    """Turning points of a capture in a result: frames off where found (mean), share not found."""

    frames: float
    missed: float
    count: int


def turning_points(values: Array, least: float) -> NDArray[np.intp]:
    """(K, 3): first and last frame of every turning point, and +1 for a maximum, -1 for a minimum.

    A plateau has no single extreme frame: all frames about it that lie within a tenth of ``least``
    of its value belong to it.
    """
    peaks = extrema(values, least)
    rows = []
    for k, peak in enumerate(peaks.tolist()):
        other = peaks[k - 1] if k else peaks[k + 1] if len(peaks) > 1 else 0
        kind = 1 if values[peak] >= values[other] else -1
        away = np.flatnonzero(np.abs(values - values[peak]) > 0.1 * least)
        before, after = away[away < peak], away[away > peak]
        first = int(before[-1]) + 1 if len(before) else 0
        rows.append((first, int(after[0]) - 1 if len(after) else len(values) - 1, kind))
    return np.array(rows, dtype=np.intp).reshape(-1, 3)


def turning_point_timing(result: Array, capture: Array, least: float) -> Timing:
    """How far a result's turning points lie from the capture's, plateaus taken as a whole.

    One counts as found if the result turns the same way between the capture's neighbouring turning
    points; its distance is the gap between the two plateaus, 0 where they overlap.
    """
    wanted, got = turning_points(capture, least), turning_points(result, 0.5 * least)
    apart = []
    for k, (first, last, kind) in enumerate(wanted.tolist()):
        low = wanted[k - 1, 1] if k else 0
        high = wanted[k + 1, 0] if k + 1 < len(wanted) else len(capture)
        same = got[(got[:, 2] == kind) & (got[:, 1] >= low) & (got[:, 0] <= high)]
        if len(same):
            gap = np.maximum(np.maximum(same[:, 0] - last, first - same[:, 1]), 0)
            apart.append(int(gap.min()))
    count = len(wanted)
    missed = 1.0 - len(apart) / count if count else 0.0
    return Timing(float(np.mean(apart)) if apart else float("nan"), missed, count)


@dataclass(frozen=True)
class Style:
    """How keys are set: spacing (s), tangent lengths (of the span), slopes, flat and held shares.

    Slopes as multiples of the curve's extent over the span's width, at most 10.
    """

    spacing: Array
    handles: Array
    slopes: Array
    flat_share: float
    hold_share: float


def distances(found: Style, reference: Style) -> tuple[float, float, float]:
    """Wasserstein distances of spacing, tangent lengths and slopes; not a number without keys."""
    if not len(found.spacing) or not len(reference.spacing):
        return float("nan"), float("nan"), float("nan")
    return (
        float(wasserstein_distance(found.spacing, reference.spacing)),
        float(wasserstein_distance(found.handles, reference.handles)),
        float(wasserstein_distance(found.slopes, reference.slopes)),
    )


def style(curves: list[Curve], level: float = 0.01) -> Style:
    """Key statistics of curves; level: slopes and rises under this part of the range are flat."""
    spacing, handles, slopes, flat, hold = [], [], [], [], []
    for curve in curves:
        if len(curve.keys) < 2:
            continue
        controls = curve.controls
        width = controls[:, 3, 0] - controls[:, 0, 0]
        extent = float(np.ptp(controls[:, :, 1])) or 1.0
        spacing.append(width)
        handles.append((controls[:, 1, 0] - controls[:, 0, 0]) / width)
        handles.append((controls[:, 3, 0] - controls[:, 2, 0]) / width)
        for a, b in ((0, 1), (2, 3)):
            run = np.maximum(controls[:, b, 0] - controls[:, a, 0], 1e-3 * width)
            rise = controls[:, b, 1] - controls[:, a, 1]
            slopes.append(np.clip(np.abs(rise / run) * width / extent, 0.0, 10.0))
        flat.append(np.abs(controls[:, 1, 1] - controls[:, 0, 1]) < level * extent)
        hold.append(np.ptp(controls[:, :, 1], axis=1) < level * extent)
    if not spacing:
        return Style(np.empty(0), np.empty(0), np.empty(0), 0.0, 0.0)
    return Style(
        np.concatenate(spacing),
        np.concatenate(handles),
        np.concatenate(slopes),
        float(np.concatenate(flat).mean()),
        float(np.concatenate(hold).mean()),
    )
