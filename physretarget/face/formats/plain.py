"""Plain CSV (dense) and JSON (keys): the formats for everything else, round trips exact.

CSV: a header ``time,channel,...`` and rows in seconds. JSON::

    {"format": "physretarget/curves/1", "name": "shot", "fps": 30, "curves": {"brow": {
        "weighted": true, "keys": [{"time": 0.0, "value": 1.0, "in": [-0.1, 0.0],
        "out": [0.1, 0.0], "in_type": "fixed", "out_type": "fixed", "broken": false}]}}}

Everything of a key but time and value may be left out; tangents then are ``auto``.
"""

from __future__ import annotations

import csv
import io
import json
from dataclasses import replace
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physretarget.errors import InputError
from physretarget.face.curve import Curve, Key
from physretarget.face.formats.source import Source, mapping, number, numbers, sequence
from physretarget.face.shot import Shot, Take
from physretarget.files import write_file

FORMAT = "physretarget/curves/1"
# Rows so many seconds apart hold no face that moves, in milliseconds up to 250 a second.
_MILLISECONDS = 4.0
# Rows whose distances differ by less than this share stand evenly: whole milliseconds at 60 Hz do.
_ROUNDED = 0.1


def read_csv(path: str | PathLike[str] | Source) -> Take:
    """A dense take; uneven times are resampled at their median distance."""
    source = path if isinstance(path, Source) else Source.open(path)
    text = source.text()
    # Where the comma is a decimal one, semicolons stand between cells.
    commas = ";" in text.partition("\n")[0]
    reader = csv.reader(io.StringIO(text), delimiter=";" if commas else ",")
    try:
        lines = [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    except csv.Error as error:
        raise InputError(f"broken CSV: {error}.", path=source.path, line=reader.line_num) from error
    if not lines or lines[0][1][0].strip().lower() not in ("time", "t", "seconds"):
        raise InputError("the first line must be a header time,channel,…", path=source.path, line=1)
    header = tuple(cell.strip() for cell in lines[0][1][1:])
    if not header or len(set(header)) != len(header) or "" in header:
        raise InputError("channel names must be given and differ.", path=source.path, line=1)
    rows = []
    for line, row in lines[1:]:
        if len(row) != len(header) + 1:
            raise InputError(
                f"{len(row)} columns where the header has {len(header) + 1}.",
                path=source.path,
                line=line,
            )
        try:
            rows.append([float(cell.replace(",", ".") if commas else cell) for cell in row])
        except ValueError as error:
            raise InputError(f"not a number: {error}.", path=source.path, line=line) from error
        if not np.isfinite(rows[-1]).all():
            raise InputError("a value is not finite.", path=source.path, line=line)
        if len(rows) > 1 and rows[-1][0] <= rows[-2][0]:
            raise InputError("times must increase.", path=source.path, line=line)
    if len(rows) < 2:
        raise InputError("fewer than two frames.", path=source.path)
    table = np.array(rows, dtype=np.float64)
    return _uniform(source, header, table)


def _uniform(source: Source, header: tuple[str, ...], table: NDArray[np.float64]) -> Take:
    time = table[:, 0] - table[0, 0]
    step = float(np.median(np.diff(time)))
    notes: tuple[str, ...] = ()
    if step >= _MILLISECONDS:
        notes = (f"Times are milliseconds: as seconds, rows would be {step:g} s apart.",)
        time, step = time / 1000.0, step / 1000.0
    mean = float(time[-1]) / (len(time) - 1)
    if np.abs(np.diff(time) - mean).max() < _ROUNDED * mean:
        step = mean  # times are rounded: their mean distance is the true one
    if time[-1] / step > 1_000_000:
        raise InputError("more than a million frames after resampling.", path=source.path)
    grid = np.asarray(step * np.arange(int(np.floor(time[-1] / step + 0.5)) + 1), np.float64)
    values = table[:, 1:]
    if len(grid) != len(time) or np.abs(grid - time).max() > 1e-3 * step:
        notes += (f"Uneven times were resampled at {1 / step:g} Hz.",)
        values = np.stack([np.interp(grid, time, v) for v in values.T], axis=1)
    else:
        grid = time
    return Take(source.name, grid, header, values, source.sha256, notes)


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
