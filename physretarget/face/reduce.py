"""Plain key reduction, the baseline that knows no animator: decimation and curve fitting.

Decimation works as Blender's: every frame starts as a key, and the key whose removal costs the
least error goes first, its neighbours' span refitted by one cubic. Fitting is Schneider's (1990):
one cubic per stretch, split where it is worst. Ramer, Douglas and Peucker's (1972, 1973) adds the
frame farthest from the polyline first; tangents are refitted to the samples afterwards.
"""

from __future__ import annotations

import heapq
from itertools import pairwise
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from physretarget.errors import InputError, UsageError
from physretarget.face.curve import Curve, Key
from physretarget.options.facial import Reducer

Array = NDArray[np.float64]
REDUCERS: tuple[Reducer, ...] = get_args(Reducer)


def _slopes(values: Array) -> Array:
    return np.asarray(np.gradient(values), dtype=np.float64) if len(values) > 1 else np.zeros(1)


def _span(values: Array, i: int, j: int, slopes: Array) -> tuple[float, float, float, float]:
    """Largest and summed squared error of one cubic over frames i to j, and its end slopes.

    Tangents are a third of the span; their directions at the ends are the data's, where there are
    too few frames to tell, else the least-squares ones.
    """
    n = j - i
    if n < 2:
        return 0.0, 0.0, float(values[j] - values[i]), float(values[j] - values[i])
    u = np.arange(1, n) / n
    v = 1.0 - u
    b0, b1, b2, b3 = v**3, 3 * v * v * u, 3 * v * u * u, u**3
    rest = values[i + 1 : j] - (b0 + b1) * values[i] - (b2 + b3) * values[j]
    third = n / 3.0
    p, q = b1 * third, -b2 * third
    # A little pull toward the data's own slopes keeps short spans determined.
    pull = 1e-3 * third * third
    a11, a12, a22 = p @ p + pull, p @ q, q @ q + pull
    r1, r2 = p @ rest + pull * slopes[i], q @ rest + pull * slopes[j]
    det = a11 * a22 - a12 * a12
    m0, m1 = (r1 * a22 - r2 * a12) / det, (r2 * a11 - r1 * a12) / det
    error = rest - p * m0 - q * m1
    return float(np.abs(error).max()), float(error @ error), float(m0), float(m1)


def _curve(values: Array, frames: list[int], slopes: Array, fps: float, start: float) -> Curve:
    ends = [_span(values, i, j, slopes)[2:] for i, j in pairwise(frames)]
    keys = []
    for k, frame in enumerate(frames):
        into = out = (0.0, 0.0)
        if k:
            third = (frame - frames[k - 1]) / 3.0
            into = (-third / fps, -third * ends[k - 1][1])
        if k < len(frames) - 1:
            third = (frames[k + 1] - frame) / 3.0
            out = (third / fps, third * ends[k][0])
        keys.append(Key(start + frame / fps, float(values[frame]), into, out, broken=True))
    return Curve(tuple(keys))


def _check(values: Array, fps: float) -> Array:
    samples = np.asarray(values, dtype=np.float64)
    if samples.ndim != 1 or not len(samples):
        raise InputError("there are no samples to reduce.")
    if not np.isfinite(samples).all():
        frame = int(np.flatnonzero(~np.isfinite(samples))[0])
        raise InputError("a sample is not finite.", frame=frame)
    if not fps > 0:
        raise InputError(f"a frame rate of {fps:g} is not usable.")
    return samples


def decimate(
    values: Array,
    fps: float,
    *,
    error: float | None = None,
    keys: int | None = None,
    start: float = 0.0,
) -> Curve:
    """Remove keys, cheapest first, up to a largest error (in units) or down to a count."""
    samples = _check(values, fps)
    last = len(samples) - 1
    if last == 0:
        return Curve((Key(start, float(samples[0])),))
    slopes = _slopes(samples)
    before, after = list(range(-1, last)), list(range(1, last + 2))
    version = [0] * (last + 1)
    heap = [(_span(samples, k - 1, k + 1, slopes)[0], k, 0) for k in range(1, last)]
    heapq.heapify(heap)
    left = last + 1
    target = 2 if keys is None else max(2, keys)
    limit = np.inf if error is None else error
    while heap and left > target:
        worst, k, made = heapq.heappop(heap)
        if made != version[k]:
            continue
        if worst > limit:
            break
        a, b = before[k], after[k]
        after[a], before[b] = b, a
        version[k] = -1
        left -= 1
        for m in (a, b):
            if 0 < m < last:
                version[m] += 1
                cost = _span(samples, before[m], after[m], slopes)[0]
                heapq.heappush(heap, (cost, m, version[m]))
    frames = [0]
    while frames[-1] != last:
        frames.append(after[frames[-1]])
    return _curve(samples, frames, slopes, fps, start)


