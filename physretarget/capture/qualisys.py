"""Qualisys Track Manager's TSV: markers in mm, z up, one line a frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from physretarget.capture.marker_file import RawMarkers, finish, markers_of, read_bytes
from physretarget.capture.reader import ReadOptions
from physretarget.capture.recording import MarkerRecording
from physretarget.capture.text import decoded, plain_numbers
from physretarget.errors import InputError

_MOST_MARKERS, _LONGEST_HEADER = 2000, 60


def read(path: str | Path, options: ReadOptions) -> MarkerRecording:
    """Read a TSV export of 3-D data.

    Raises:
        InputError: With the line, for what cannot be understood.
    """
    content = read_bytes(path)
    lines = decoded(content).splitlines()
    said: dict[str, list[str]] = {}
    at = 0
    while at < min(len(lines), _LONGEST_HEADER):
        cells = lines[at].split("\t")
        if not cells[0] or not cells[0].replace("_", "").isalpha():
            break
        if cells[0] == "Frame":  # a line of column names, which newer versions add
            at += 1
            break
        said[cells[0].upper()] = [cell.strip() for cell in cells[1:]]
        at += 1
    labels = tuple(name for name in said.get("MARKER_NAMES", []) if name)
    try:
        fps = float(said["FREQUENCY"][0])
    except (KeyError, IndexError, ValueError) as error:
        raise InputError("the header must give FREQUENCY as a number.", path=path) from error
    if not labels or len(labels) > _MOST_MARKERS:
        raise InputError(
            f"the header names {len(labels)} markers, 1 to {_MOST_MARKERS} are read.", path=path
        )
    body, notes = plain_numbers(lines[at:])
    rows = [_row(line, 3 * len(labels), path, at + n + 1) for n, line in enumerate(body) if line]
    if not rows:
        raise InputError("there is no frame after the header.", path=path, line=at)
    raw = RawMarkers(
        path=path, content=content, format="qualisys", fps=fps, labels=labels,
        position=np.array(rows).reshape(len(rows), -1, 3), unit="mm", up=None, usual_up="z",
        notes=tuple(notes),
    )  # fmt: skip
    found = finish(raw, unit=options.unit, up=options.up, names=options.names)
    return found if options.subject is None else markers_of(found, options.subject)


def _row(line: str, width: int, path: str | Path, number: int) -> list[float]:
    """The last ``width`` numbers of a line; frame and time may stand before them."""
    cells = [cell.strip() for cell in line.rstrip("\r\n").split("\t")]
    while len(cells) > width and not cells[-1]:
        cells.pop()
    if len(cells) not in (width, width + 1, width + 2):
        raise InputError(
            f"a frame must have {width} numbers, this one has {len(cells)}.", path=path, line=number
        )
    try:
        return [float(cell) if cell else np.nan for cell in cells[-width:]]
    except ValueError as error:
        raise InputError("a cell is not a number.", path=path, line=number) from error
