"""What several writers need: tangents as they are evaluated, and spans as cubics in time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from physretarget.face.curve import Curve, Key

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Tangents:
    """Offsets (K, 2) of both sides; ``shortened`` keys had one too long to be evaluated as given.

    The in tangent of the first key and the out tangent of the last are never evaluated and kept.
    """

    into: Array
    out: Array
    shortened: tuple[int, ...]


def evaluated(curve: Curve) -> Tangents:
    """The tangents that the curve is evaluated with."""
    table = curve.table
    into, out = table[:, 2:4].copy(), table[:, 4:6].copy()
    shortened: set[int] = set()
    if len(table) > 1:
        controls = curve.controls
        for first, side, offsets in (
            (0, out[:-1], controls[:, 1] - controls[:, 0]),
            (1, into[1:], controls[:, 2] - controls[:, 3]),
        ):
            # Compared with rounding in mind, so that untouched tangents keep every digit.
            scale = 1e-9 * (np.abs(side) + np.abs(controls[:, 0]) + np.abs(controls[:, 3]))
            changed = (np.abs(offsets - side) > scale).any(axis=1)
            side[changed] = offsets[changed]
            shortened |= {int(k) + first for k in np.flatnonzero(changed)}
    into[:, 0], out[:, 0] = np.minimum(into[:, 0], 0.0), np.maximum(out[:, 0], 0.0)
    return Tangents(into, out, tuple(sorted(shortened)))


def is_cubic_in_time(curve: Curve, tolerance: float = 1e-9) -> NDArray[np.bool_]:
    """(K-1,) whether a span's handles lie at thirds, so that its value is a cubic of time."""
    if len(curve.keys) < 2:
        return np.zeros(0, dtype=bool)
    x = curve.controls[:, :, 0]
    width = x[:, 3] - x[:, 0]
    first = np.abs((x[:, 1] - x[:, 0]) / width - 1.0 / 3.0)
    second = np.abs((x[:, 2] - x[:, 0]) / width - 2.0 / 3.0)
    near: NDArray[np.bool_] = np.maximum(first, second) <= tolerance
    return near


def is_straight(curve: Curve, tolerance: float = 1e-12) -> NDArray[np.bool_]:
    """(K-1,) whether a span's handles lie on its chord at thirds: a line at even speed."""
    if len(curve.keys) < 2:
        return np.zeros(0, dtype=bool)
    table = curve.table
    third = np.diff(table[:, :2], axis=0) / 3.0
    size = tolerance * (np.abs(table[1:, :2]) + np.abs(table[:-1, :2]) + np.abs(third))
    near = (np.abs(table[:-1, 4:6] - third) <= size) & (np.abs(table[1:, 2:4] + third) <= size)
    return np.asarray(near.all(axis=1), dtype=bool)


def worst_difference(a: Curve, b: Curve) -> float:
    """Largest distance between two curves within the extent of the first."""
    if len(a.keys) < 2:
        return abs(a.keys[0].value - float(b.evaluate(a.start)))
    return float(span_differences(a, b).max())


def span_differences(a: Curve, b: Curve, per_span: int = 32) -> Array:
    """(K-1,) largest distance between two curves within each span of the first."""
    part = (np.arange(per_span) + 0.5) / per_span
    times = a.time[:-1, None] + np.diff(a.time)[:, None] * part
    return np.asarray(np.abs(a.evaluate(times) - b.evaluate(times)).max(axis=1), dtype=np.float64)


def halved(curve: Curve, which: NDArray[np.bool_]) -> Curve:
    """The same curve with a key in the middle of these spans (K-1,), by de Casteljau's scheme.

    For curves without steps; the middle is that of the spans' own parameter.
    """
    keys = [curve.keys[0]]
    for span, points in enumerate(curve.controls):
        right = curve.keys[span + 1]
        if which[span]:
            one = 0.5 * (points[:-1] + points[1:])
            two = 0.5 * (one[:-1] + one[1:])
            middle = 0.5 * (two[0] + two[1])
            keys[-1] = replace(keys[-1], out_tangent=_later(one[0] - points[0]))
            into, out = _earlier(two[0] - middle), _later(two[1] - middle)
            keys.append(Key(float(middle[0]), float(middle[1]), into, out))
            right = replace(right, in_tangent=_earlier(one[2] - points[3]))
        keys.append(right)
    return Curve(tuple(keys))


def _later(offset: Array) -> tuple[float, float]:
    return max(0.0, float(offset[0])), float(offset[1])  # rounding must not turn it around


def _earlier(offset: Array) -> tuple[float, float]:
    return min(0.0, float(offset[0])), float(offset[1])
