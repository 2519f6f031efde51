"""Live Link Face CSV: ARKit's 52 blend shapes plus head and eye rotations, row by timecode.

A trap: the timecode ``HH:MM:SS:FF.sss`` counts frames of the clock's rate, which is not the rate
of the rows: a 30 Hz take may count 60ths and skip every other number. So the clock's rate is read
from the largest frame number seen, the rows' rate from the median distance of timecodes, and the
take is resampled onto that uniform rate, which also fills dropped frames.

Drop-frame clocks (29.97 and 59.94 per second) leave out the first two or four numbers of every
minute but each tenth. Such a clock is told by that, or by a semicolon ahead of the frame number.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from os import PathLike

import numpy as np
from numpy.typing import NDArray

from physretarget.errors import InputError
from physretarget.face.formats.dense import LONGEST, checked_rate, seconds
from physretarget.face.formats.plain import cells
from physretarget.face.formats.source import Source
from physretarget.face.shot import Take

_TIMECODE = re.compile(r"\s*(\d{1,2}):(\d{1,2}):(\d{1,2})([:;])(\d{1,3}(?:\.\d{1,9})?)\s*")
_HEADER = re.compile(rb"[\s\"']*timecode[\s\"']*[,;\t]", re.IGNORECASE)
_CLOCKS = (24.0, 25.0, 30.0, 48.0, 50.0, 60.0, 100.0, 120.0)
_DAY = 86400.0
_NTSC = 1.001  # by how much a clock that drops numbers is slower than its numbers say


@dataclass(frozen=True)
class _Rows:
    seconds: NDArray[np.float64]  # whole seconds of the timecode
    frames: NDArray[np.float64]  # frame part of the timecode
    values: NDArray[np.float64]
    marked: bool  # whether a semicolon says that the clock drops numbers


def is_livelink(source: Source) -> bool:
    """Whether the first line is Live Link's header, and the times below are not plain numbers."""
    if _HEADER.match(source.content[:200].lstrip(b"\xef\xbb\xbf")) is None:
        return False
    below = source.content.partition(b"\n")[2][:200].lstrip()
    cell = re.split(rb"[,;\t\n]", below)[0].decode("utf-8", "replace").strip(" \"'\r")
    try:
        seconds(cell)
    except ValueError:
        return True
    return False


def read_livelink(
    path: str | PathLike[str] | Source, *, fps: float | None = None, clock: float | None = None
) -> Take:
    """Read a take.

    Args:
        path: the CSV.
        fps: resample to this rate; the rows' own by default.
        clock: frames per second that the timecode counts, where the file cannot tell.

    Raises:
        InputError: with the line, when the table is broken.
    """
    source = path if isinstance(path, Source) else Source.open(path)
    header, rows = _parse(source)
    rate = clock if clock is not None else _clock(rows, source)
    drops = _drops_numbers(rows, rate)
    time, kept, notes = _timeline(rows, rate, drops, source)
    step = float(np.median(np.diff(time)))
    slow = _NTSC if drops else 1.0
    own = _nice_rate(slow / step) / slow
    dropped = int(np.sum(np.maximum(np.round(np.diff(time) / step) - 1, 0)))
    if dropped:
        notes.append(f"{dropped} dropped frames were filled linearly.")
    counts = f"{rate / slow:.4g} per second{' (drop-frame)' if drops else ''}"
    notes.append(f"Timecode counts {counts}, rows come at {own:.4g} Hz.")
    target = own if fps is None else fps
    grid = _grid(time, target, source)
    values = rows.values[kept]
    columns = [np.interp(grid, time, column) for column in values.T]
    return Take(source.name, grid, header, np.stack(columns, axis=1), source.sha256, tuple(notes))


def _grid(time: NDArray[np.float64], fps: float, source: Source) -> NDArray[np.float64]:
    fps = checked_rate(source, fps)
    count = int(np.floor(time[-1] * fps + 0.5)) + 1
    if count > LONGEST:
        raise InputError(
            f"its timecodes span {time[-1]:.0f} s, {count} frames at {fps:g} Hz; "
            f"at most {LONGEST} are read.",
            path=source.path,
        )
    return np.arange(max(count, 2)) / fps


def _parse(source: Source) -> tuple[tuple[str, ...], _Rows]:
    head, lines = cells(source)
    if len(head) < 3 or head[0].strip().lower() != "timecode":
        raise InputError(
            "no Live Link header (Timecode,BlendshapeCount,…).", path=source.path, line=1
        )
    titles = [cell.strip() for cell in head]
    while titles[-1] == "":  # a comma at the end of every line
        titles.pop()
    lead = 2 if titles[1].lower().startswith("blendshape") else 1
    header = tuple(titles[lead:])
    if len(set(header)) != len(header) or "" in header:
        raise InputError(
            "a channel name is missing or twice in the header.", path=source.path, line=1
        )
    # Where the face was lost, the count is zero and what stands behind it no expression.
    seen = [(line, row) for line, row in lines if lead == 1 or row[1:2] not in (["0"], [""])]
    if len(seen) < 2:
        raise InputError("fewer than two frames in which a face was seen.", path=source.path)
    parsed = [_row(source, line, row, len(header), lead) for line, row in seen]
    whole, frames, values, marked = zip(*parsed, strict=True)
    table = np.array(values, dtype=np.float64)
    return header, _Rows(np.array(whole), np.array(frames), table, any(marked))


