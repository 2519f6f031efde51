"""The numbers of a BVH file: everything after MOTION."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from physretarget.capture.bvh_hierarchy import MAX_VALUE
from physretarget.capture.recording import Floats
from physretarget.errors import InputError


def _header(
    lines: list[str], start: int, pattern: str, what: str, path: str | Path
) -> tuple[int, str]:
    """The next non-blank line, which must be the header line ``what``."""
    for number in range(start, len(lines)):
        if lines[number].strip():
            match = re.match(pattern, lines[number].strip(), re.IGNORECASE)
            if match:
                return number, match[1]
            break
    else:
        number = len(lines) - 1
    raise InputError(f"Expected '{what}' here.", path=path, line=number + 1)


def parse_motion(
    lines: list[str], start: int, width: int, path: str | Path
) -> tuple[float, Floats, tuple[str, ...]]:
    """Frame time in seconds, the values (T, width) after the MOTION line, and what was odd."""
    at, count = _header(lines, start + 1, r"frames\s*:?\s*(\d{1,12})(?:\.0*)?$", "Frames: N", path)
    at, seconds = _header(lines, at + 1, r"frame\s*time\s*:?\s*([^\s:]\S*)$", "Frame Time: s", path)
    try:
        frame_time = float(seconds)
    except ValueError:
        frame_time = np.nan
    if not 1e-4 <= frame_time <= 2.0:
        raise InputError(
            f"The frame time is {seconds[:40]!r}; it must lie between 0.0001 and 2 s "
            "(0.0333333 for 30 frames per second).",
            path=path,
            line=at + 1,
        )
    if width == 0:
        raise InputError("No joint has a channel, so nothing moves.", path=path, line=at + 1)
    rows = _rows(_frame_lines(lines, at + 1, width, int(count)), width, path)
    if len(rows) == 0:
        raise InputError("There are no frames.", path=path, line=len(lines))
    if len(rows) < int(count):
        raise InputError(
            f"Frames: {count} is declared, but the file holds {len(rows)}.",
            path=path,
            line=len(lines),
        )
    if len(rows) > int(count):
        return frame_time, rows, (f"{count} frames are declared; all {len(rows)} were read",)
    return frame_time, rows, ()


def _frame_lines(
    lines: list[str], start: int, width: int, count: int
) -> Iterator[tuple[int, list[str]]]:
    """Line numbers (from 1) and words of each frame; some writers break a frame's line.

    Broken lines are put together only if the file holds exactly the values that it declares.
    """
    first = next((line for line in lines[start:] if line.strip()), "")
    if len(first.split()) < width and (
        sum(len(lines[i].split()) for i in range(start, len(lines))) == width * count
    ):
        pending: list[str] = []
        began = start
        for number in range(start, len(lines)):
            began = began if pending else number
            pending += lines[number].split()
            while len(pending) >= width:
                yield began + 1, pending[:width]
                pending, began = pending[width:], number
        return
    for number in range(start, len(lines)):
        words = lines[number].split()
        if len(words) < width:  # some writers leave the blank before a minus sign out
            words = _GLUED.sub(" ", lines[number]).split()
        if words:
            yield number + 1, words


_GLUED = re.compile(r"(?<=[0-9.])(?=-[0-9.])")
_BLOCK = 2000  # rows turned into an array at a time: Python floats take four times the memory


def _rows(frames: Iterable[tuple[int, list[str]]], width: int, path: str | Path) -> Floats:
    """All frames; the error names the line whose count or number is wrong."""
    blocks = [np.empty((0, width))]
    values: list[float] = []
    for number, words in frames:
        if len(words) != width:
            raise InputError(
                f"A frame needs {width} values, this line has {len(words)}.",
                path=path,
                line=number,
            )
        try:
            row = [float(word) for word in words]
        except ValueError:
            raise InputError("A value is not a number.", path=path, line=number) from None
        if not -MAX_VALUE <= min(row) <= max(row) <= MAX_VALUE and any(
            abs(value) > MAX_VALUE for value in row
        ):
            raise InputError(
                f"A value is infinite or beyond {MAX_VALUE:g}.", path=path, line=number
            )
        values += row
        if len(values) >= _BLOCK * width:
            blocks.append(np.array(values).reshape(-1, width))
            values = []
    return np.concatenate([*blocks, np.array(values).reshape(-1, width)])
