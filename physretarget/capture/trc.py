"""TRC: tab-separated marker trajectories, as OpenSim, OpenCap and Cortex write them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from physretarget.capture.marker_file import RawMarkers, finish, markers_of, read_bytes
from physretarget.capture.reader import ReadOptions
from physretarget.capture.recording import Floats, MarkerRecording, Names
from physretarget.capture.text import decoded, plain_numbers
from physretarget.errors import InputError

_MOST_MARKERS = 2000
_LONGEST_STRETCH = 10  # times more frames after missing ones are filled in: then it is nonsense


@dataclass(frozen=True, kw_only=True)
class _Header:
    fps: float
    frames: int | None
    unit: str | None
    labels: tuple[str, ...]
    first: int  # index of the first line that may hold data


def read(path: str | Path, options: ReadOptions) -> MarkerRecording:
    """Read a file as the registry of readers does; see :func:`read_trc`."""
    found = read_trc(path, unit=options.unit, up=options.up, names=options.names)
    return found if options.subject is None else markers_of(found, options.subject)


def read_trc(
    path: str | Path,
    *,
    unit: str | None = None,
    up: str | None = None,
    names: Names | None = None,
) -> MarkerRecording:
    """Read a TRC file: metres, centimetres or millimetres, any up axis, ragged tabs and gaps.

    Empty cells, ``nan`` and exact zeros are gaps; frames that the time column skips become
    frames without markers. Raises InputError, with the line, for what cannot be understood,
    and where the file holds fewer frames than it promises.
    """
    content = read_bytes(path)
    lines = decoded(content).splitlines()
    header = _header(lines, path)
    lines[header.first :], odd = plain_numbers(lines[header.first :])
    time, values = _rows(lines, header, path)
    if header.frames is not None and len(values) < header.frames:
        raise InputError(
            f"the file is cut short: it promises {header.frames} frames and holds {len(values)}",
            path=path,
            line=len(lines),
        )
    time, late = _seconds(header, time)
    fps, position, notes = _uniform(header, time, values, path)
    notes = [*odd, *late, *notes]
    if header.frames is not None and len(values) > header.frames:
        notes.append(f"the header promises {header.frames} frames; all {len(values)} were read")
    raw = RawMarkers(
        path=path,
        content=content,
        format="trc",
        fps=fps,
        labels=header.labels,
        position=position,
        unit=header.unit,
        up=None,
        usual_up="y",
        notes=tuple(notes),
        start=float(time[0]),
    )
    return finish(raw, unit=unit, up=up, names=names)


def _header(lines: list[str], path: str | Path) -> _Header:
    start = next((i for i, line in enumerate(lines) if line.strip()), None)
    if start is None or not lines[start].lower().startswith("pathfiletype"):
        raise InputError(
            "this is not a TRC file: it must begin with PathFileType", path=path, line=1
        )
    if len(lines) < start + 5:
        raise InputError("the header is cut short", path=path, line=len(lines))
    keys, values = lines[start + 1].split(), lines[start + 2].split()
    said = dict(zip((key.lower() for key in keys), values, strict=False))
    line = start + 3
    if not re.match(r"\s*frame\s*#", lines[line].lower()):
        raise InputError(
            "the fourth line must begin with Frame# and name the markers", path=path, line=line + 1
        )
    try:
        fps = float(said["datarate"].replace(",", "."))
        frames = int(said["numframes"]) if "numframes" in said else None
        count = int(said["nummarkers"]) if "nummarkers" in said else None
    except (KeyError, ValueError) as error:
        raise InputError(
            "the third line must give DataRate, NumFrames and NumMarkers as numbers",
            path=path,
            line=start + 3,
        ) from error
    labels = _labels(lines[line], count)
    if not labels or len(labels) > _MOST_MARKERS or (count is not None and count != len(labels)):
        raise InputError(
            f"the header promises {count} markers and names {len(labels)}; at most "
            f"{_MOST_MARKERS} are read",
            path=path,
            line=line + 1,
        )
    return _Header(fps=fps, frames=frames, unit=said.get("units"), labels=labels, first=start + 4)


def _labels(line: str, count: int | None) -> tuple[str, ...]:
    """Marker names: cells between tabs, or words where tabs do not give the right number."""
    cells = [cell.strip() for cell in line.split("\t")]
    names = [cell for cell in cells[2:] if cell]
    if count is not None and len(names) != count:
        words = re.sub(r"^\s*frame\s*#\s*time", "", line, flags=re.IGNORECASE).split()
        names = words if len(words) == count else names
    return tuple(names)


def _rows(lines: list[str], header: _Header, path: str | Path) -> tuple[Floats, Floats]:
    """Times (T,) and coordinates (T, M, 3), NaN for empty cells."""
    width = 2 + 3 * len(header.labels)
    rows = []
    for number in range(header.first, len(lines)):
        line = lines[number]
        if not line.strip() or re.match(r"\s*X1\b", line):
            continue
        rows.append(_row(line, width, path, number + 1))
    if not rows:
        raise InputError("there is no frame after the header", path=path, line=len(lines))
    table = np.array(rows)
    return table[:, 1], table[:, 2:].reshape(len(rows), -1, 3)


def _row(line: str, width: int, path: str | Path, number: int) -> list[float]:
    cells = [cell.strip() for cell in line.rstrip("\r\n").split("\t")]
    if len(cells) < 3:
        cells = line.split()
    while len(cells) > width and not cells[-1]:
        cells.pop()
    if len(cells) > width or len(cells) < 2:
        raise InputError(
            f"a frame must have {width} cells (frame, time and three per marker), not {len(cells)}",
            path=path,
            line=number,
        )
    try:
        values = [_value(cell) for cell in cells]
    except ValueError:
        wrong = next(cell for cell in cells if not _is_number(cell))
        raise InputError(f"{wrong[:40]!r} is not a number", path=path, line=number) from None
    if not np.isfinite(values[1]):
        raise InputError("the time is missing", path=path, line=number)
    # Writers leave out the tabs after the last visible marker.
    return values + [np.nan] * (width - len(values))


def _value(cell: str) -> float:
    # Windows prints "1.#QNAN" and "-1.#IND" where there is no number.
    return float(cell) if cell and "#" not in cell else np.nan


def _is_number(cell: str) -> bool:
    try:
        _value(cell)
    except ValueError:
        return False
    return True


def _seconds(header: _Header, time: Floats) -> tuple[Floats, tuple[str, ...]]:
    """The times in seconds: DataRate tells where the column counts milliseconds."""
    if len(time) > 1 and abs(header.fps * np.median(np.diff(time)) / 1000 - 1) < 0.02:
        return time / 1000, ("the time column counts milliseconds",)
    return time, ()


def _uniform(
    header: _Header, time: Floats, values: Floats, path: str | Path
) -> tuple[float, Floats, list[str]]:
    """Put frames on a uniform clock; frames that are not in the file have no markers."""
    if len(time) < 2:
        return header.fps, values, []
    steps = np.diff(time)
    if (steps <= 0).any():
        frame = int(np.argmax(steps <= 0)) + 1
        raise InputError("the time does not increase", path=path, frame=frame)
    notes = []
    fps, measured = header.fps, float(1 / np.median(steps))
    if not (fps > 0 and abs(fps - measured) < 0.02 * measured):
        notes.append(f"rate taken from the time column ({measured:.4g} Hz), not DataRate ({fps:g})")
        fps = measured
    at = np.rint((time - time[0]) * fps).astype(np.int64)
    # A rate rounded in print drifts against the clock: then consecutive rows are the truth.
    if (np.diff(at) < 1).any() or np.abs(steps * fps - 1).max() < 0.5:
        return fps, values, notes
    count = int(at[-1]) + 1
    if count > _LONGEST_STRETCH * len(time):
        raise InputError("the time column has gaps longer than the recording itself", path=path)
    position = np.full((count, *values.shape[1:]), np.nan)
    position[at] = values
    notes.append(f"{count - len(time)} frames that the time column skips have no markers")
    return fps, position, notes