def _row(
    source: Source, line: int, row: list[str], width: int, lead: int
) -> tuple[float, float, list[float], bool]:
    while len(row) > width + lead and not row[-1].strip():
        row = row[:-1]
    if len(row) != width + lead:
        raise InputError(
            f"{len(row)} columns where the header has {width + lead}.", path=source.path, line=line
        )
    match = _TIMECODE.fullmatch(row[0])
    if match is None:
        raise InputError(
            f"{row[0][:40]!r} is not a timecode HH:MM:SS:FF.", path=source.path, line=line
        )
    hours, minutes, seconds = (int(g) for g in match.groups()[:3])
    try:
        values = [float(cell) for cell in row[lead:]]
    except ValueError as error:
        raise InputError(f"not a number: {error}.", path=source.path, line=line) from error
    if not np.isfinite(values).all():
        raise InputError("a value is not finite.", path=source.path, line=line)
    whole = 3600.0 * hours + 60.0 * minutes + seconds
    return whole, float(match.group(5)), values, match.group(4) == ";"


def _clock(rows: _Rows, source: Source) -> float:
    """The slowest usual clock that can count to the largest frame number seen."""
    largest = float(np.floor(rows.frames.max()))
    if len(np.unique(rows.seconds)) > 2:
        return next((c for c in _CLOCKS if c > largest), largest + 1.0)
    return next((c for c in (30.0, 60.0, 120.0) if c > largest), largest + 1.0)


def _drops_numbers(rows: _Rows, clock: float) -> bool:
    """Whether the clock leaves out the first numbers of every minute but each tenth."""
    if clock not in (30.0, 60.0):
        return False
    starts = (rows.seconds % 60 == 0) & (rows.seconds // 60 % 10 != 0)
    if (starts & (rows.frames < clock / 15)).any():
        return False
    # Minutes that begin inside the take, without a gap that would explain the missing numbers.
    here = np.flatnonzero(starts[1:] & ~starts[:-1]) + 1
    before = clock - rows.frames[here - 1]
    near = (rows.seconds[here - 1] == rows.seconds[here] - 1) & (before <= 3)
    return rows.marked or bool((near & (rows.frames[here] <= clock / 15 + 3)).any())


def _timeline(
    rows: _Rows, clock: float, drops: bool, source: Source
) -> tuple[NDArray[np.float64], NDArray[np.bool_], list[str]]:
    if rows.frames.max() >= clock + 1:
        raise InputError(
            f"frame numbers reach {rows.frames.max():g}, more than a clock of {clock:g} counts.",
            path=source.path,
        )
    seconds = rows.seconds.copy()
    seconds[1:] += _DAY * np.cumsum(np.diff(seconds) < -_DAY / 2)  # past midnight
    time = _steadier(seconds, rows.frames, clock)
    if drops:
        minutes = seconds // 60
        time = (time - (minutes - minutes // 10) / 15.0) * _NTSC
    notes = []
    kept = np.ones(len(time), dtype=bool)
    latest = np.maximum.accumulate(time)
    kept[1:] = time[1:] > latest[:-1] + 1e-9
    if not kept.all():
        notes.append(f"{int((~kept).sum())} rows whose timecode does not advance were left out.")
    if kept.sum() < 2:
        raise InputError("timecodes do not advance.", path=source.path)
    return time[kept] - time[kept][0], kept, notes


def _steadier(
    seconds: NDArray[np.float64], frames: NDArray[np.float64], clock: float
) -> NDArray[np.float64]:
    """Times with or without the frames' fractions, whichever advance more evenly.

    A fraction places a row between two counts; but some recorders let it run on by itself and wrap
    without a carry (39.999, 40.000, 41.001), where the whole numbers alone are right.
    """
    with_fractions, whole = seconds + frames / clock, seconds + np.floor(frames) / clock

    def unevenness(time: NDArray[np.float64]) -> float:
        steps = np.diff(time)
        return float(np.abs(steps - np.median(steps)).max(initial=0.0))

    return whole if unevenness(whole) < unevenness(with_fractions) else with_fractions


def _nice_rate(rate: float) -> float:
    nearest = min((24.0, 25.0, 30.0, 48.0, 50.0, 60.0, 100.0, 120.0), key=lambda c: abs(c - rate))
    return nearest if abs(nearest - rate) < 0.02 * nearest else rate
