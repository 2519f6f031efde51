"""What a curve does between two keys, and how badly each kind of span explains a window.

A channel's own key times are found without any library from five kinds of span: a hold, and eases
``a + r e(u)`` of which the slopes at both ends, as multiples of the mean slope, are fixed. The
misfit of every window of every length comes from moments ``sum w k^m``, ``sum w y k^m`` about the
window's first frame. They grow by one term with the length, so that nothing cancels, and all
channels and starts of a length are one array operation.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Kind:
    """start, end: slope at the ends over the mean slope (None: a hold).

    dear: what a span of this kind costs more than an eased one, in nats.
    """

    name: str
    start: float | None
    end: float | None
    dear: float

    def leaves(self, side: int) -> bool:
        """Whether the curve moves at the span's start (side 0) or end (1)."""
        return bool(self.end if side else self.start)


KINDS = (
    Kind("ease", 0.0, 0.0, 0.0),
    Kind("hold", None, None, 1.0),
    Kind("line", 1.0, 1.0, 0.0),
    Kind("accelerate", 0.0, 1.25, 2.0),
    Kind("decelerate", 1.25, 0.0, 2.0),
)
"""Prices over the eased span's were tuned on 55 Noto faces, as drawn and with handles of thirds."""
EASE, HOLD, LINE = 0, 1, 2


def lengths(frames: int, fps: float, longest: float) -> NDArray[np.intp]:
    """Window lengths (intervals) that are tried: every one up to 2 s, then by 2 %, to ``longest``.

    Never a single interval, but in takes that have no more.
    """
    top = min(frames - 1, max(2, round(longest * fps)))
    tried = list(range(min(2, top), min(top, max(8, round(2.0 * fps))) + 1))
    while tried[-1] < top:
        tried.append(min(top, max(tried[-1] + 1, round(tried[-1] * 1.02))))
    return np.array(tried, dtype=np.intp)


def window_costs(
    values: Array, weight: Array, anchor: Array, firm: float, tried: NDArray[np.intp], starts: int
) -> Iterator[tuple[int, Array]]:
    """Half the weighted squared misfit of every kind over the windows of one length after another.

    Both ends are drawn toward an anchor, a smooth version of the values, as by ``firm`` more
    samples: kinds that fit a window alone but could not join their neighbours cost more. A window's
    first and last frame count half, since neighbours share them.

    Args:
        values: (C, M) channels.
        weight: (C, M) inverse variance of every sample.
        anchor: (C, M) smooth values.
        firm: weight of an anchor, in samples.
        tried: lengths in intervals, ascending.
        starts: windows that start at frames 0 to starts-1 only.

    Yields:
        The length n and (K, C, R) costs for the R starts from which n frames follow.
    """
    frames = values.shape[1]
    wy = weight * values
    wyy = wy * values
    ww = [weight[:, :starts].copy(), *(np.zeros_like(weight[:, :starts]) for _ in range(6))]
    wv = [wy[:, :starts].copy(), *(np.zeros_like(weight[:, :starts]) for _ in range(3))]
    square = wyy[:, :starts].copy()
    wanted = set(tried.tolist())
    for n in range(1, int(tried[-1]) + 1):
        room = min(starts, frames - n)
        if room <= 0:
            return
        ww, wv, square = [a[:, :room] for a in ww], [a[:, :room] for a in wv], square[:, :room]
        after = slice(n, n + room)
        power = 1.0
        for m in range(7):
            ww[m] += weight[:, after] * power
            if m < 4:
                wv[m] += wy[:, after] * power
            power *= n
        square += wyy[:, after]
        if n not in wanted:
            continue
        head, tail = slice(0, room), after
        left, right = firm * weight[:, head], firm * weight[:, tail]
        gram, rhs = [], []
        for m in range(7):
            own = ww[m] / float(n) ** m - 0.5 * weight[:, tail] + right
            gram.append(own + left - 0.5 * weight[:, head] if m == 0 else own)
            if m < 4:
                own = wv[m] / float(n) ** m - 0.5 * wy[:, tail] + right * anchor[:, tail]
                first = left * anchor[:, head] - 0.5 * wy[:, head]
                rhs.append(own + first if m == 0 else own)
        total = square - 0.5 * (wyy[:, head] + wyy[:, tail])
        total += left * anchor[:, head] ** 2 + right * anchor[:, tail] ** 2
        yield n, np.stack([0.5 * np.maximum(total - _won(k, gram, rhs), 0.0) for k in KINDS])


def _won(kind: Kind, gram: list[Array], rhs: list[Array]) -> Array:
    """By how much the best span of a kind lowers the sum of squares."""
    if kind.start is None or kind.end is None:
        return rhs[0] ** 2 / gram[0]
    # e(u) = a u + b u^2 + c u^3 with e(1) = 1 and these slopes.
    a, b, c = kind.start, 3 - 2 * kind.start - kind.end, kind.start + kind.end - 2
    one = a * gram[1] + b * gram[2] + c * gram[3]
    two = a * a * gram[2] + 2 * a * b * gram[3] + (b * b + 2 * a * c) * gram[4]
    two = two + 2 * b * c * gram[5] + c * c * gram[6]
    seen = a * rhs[1] + b * rhs[2] + c * rhs[3]
    det = np.maximum(gram[0] * two - one**2, 1e-12 * gram[0] * two + 1e-300)
    rise = (gram[0] * seen - one * rhs[0]) / det
    level = (two * rhs[0] - one * seen) / det
    return level * rhs[0] + rise * seen


_FEWER = 3.0  # nats that an ease must gain over a hold between the same keys


def misfit(shapes: Array, values: Array, weight: Array) -> Array:
    """(S,) half the weighted squared misfit of ``a + r shape``, both free."""
    total = weight.sum()
    level = float(weight @ values) / total
    target = values - level
    centred = shapes - (shapes @ weight)[:, None] / total
    seen = centred @ (weight * target)
    power = np.maximum((centred**2) @ weight, 1e-12)
    left: Array = 0.5 * (float(weight @ target**2) - seen**2 / power)
    return left


def eases(n: int) -> Array:
    """(K, n + 1) every kind's unit shape on the frames of a span; a hold's is zero."""
    u = np.linspace(0.0, 1.0, n + 1)
    shapes = np.zeros((len(KINDS), n + 1))
    for number, kind in enumerate(KINDS):
        if kind.start is not None and kind.end is not None:
            a, b = kind.start, kind.end
            shapes[number] = a * u + (3 - 2 * a - b) * u**2 + (a + b - 2) * u**3
    return shapes


def likeliest_kinds(frames: NDArray[np.intp], values: Array, weight: Array) -> NDArray[np.intp]:
    """Per span between given keys the kind that explains it best at its price."""
    dear = np.array([k.dear for k in KINDS])
    found = []
    for first, last in zip(frames[:-1].tolist(), frames[1:].tolist(), strict=True):
        part = slice(first, last + 1)
        cost = misfit(eases(last - first), values[part], weight[part]) + dear
        cost[HOLD] -= _FEWER
        found.append(int(cost.argmin()))
    return np.array(found, dtype=np.intp)
