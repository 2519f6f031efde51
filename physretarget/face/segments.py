"""Segments of past curves, ready to be laid over a take, and what is claimed by one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget.face.curve import Curve
from physretarget.face.library import Library, Segment, halves
from physretarget.options.facial import Method

Array = NDArray[np.float64]
EXACT = 1e-3
"""Misfit over range below which a segment is the capture itself: its keys then stay untouched."""


@dataclass(frozen=True, kw_only=True)
class PaperSettings:
    """method and threshold (tau); word, alphabet: of SAX; pace: the hidden Markov model's price of
    one frame off the even pace, per standard deviation of the channel.
    """

    method: Method = "distance"
    threshold: float = 0.05
    word: int = 8
    alphabet: int = 8
    pace: float = 0.05


@dataclass(frozen=True, eq=False)
class Entry:
    """A segment ready to match: keys in frames from its first, samples, and equal segments."""

    segment: Segment
    table: Array
    samples: Array
    copies: list[Segment]

    @property
    def last(self) -> int:
        """Frames from first to last sample."""
        return len(self.samples) - 1


@dataclass(frozen=True, eq=False)
class Claim:
    """Keys laid over frames first to last: (K, 6) in frames and values, before the warp."""

    entry: Entry
    first: int
    last: int
    table: Array
    error: float
    stretch: float


def dictionary(
    library: Library, fps: float, usable: Callable[[str], bool], *, whole: bool = False
) -> list[Entry]:
    """Every halved segment and every whole curve, longest first, copies once.

    A curve that begins between two frames is sampled as the capture would have sampled it, too.
    whole: whole curves alone.
    """
    found: dict[bytes, tuple[float, int, Entry]] = {}
    for index, example in enumerate(library.examples):
        keys = example.curve.keys
        if not usable(example.channel) or len(keys) < 2:
            continue
        cuts = {(0, len(keys) - 1)}
        if not whole:
            cuts |= set(halves(len(keys), library.settings.min_keys))
        for a, b in sorted(cuts):
            part = Curve(keys[a : b + 1], example.curve.weighted)
            for late in sorted({0.0, round(-part.start * fps % 1.0, 4) % 1.0}):
                count = int(np.floor((part.end - part.start) * fps - late + 1e-4)) + 1
                if count < 3:
                    continue
                table = part.table * np.array([fps, 1.0] * 3)
                table[:, 0] -= part.start * fps + late
                level = np.array([0.0, part.value[0], 0.0, 0.0, 0.0, 0.0])
                mark = np.round(np.append((table - level).ravel(), late), 5).tobytes()
                if mark in found:
                    found[mark][2].copies.append(Segment(index, a, b))
                    continue
                samples = part.evaluate(part.start + (late + np.arange(count)) / fps)
                entry = Entry(Segment(index, a, b), table, samples, [])
                found[mark] = (part.start - part.end, len(found), entry)
    return [entry for _, _, entry in sorted(found.values(), key=lambda f: f[:2])]
