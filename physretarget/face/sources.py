"""Where a span's shape comes from, said only where the library explains it better than any ease.

A span of the library, laid over a span of the result with free ends, is a rival of the generic
eases. It is named as the source if it lowers half the weighted squared misfit by more than
``MARGIN`` nats after the logarithm of the number of shapes that were tried, since the best of many
always fits a little better by chance. A rest has no shape and no source.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from physretarget.face.curve import Curve
from physretarget.face.keyfit import Chain
from physretarget.face.library import Library
from physretarget.face.spans import HOLD, eases, misfit

Array = NDArray[np.float64]
MARGIN = 3.0
"""Nats, odds of twenty to one: the usual line between some evidence and strong evidence (Kass and
Raftery, 1995)."""
_POINTS = 33
_ALIKE = 0.03  # shapes whose unit curves differ by less are one
_MOST = 300  # shapes; the commonest


@dataclass(frozen=True)
class Piece:
    """One span of a result, or one segment of several, and its origin.

    start, end: seconds in the take. kind: what the curve does there. shot, channel, source_start,
    source_end: the segment in the library (s); shot and channel are empty where nothing in the
    library explains the piece better than a generic ease. keys: of the piece, both ends counted.
    stretch: duration here over duration there. amplitude: height here over there. error: root mean
    square misfit as a fraction of what the channel moves. margin: by how many nats the source is
    likelier than the generic ease, after the number of shapes tried. confidence: probability that
    keys stand within a frame of both ends; None where no alternatives are known. doubtful: another
    solution that is about as likely cuts elsewhere. fitted: a gap between borrowed segments. alike:
    how many segments of the library share the shape.
    """

    start: float
    end: float
    kind: str = "ease"
    shot: str = ""
    channel: str = ""
    source_start: float = 0.0
    source_end: float = 0.0
    keys: int = 2
    stretch: float = 1.0
    amplitude: float = 1.0
    error: float = 0.0
    margin: float = 0.0
    confidence: float | None = None
    doubtful: bool = False
    fitted: bool = False
    alike: int = 0


@dataclass(frozen=True)
class Origin:
    """A span of the library: example, its left key, seconds, height; alike: spans of this shape."""

    example: int
    key: int
    seconds: float
    height: float
    alike: int


@dataclass(frozen=True, eq=False)
class Shapes:
    """The different shapes of a library's moving spans: (S, 33) unit curves and their origins."""

    unit: Array
    origins: tuple[Origin, ...]

    @classmethod
    def of(cls, library: Library, usable: Callable[[str], bool]) -> Shapes:
        """Every span between neighbouring keys that moves, alike ones once, commonest first."""
        grid = np.linspace(0.0, 1.0, _POINTS)
        found: dict[tuple[int, ...], list[tuple[Array, Origin]]] = {}
        for number, example in enumerate(library.examples):
            if not usable(example.channel):
                continue
            curve = example.curve
            least = 1e-3 * float(np.ptp(curve.value))
            time, rise = curve.time, np.diff(curve.value)
            for k in np.flatnonzero(np.abs(rise) > least).tolist():
                if curve.keys[k].out_type.startswith("stepped"):
                    continue
                seconds = float(time[k + 1] - time[k])
                shape = (curve.evaluate(time[k] + grid * seconds) - curve.value[k]) / rise[k]
                if float(np.abs(shape).max()) > 3.0:
                    continue
                cell = tuple(np.round(shape[4:-1:4] / _ALIKE).astype(int).tolist())
                origin = Origin(number, k, seconds, abs(float(rise[k])), 1)
                found.setdefault(cell, []).append((shape, origin))
        ranked = sorted(found.values(), key=len, reverse=True)[:_MOST]
        unit = np.array([members[0][0] for members in ranked]).reshape(-1, _POINTS)
        origins = tuple(
            Origin(o.example, o.key, o.seconds, o.height, len(members))
            for members in ranked
            for o in (members[0][1],)
        )
        return cls(unit, origins)

    @cached_property
    def chance(self) -> float:
        """Nats by which the best of so many shapes may win by chance."""
        return float(np.log(max(1, len(self.origins))))

    def at(self, n: int) -> Array:
        """(S, n + 1) shapes on the frames of a span of n intervals."""
        place = np.linspace(0.0, _POINTS - 1.0, n + 1)
        low = np.minimum(place.astype(int), _POINTS - 2)
        part = place - low
        shapes: Array = self.unit[:, low] * (1 - part) + self.unit[:, low + 1] * part
        return shapes


def span_sources(
    chain: Chain, values: Array, weight: Array, shapes: Shapes
) -> list[tuple[Origin | None, float]]:
    """Per span its origin, if a shape earns the name, and by how many nats it beats the eases."""
    told: list[tuple[Origin | None, float]] = []
    for k, kind in enumerate(chain.kinds.tolist()):
        first, last = int(chain.frames[k]), int(chain.frames[k + 1])
        if kind == HOLD or not len(shapes.origins) or last - first < 4:
            told.append((None, 0.0))
            continue
        part = slice(first, last + 1)
        best = misfit(eases(last - first), values[part], weight[part]).min()
        own = misfit(shapes.at(last - first), values[part], weight[part])
        winner = int(own.argmin())
        margin = float(best - own[winner]) - shapes.chance
        told.append((shapes.origins[winner] if margin > MARGIN else None, max(margin, 0.0)))
    return told


def named(piece: Piece, origin: Origin, library: Library, height: float) -> dict[str, object]:
    """What a piece tells of its origin."""
    example = library.examples[origin.example]
    keys: Curve = example.curve
    start, end = keys.keys[origin.key].time, keys.keys[origin.key + 1].time
    return {
        "shot": example.shot,
        "channel": example.channel,
        "source_start": start,
        "source_end": end,
        "stretch": (piece.end - piece.start) / origin.seconds,
        "amplitude": height / origin.height if origin.height > 0 else 1.0,
        "alike": origin.alike,
    }
