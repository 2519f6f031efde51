"""Maya's own rule for computed tangents, as its published animation engine states it.

Autodesk's AnimX and the older ``animEngine`` sample: a weighted tangent ends at the key plus
weight × (cos, sin) of its angle, in seconds and channel units; an unweighted one has its slope
from the angle and reaches a third of the span. Angles of computed kinds follow from neighbours.
"""

from __future__ import annotations

from collections.abc import Sequence

Point = tuple[float, float]

# animEngine's clamped tangents are flat where a neighbour is closer than this in value.
_CLAMP = 0.05


def tangent(kind: str, points: Sequence[Point], k: int, side: int) -> Point:
    """Offset of key k's tangent (side -1 in, +1 out) of a computed kind; (0, 0) at open ends."""
    j = k + side
    if not 0 <= j < len(points):
        return (0.0, 0.0)
    (t, v), (tn, vn) = points[k], points[j]
    third = (tn - t) / 3.0
    if kind == "linear":
        return (third, (vn - v) / 3.0)
    kind = _resolved(kind, points, k)
    if kind == "flat":
        return (third, 0.0)
    if kind == "auto":
        return _auto(points, k, side)
    return (third, _smooth_slope(points, k) * third)


def _resolved(kind: str, points: Sequence[Point], k: int) -> str:
    """The kind that is left after plateau, clamped and auto have looked at the neighbours."""
    value = points[k][1]
    if kind == "clamped":
        rises = [abs(points[j][1] - value) for j in (k - 1, k + 1) if 0 <= j < len(points)]
        return "flat" if min(rises) <= _CLAMP else "spline"
    if kind in ("plateau", "auto"):
        if k in (0, len(points) - 1):
            return "flat"
        back, ahead = points[k - 1][1] - value, points[k + 1][1] - value
        if back * ahead >= 0:
            return "flat"
        if kind == "plateau":
            return "flat" if _overshoots(points, k) else "spline"
    return kind


def _smooth_slope(points: Sequence[Point], k: int) -> float:
    left, right = points[max(k - 1, 0)], points[min(k + 1, len(points) - 1)]
    return (right[1] - left[1]) / (right[0] - left[0])


def _overshoots(points: Sequence[Point], k: int) -> bool:
    slope, (t, v) = _smooth_slope(points, k), points[k]
    return any(
        abs(slope * (points[j][0] - t) / 3.0) > abs(points[j][1] - v) for j in (k - 1, k + 1)
    )


def _auto(points: Sequence[Point], k: int, side: int) -> Point:
    """Smooth, but no steeper than lets either handle reach its neighbour's value."""
    (t, v), slope = points[k], _smooth_slope(points, k)
    limit = min(abs(3.0 * (points[j][1] - v) / (points[j][0] - t)) for j in (k - 1, k + 1))
    third = (points[k + side][0] - t) / 3.0
    bounded = min(abs(slope), limit)
    return (third, (bounded if slope > 0 else -bounded) * third)
