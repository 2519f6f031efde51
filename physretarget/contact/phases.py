"""The timetable of an actor's contacts, and the file in which it can be set by hand."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from numpy.typing import NDArray

from physretarget.capture.actor import CONTACT_POINTS
from physretarget.errors import InputError
from physretarget.files import write_file
from physretarget.kinematics import runs

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

KNOWN_POINTS = CONTACT_POINTS
"""The points that a timetable may name."""


@dataclass(frozen=True, eq=False)
class Phases:
    """Which of the actor's contact points are planted, and when.

    ``names`` of the n points; ``active`` (T, n) True while planted; ``time`` (T,) s.
    """

    names: tuple[str, ...]
    active: Bools
    time: Floats

    def at(self, time: Floats) -> Phases:
        """The same timetable sampled at other times (nearest frame; the ends are held).

        Args:
            time: (T,) times, s.

        Returns:
            The timetable at those times.
        """
        time = np.asarray(time, dtype=np.float64)
        middle = 0.5 * (self.time[1:] + self.time[:-1])
        return Phases(self.names, self.active[np.searchsorted(middle, time)], time)

    def of(self, point: str | None) -> Bools:
        """(T,) when ``point`` is planted; never, for a point that is not in the timetable.

        Args:
            point: One of the actor's contact points, or None.

        Returns:
            (T,) whether it stands.
        """
        if point in self.names:
            return self.active[:, self.names.index(point)]
        return np.zeros(len(self.time), dtype=bool)

    def intervals(self) -> list[tuple[str, float, float]]:
        """(point, start, end) in s of every planted phase; a phase ends with its last frame."""
        return [
            (name, float(self.time[first]), float(self.time[last]))
            for k, name in enumerate(self.names)
            for first, last in runs(self.active[:, k])
        ]


def any_point(active: Bools) -> Bools:
    """(T,) whether any of n points (T, n) is planted."""
    return np.asarray(active.any(axis=1), dtype=np.bool_)


def from_intervals(
    intervals: Sequence[tuple[str, float, float]], time: Floats, names: tuple[str, ...]
) -> Phases:
    """The timetable at ``time`` of (point, start, end) in s; both ends are planted."""
    active = np.zeros((len(time), len(names)), dtype=bool)
    half = 0.5 * float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    for name, start, end in intervals:
        inside = (time >= start - 0.99 * half) & (time <= end + 0.99 * half)
        active[:, names.index(name)] |= inside
    return Phases(names, active, time)


def write_phases(phases: Phases, path: str | PathLike[str]) -> None:
    """Write a timetable as TOML, one ``[[phase]]`` per planted phase, to be edited by hand.

    Args:
        phases: The phases.
        path: The TOML file.
    """
    header = (
        "# When the actor's contact points are planted on the floor.\n"
        "# point: one of " + ", ".join(KNOWN_POINTS) + "\n# start, end: s, both included\n"
    )
    table = {
        "points": list(phases.names),
        "fps": _fps(phases.time),
        "duration": round(float(phases.time[-1]), 6),
        "phase": [
            {"point": name, "start": round(start, 6), "end": round(end, 6)}
            for name, start, end in phases.intervals()
        ],
    }
    write_file(path, (header + tomli_w.dumps(table)).encode())


def read_phases(path: str | PathLike[str], *, time: Floats | None = None) -> Phases:
    """Read a timetable that was written by :func:`write_phases` or by hand.

    Only ``[[phase]]`` tables with ``point``, ``start`` and ``end`` (s) are needed. ``time``
    (T,) are the frames to sample it at; without it the file's ``fps`` and ``duration`` are
    used, by default 120 Hz up to the last end.

    Args:
        path: The TOML file.
        time: (T,) frames to sample it at, s.

    Returns:
        The phases.

    Raises:
        InputError: with the line, for broken TOML, unknown points or keys, or bad times.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
    except OSError as why:
        raise InputError(f"cannot be read: {why.strerror}.", path=path) from why
    except UnicodeDecodeError as why:
        raise InputError("is not text (UTF-8).", path=path) from why
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as why:
        found = re.search(r"at line (\d+)", str(why))
        line = int(found[1]) if found else text.count("\n") + 1
        raise InputError(f"not valid TOML: {why}", path=path, line=line) from why
    if not table:
        raise InputError(
            "the contact file is empty: it needs points or [[phase]] tables.", path=path
        )
    lines = [n for n, row in enumerate(text.splitlines(), 1) if row.strip() == "[[phase]]"]
    intervals = _intervals(table, lines, path)
    names = _names(table, path)
    names += tuple(n for n in KNOWN_POINTS if n not in names and any(i[0] == n for i in intervals))
    if time is None:
        time = _frames(table, intervals, path)
    return from_intervals(intervals, np.asarray(time, dtype=np.float64), names)


def _intervals(
    table: dict[str, Any], lines: list[int], path: str | PathLike[str]
) -> list[tuple[str, float, float]]:
    unknown = sorted(set(table) - {"phase", "points", "fps", "duration"})
    if unknown:
        raise InputError(
            f"unknown key {unknown[0]!r}; allowed are phase, points, fps and duration.", path=path
        )
    rows = table.get("phase", [])
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise InputError("phase must be a list of [[phase]] tables.", path=path)
    found = []
    for k, row in enumerate(rows):
        line = lines[k] if k < len(lines) else None
        if set(row) != {"point", "start", "end"}:
            given = ", ".join(sorted(row)) or "nothing"
            raise InputError(
                f"a phase needs point, start and end; it has {given}.", path=path, line=line
            )
        if row["point"] not in KNOWN_POINTS:
            raise InputError(
                f"unknown contact point {row['point']!r}; it is one of {', '.join(KNOWN_POINTS)}.",
                path=path,
                line=line,
            )
        start, end = row["start"], row["end"]
        if not (_is_time(start) and _is_time(end) and end >= start):
            raise InputError(
                f"a phase needs 0 <= start <= end in seconds; it has start {start!r}, end {end!r}.",
                path=path,
                line=line,
            )
        found.append((str(row["point"]), float(start), float(end)))
    return found


def _is_time(value: object) -> bool:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return number and math.isfinite(value) and value >= 0.0  # type: ignore[arg-type,operator]


def _names(table: dict[str, Any], path: str | PathLike[str]) -> tuple[str, ...]:
    names = table.get("points", [])
    if not isinstance(names, list) or any(n not in KNOWN_POINTS for n in names):
        raise InputError(f"points must be a list out of {', '.join(KNOWN_POINTS)}.", path=path)
    return tuple(dict.fromkeys(names))


def _frames(
    table: dict[str, Any],
    intervals: list[tuple[str, float, float]],
    path: str | PathLike[str],
) -> Floats:
    fps, duration = table.get("fps", 120.0), table.get("duration")
    if duration is None:
        duration = max((end for _, _, end in intervals), default=0.0)
    if not (_is_time(fps) and 1 <= fps <= 10_000 and _is_time(duration) and duration <= 86_400):
        raise InputError("fps must lie in 1..10000 and duration in 0..86400 s.", path=path)
    return np.arange(round(float(duration) * float(fps)) + 1) / float(fps)


def _fps(time: Floats) -> float:
    return round(1.0 / float(np.median(np.diff(time))), 6) if len(time) > 1 else 120.0
