"""Plain CSV (dense) and JSON (keys): the formats for everything else, round trips exact.

CSV: a header ``time,channel,...`` and rows in seconds; Audio2Face and MediaPipe recorders write
such tables, too. JSON::

    {"format": "physretarget/curves/1", "name": "shot", "fps": 30, "curves": {"brow": {
        "weighted": true, "keys": [{"time": 0.0, "value": 1.0, "in": [-0.1, 0.0],
        "out": [0.1, 0.0], "in_type": "fixed", "out_type": "fixed", "broken": false}]}}}

Everything of a key but time and value may be left out; tangents then are ``auto``.
"""

from __future__ import annotations

import csv
import io
import json
import math
import re
from dataclasses import replace
from os import PathLike
from typing import Any

import numpy as np

from physretarget.errors import InputError
from physretarget.face.curve import Curve, Key
from physretarget.face.formats.dense import dense_take, is_clock, seconds
from physretarget.face.formats.source import Source, mapping, number, numbers, sequence
from physretarget.face.shot import Shot, Take
from physretarget.files import write_file

FORMAT = "physretarget/curves/1"
# Heads of a column of times, and their unit where they say it.
_TIMES: dict[str, str | None] = {
    "time": None, "t": None, "timestamp": None, "timecode": None, "seconds": "s", "sec": "s",
    "time_s": "s", "time_sec": "s", "timestamp_s": "s", "milliseconds": "ms", "ms": "ms",
    "time_ms": "ms", "timestamp_ms": "ms", "timestampms": "ms", "time_us": "us",
    "timestamp_us": "us", "timestamp_ns": "ns",
}  # fmt: skip
# Columns that are no channel: row numbers, and MediaPipe's weight of the face at rest.
_COUNTERS = ("frame", "index", "frame_number", "frame_idx", "_neutral")
_AUDIO2FACE = "blendShapes."


def read_csv(path: str | PathLike[str] | Source, *, fps: float | None = None) -> Take:
    """A dense take: a column of times, whose head may name their unit, and one per channel.

    Args:
        path: the table; commas, semicolons or tabs between cells.
        fps: frame rate of the take; the rows' own by default.

    Returns:
        The take; uneven times are resampled, blank cells are gaps.

    Raises:
        InputError: with the line, when the table is broken.
    """
    source = path if isinstance(path, Source) else Source.open(path)
    head, rows = cells(source)
    titles = [cell.strip() for cell in head]
    while titles and titles[-1] == "":  # a comma at the end of every line
        titles.pop()
    number = next((k for k, title in enumerate(titles[:3]) if title.lower() in _TIMES), None)
    if number is None or any(t.lower() not in ("", *_COUNTERS) for t in titles[:number]):
        raise InputError(
            "the first line must be a header time,channel,…; a column time_ms holds milliseconds.",
            path=source.path,
            line=1,
        )
    used = [k for k in range(number + 1, len(titles)) if titles[k].lower() not in _COUNTERS]
    header = tuple(titles[k].removeprefix(_AUDIO2FACE) for k in used)
    if not header or len(set(header)) != len(header) or "" in header:
        raise InputError("channel names must be given and differ.", path=source.path, line=1)
    unit = _TIMES[titles[number].lower()]
    times, table = [], []
    for line, row in rows:
        while len(row) > len(titles) and not row[-1].strip():
            row = row[:-1]
        if len(row) != len(titles):
            raise InputError(
                f"{len(row)} columns where the header has {len(titles)}.",
                path=source.path,
                line=line,
            )
        try:
            times.append(seconds(row[number]))
            table.append([float(row[k]) if row[k].strip() else math.nan for k in used])
        except ValueError as error:
            raise InputError(f"not a number: {error}.", path=source.path, line=line) from error
        unit = "s" if is_clock(row[number]) else unit
        blank = [not row[k].strip() for k in used]
        if not np.isfinite([times[-1], *table[-1]])[[True, *(not b for b in blank)]].all():
            raise InputError("a value is not finite.", path=source.path, line=line)
        if len(times) > 1 and times[-1] <= times[-2]:
            raise InputError("times must increase.", path=source.path, line=line)
    return dense_take(source, times, header, np.array(table), unit=unit, fps=fps)


def is_table(source: Source) -> bool:
    """Whether the first line is the head of a table with times."""
    first = source.content[:4096].lstrip(b"\xef\xbb\xbf").split(b"\n", 1)[0]
    words = re.split(r"[,;\t]", first.decode("utf-8", "replace").lower())
    return any(w.strip(" \"'\r") in _TIMES for w in words[:3])


