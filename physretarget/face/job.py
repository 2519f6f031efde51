"""A take made ready for matching, and the keys that come of it before they are in its units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from physretarget.errors import InputError
from physretarget.face.curve import Key
from physretarget.face.noise import noise_level, smoothed
from physretarget.face.programme import ProgrammeSettings
from physretarget.face.rig import RigChannel
from physretarget.face.segments import Entry
from physretarget.face.shot import Take
from physretarget.face.sources import Piece, Shapes
from physretarget.face.style import Style
from physretarget.face.style_file import StyleFile

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Banks:
    """What is made of a library once and kept between calls: shapes, dictionaries, styles.

    style_file: where styles are kept between runs, if anywhere.
    """

    shapes: dict[tuple[str, ...], Shapes] = field(default_factory=dict)
    entries: dict[tuple[object, ...], list[Entry]] = field(default_factory=dict)
    styles: dict[tuple[float, ProgrammeSettings], Style | None] = field(default_factory=dict)
    style_file: StyleFile | None = None


@dataclass(frozen=True, eq=False)
class Job:
    """Channels (C, M) in units of what each moves; locked keys by frame, in the same units."""

    take: Take
    channels: Sequence[RigChannel]
    values: Array
    smooth: Array
    level: Array
    unit: Array
    base: Array
    locked: list[dict[int, Key]]

    def part(self, rows: list[int]) -> Job:
        """Some of the channels."""
        return replace(
            self,
            channels=[self.channels[r] for r in rows],
            locked=[self.locked[r] for r in rows],
            **{n: getattr(self, n)[rows] for n in ("values", "smooth", "level", "unit", "base")},
        )


@dataclass(frozen=True, eq=False)
class Draft:
    """A channel's keys (K, 6) in frames and units, where they may break, which are locked."""

    table: Array
    broken: Flags
    held: Flags
    pieces: tuple[Piece, ...]
    finished: bool = False  # a past curve as it was: nothing is cut off


def check_locked(
    locked: Mapping[str, Sequence[Key]], channels: Sequence[RigChannel], take: Take
) -> None:
    """Refuse locked keys of unknown channels or outside the take."""
    names = [c.name for c in channels]
    for name, keys in locked.items():
        if name not in names:
            raise InputError(f"locked keys of {name}; matched are {', '.join(names)}.")
        for key in keys:
            if not take.time[0] - 1e-6 <= key.time <= take.time[-1] + 1e-6:
                raise InputError(
                    f"the locked key of {name} at {key.time:g} s lies outside the take "
                    f"({take.time[0]:g}–{take.time[-1]:g} s)."
                )


def prepare(take: Take, channels: Sequence[RigChannel], locked: Mapping[str, Sequence[Key]]) -> Job:
    """Channels in units of what each moves, their noise, and locked keys by frame."""
    values = np.stack([take.channel(c.name) for c in channels])
    moved = np.ptp(values, axis=1)
    ranges = np.array([c.range for c in channels])
    unit = np.clip(moved, 0.05 * ranges, ranges)  # a channel at rest is not blown up to its noise
    base = values.min(axis=1)
    relative = (values - base[:, None]) / unit[:, None]
    smooth = smoothed(relative, take.fps)
    pinned: list[dict[int, Key]] = []
    for row, channel in enumerate(channels):
        frames: dict[int, Key] = {}
        for key in locked.get(channel.name, ()):
            frame = round((key.time - take.time[0]) * take.fps)
            scaled = key.moved(-take.time[0], -base[row]).scaled_to(take.fps, 1.0 / unit[row])
            frames[min(max(frame, 0), values.shape[1] - 1)] = scaled
        pinned.append(frames)
    level = noise_level(relative, smooth, take.fps)
    return Job(take, channels, relative, smooth, level, unit, base, pinned)


def corners(table: Array) -> Flags:
    """(K,) whether the slopes on both sides of a key differ."""
    broken = np.zeros(len(table), dtype=np.bool_)
    inner = slice(1, -1)
    into = table[inner, 3] * table[inner, 4] - table[inner, 5] * table[inner, 2]
    size = np.abs(table[inner, 2] * table[inner, 4])
    broken[inner] = np.abs(into) > 1e-9 * np.maximum(size, 1e-12)
    return broken