def schneider(
    values: Array,
    fps: float,
    *,
    error: float | None = None,
    keys: int | None = None,
    start: float = 0.0,
) -> Curve:
    """Fit cubics, splitting the worst span at its worst frame: to an error or a key count."""
    samples = _check(values, fps)
    last = len(samples) - 1
    if last == 0:
        return Curve((Key(start, float(samples[0])),))
    slopes = _slopes(samples)
    frames = [0, last]
    limit = 0.0 if error is None else error
    most = len(samples) if keys is None else max(2, keys)
    spans = [(-_span(samples, 0, last, slopes)[0], 0, last)]
    while spans and len(frames) < most:
        worst, i, j = heapq.heappop(spans)
        if -worst <= limit or j - i < 2:
            if -worst <= limit:
                break
            continue
        k = _worst_frame(samples, i, j, slopes)
        frames.append(k)
        for a, b in ((i, k), (k, j)):
            heapq.heappush(spans, (-_span(samples, a, b, slopes)[0], a, b))
    return _curve(samples, sorted(frames), slopes, fps, start)


def rdp(
    values: Array,
    fps: float,
    *,
    error: float | None = None,
    keys: int | None = None,
    start: float = 0.0,
) -> Curve:
    """Best-first Ramer-Douglas-Peucker, to a distance from the polyline or a key count."""
    samples = _check(values, fps)
    last = len(samples) - 1
    if last == 0:
        return Curve((Key(start, float(samples[0])),))
    frames = [0, last]
    limit = 0.0 if error is None else error
    most = len(samples) if keys is None else max(2, keys)
    spans = [(*_farthest(samples, 0, last), 0, last)]
    while spans and len(frames) < most:
        nearness, k, i, j = heapq.heappop(spans)
        if -nearness <= limit and keys is None:
            break
        if j - i < 2:
            continue
        frames.append(k)
        for a, b in ((i, k), (k, j)):
            heapq.heappush(spans, (*_farthest(samples, a, b), a, b))
    return _curve(samples, sorted(frames), _slopes(samples), fps, start)


def _farthest(values: Array, i: int, j: int) -> tuple[float, int]:
    """Least distance below zero, and the frame, between i and j farthest from the straight line."""
    if j - i < 2:
        return 0.0, i
    line = np.linspace(values[i], values[j], j - i + 1)
    away = np.abs(values[i : j + 1] - line)
    k = int(away.argmax())
    return -float(away[k]), i + k if 0 < k < j - i else i + 1


def _worst_frame(values: Array, i: int, j: int, slopes: Array) -> int:
    _, _, m0, m1 = _span(values, i, j, slopes)
    n = j - i
    u = np.arange(1, n) / n
    v = 1.0 - u
    model = (v**3 + 3 * v * v * u) * values[i] + (3 * v * u * u + u**3) * values[j]
    model += n / 3.0 * (3 * v * v * u * m0 - 3 * v * u * u * m1)
    return i + 1 + int(np.argmax(np.abs(values[i + 1 : j] - model)))


def reduce_curve(
    values: Array,
    fps: float,
    how: Reducer = "decimate",
    *,
    error: float | None = None,
    keys: int | None = None,
    start: float = 0.0,
) -> Curve:
    """Reduce dense samples by one of the three ways.

    Raises InputError for samples that cannot be reduced, UsageError for an error below zero or a
    count below two.

    Args:
        values: (T,) dense samples.
        fps: Samples per second.
        how: decimate, schneider or rdp.
        error: Largest deviation, in the unit of the values.
        keys: Number of keys; give this or ``error``.
        start: Time of the first sample, s.

    Returns:
        The sparse curve.
    """
    if error is not None and not 0 <= error < np.inf:
        raise UsageError(f"error is {error:g}; it must be zero or above.")
    if keys is not None and keys < 2:
        raise UsageError(f"keys is {keys}; a curve needs two at least.")
    reducer = {"decimate": decimate, "schneider": schneider, "rdp": rdp}[how]
    return reducer(values, fps, error=error, keys=keys, start=start)
