"""From rows as recorders write them to a take: units of time, lost rows, one frame rate.

A row in which the face was lost, or a value that is missing, is a gap and no zero: it is NaN here
and is filled linearly between its neighbours, and the take's notes say how many and how long.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physretarget.errors import InputError
from physretarget.face.formats.source import Source
from physretarget.face.shot import Take

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
# Rows so many seconds apart hold no face that moves: in milliseconds that is 250 rows a second.
_SLOWEST = 4.0
# Rows whose distances differ by less than this share stand evenly: whole milliseconds at 60 Hz do.
_ROUNDED = 0.1
LONGEST = 1_000_000  # frames after resampling: more than four hours at 60 Hz
MOST = 50_000_000  # numbers: 400 MB
UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_SPOKEN = {"ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}
# Of rows that come in a network's order, so many may stand still or go back in time.
_DISORDER = 0.1
_CLOCK = re.compile(r"\s*(\d{1,3}):(\d{1,2}):(\d{1,2}(?:[.,]\d{1,9})?)\s*")


def dense_take(
    source: Source,
    time: Sequence[float] | Array,
    channels: Sequence[str],
    values: Sequence[Sequence[float]] | Array,
    *,
    unit: str | None = None,
    fps: float | None = None,
    notes: Sequence[str] = (),
) -> Take:
    """A take of rows.

    Args:
        source: the file, for messages.
        time: (T,) when each row was recorded, in any unit and from any start.
        channels: names, C of them.
        values: (T, C); NaN where the face was lost.
        unit: of time, one of UNITS; found from the rows' distance by default.
        fps: frame rate of the take; the rows' own by default.
        notes: what the reader has to say.

    Returns:
        The take, from 0 s, on even times.

    Raises:
        InputError: too few rows, times that do not advance, or a take too long to read.
    """
    when, table = np.asarray(time, np.float64), np.asarray(values, np.float64)
    table = table.reshape(len(when), len(channels))
    told = list(notes)
    if len(set(channels)) != len(channels):
        raise InputError("a channel is there twice.", path=source.path)
    when, table = _advancing(source, when, table, told)
    when = when - when[0]
    step = float(np.median(np.diff(when)))
    found = unit or _unit(step)
    when, step = when * UNITS[found], step * UNITS[found]
    if unit is None and found != "s":
        apart = step / UNITS[found]
        told.append(f"Times are {_SPOKEN[found]}: as seconds, rows would be {apart:g} s apart.")
    names, table = _filled(source, when, tuple(channels), table, told)
    mean = float(when[-1]) / (len(when) - 1)
    if np.abs(np.diff(when) - mean).max() < _ROUNDED * mean:
        step = mean  # times are rounded: their mean distance is the true one
    if fps is not None:
        step = 1.0 / checked_rate(source, fps)
    if when[-1] / step > LONGEST or when[-1] / step * len(names) > MOST:
        raise InputError("more than a million frames after resampling.", path=source.path)
    count = int(np.floor(when[-1] / step + 0.5)) + 1
    grid = np.asarray(step * np.arange(max(count, 2)), np.float64)
    if len(grid) != len(when) or np.abs(grid - when).max() > 1e-3 * step:
        told.append(f"Uneven times were resampled at {1 / step:g} Hz.")
        table = np.stack([np.interp(grid, when, v) for v in table.T], axis=1)
    else:
        grid = when
    return Take(source.name, grid, names, table, source.sha256, tuple(told))


def _advancing(source: Source, time: Array, table: Array, notes: list[str]) -> tuple[Array, Array]:
    if len(time) < 2:
        raise InputError("fewer than two frames.", path=source.path)
    if not np.isfinite(time).all():
        raise InputError("a time is not finite.", path=source.path)
    latest = np.maximum.accumulate(time)
    kept = np.append(True, time[1:] > latest[:-1])
    out = int((~kept).sum())
    if out > _DISORDER * len(time) or kept.sum() < 2:
        raise InputError(
            f"{out} of {len(time)} rows do not come after the row before them; sort the rows by "
            "time, or split the file where its clock starts anew.",
            path=source.path,
        )
    if out:
        notes.append(f"{out} rows that do not come after the row before them were left out.")
    return time[kept], table[kept]


def _unit(step: float) -> str:
    """The largest unit in which rows are less than ``_SLOWEST`` seconds apart."""
    return next((u for u, size in UNITS.items() if step * size < _SLOWEST), "ns")


def _filled(
    source: Source, time: Array, channels: tuple[str, ...], table: Array, notes: list[str]
) -> tuple[tuple[str, ...], Array]:
    known: Flags = np.isfinite(table)
    if known.all() and table.shape[1]:
        return channels, table
    seen: Flags = np.logical_or.reduce(known, axis=0)
    if not seen.any():
        raise InputError("holds no row in which a face was seen.", path=source.path)
    missing = [c for c, there in zip(channels, seen, strict=True) if not there]
    if missing:
        notes.append(f"Without any value, and left out: {', '.join(missing)}.")
    table, known = table[:, seen], known[:, seen]
    columns = [np.interp(time, time[k], v[k]) for v, k in zip(table.T, known.T, strict=True)]
    lost: Flags = ~np.logical_and.reduce(known, axis=1)
    if lost.any():
        notes.append(
            f"{int(lost.sum())} rows with a lost face were filled linearly; "
            f"the longest gap is {_longest(time, lost):.2f} s."
        )
    names = tuple(c for c, there in zip(channels, seen, strict=True) if there)
    return names, np.stack(columns, axis=1)


def _longest(time: Array, lost: Flags) -> float:
    """Seconds between the rows around the longest run of lost ones."""
    there = np.concatenate([[0], np.flatnonzero(~lost), [len(time) - 1]])
    return float(np.diff(time[there]).max())


def checked_rate(source: Source, fps: float) -> float:
    """A frame rate, if it is one.

    Raises:
        InputError: not above zero, not finite, or above 10 kHz.
    """
    if not (np.isfinite(fps) and 0 < fps <= 10_000):
        raise InputError(f"a frame rate of {fps:g} is not usable.", path=source.path)
    return float(fps)


def seconds(cell: str) -> float:
    """A time: a number in the file's own unit, or hours, minutes and seconds in seconds.

    Raises:
        ValueError: neither.
    """
    found = _CLOCK.fullmatch(cell)
    if found is None:
        return float(cell)
    hours, minutes, rest = found.groups()
    return 3600.0 * int(hours) + 60.0 * int(minutes) + float(rest.replace(",", "."))


def is_clock(cell: Any) -> bool:
    """Whether a cell is a time of day, hours, minutes and seconds."""
    return isinstance(cell, str) and _CLOCK.fullmatch(cell) is not None