def is_audio2face_table(source: Source) -> bool:
    """Whether the table's channels bear the prefix that Audio2Face gives them."""
    return is_table(source) and f",{_AUDIO2FACE}".encode() in source.content[:4096]


def cells(source: Source) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Head and rows of a CSV, each row with its line; decimal commas become points.

    Where the comma is a decimal one, semicolons or tabs stand between cells.
    """
    text = source.text()
    delimiter = max(",;\t", key=text.partition("\n")[0].count)
    reader = csv.reader(io.StringIO(text), delimiter=delimiter, skipinitialspace=True)
    try:
        lines = [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    except csv.Error as error:
        raise InputError(f"broken CSV: {error}.", path=source.path, line=reader.line_num) from error
    if not lines:
        raise InputError("it is empty.", path=source.path, line=1)
    (_, head), *rows = lines
    if delimiter != ",":
        rows = [(line, [cell.replace(",", ".") for cell in row]) for line, row in rows]
    return head, rows


def write_csv(path: str | PathLike[str], take: Take) -> None:
    """Every digit kept: reading it back gives the same numbers."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["time", *take.channels])
    for time, row in zip(take.time.tolist(), take.values.tolist(), strict=True):
        writer.writerow([repr(time), *(repr(v) for v in row)])
    write_file(path, out.getvalue().encode())


def is_curves(content: Any) -> bool:
    """Whether parsed JSON is this format."""
    return isinstance(content, dict) and content.get("format") == FORMAT


def read_json(path: str | PathLike[str] | Source) -> Shot:
    """Read keyed curves."""
    source = path if isinstance(path, Source) else Source.open(path)
    content = mapping(source, "file", source.json())
    if not is_curves(content):
        source.fail("format", f"must be {FORMAT!r}.")
    fps = content.get("fps")
    rate = None if fps is None else number(source, "fps", fps)
    curves = {
        name: _curve(source, name, entry)
        for name, entry in mapping(source, "curves", content.get("curves")).items()
    }
    return Shot(str(content.get("name", source.path.stem)), curves, rate, source.sha256)


def _curve(source: Source, name: str, entry: Any) -> Curve:
    body = mapping(source, f"curve {name}", entry)
    keys, items = [], []
    for index, item in enumerate(sequence(source, f"curve {name} keys", body.get("keys"))):
        where = f"curve {name}, key {index}"
        items.append(mapping(source, where, item))
        keys.append(_key(source, where, items[-1]))
    try:
        curve = Curve(tuple(keys), bool(body.get("weighted", True)))
        computed = curve.retangented().keys
    except InputError as error:
        raise InputError(f"curve {name}: {error}", path=source.path) from error
    return replace(
        curve,
        keys=tuple(
            replace(
                key,
                in_tangent=auto.in_tangent if item.get("in") is None else key.in_tangent,
                out_tangent=auto.out_tangent if item.get("out") is None else key.out_tangent,
            )
            for key, auto, item in zip(keys, computed, items, strict=True)
        ),
    )


def _key(source: Source, where: str, item: dict[str, Any]) -> Key:
    given = {side: item.get(side) for side in ("in", "out")}
    kinds = {s: item.get(f"{s}_type", "auto" if given[s] is None else "fixed") for s in given}
    tangents = {}
    for side, value in given.items():
        dx, dy = numbers(source, where, [0.0, 0.0] if value is None else value, 2)
        tangents[side] = (dx, dy)
    return Key(
        number(source, where, item.get("time")),
        number(source, where, item.get("value")),
        tangents["in"],
        tangents["out"],
        kinds["in"],
        kinds["out"],
        bool(item.get("broken", False)),
    )


def write_json(path: str | PathLike[str], shot: Shot) -> tuple[str, ...]:
    """Write keyed curves; nothing is lost. Returns the losses: none."""
    curves = {
        name: {
            "weighted": curve.weighted,
            "keys": [
                {
                    "time": key.time,
                    "value": key.value,
                    "in": list(key.in_tangent),
                    "out": list(key.out_tangent),
                    "in_type": key.in_type,
                    "out_type": key.out_type,
                    "broken": key.broken,
                }
                for key in curve.keys
            ],
        }
        for name, curve in shot.curves.items()
    }
    content = {"format": FORMAT, "name": shot.name, "fps": shot.fps, "curves": curves}
    write_file(path, (json.dumps(content, indent=1) + "\n").encode())
    return ()
