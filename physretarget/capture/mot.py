"""Ground reaction forces in OpenSim's ``.mot`` and ``.sto`` tables."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from physretarget.capture.marker_file import read_bytes
from physretarget.capture.recording import Floats
from physretarget.capture.skeleton import to_world
from physretarget.capture.text import decoded, plain_numbers
from physretarget.errors import InputError, UsageError
from physretarget.files import write_file

# "ground_force_1_vx", "1_ground_force_px", "ground_force_r_vz", "ground_torque_x", "ground_1_mx"
_COLUMN = re.compile(
    r"^(?P<before>.*?)_?ground_(?:(?P<what>force|torque|moment)_?)?(?P<after>.*?)_?"
    r"(?P<kind>[vpmt]?)(?P<axis>[xyz])$",
    re.IGNORECASE,
)
_MOST_COLUMNS = 5000


@dataclass(frozen=True, kw_only=True, eq=False)
class GroundForce:
    """A force that the floor applies to the body, in the world (z up).

    ``name`` as in the file ("1", "2", "r", "" …); ``time`` (N,) s; ``force`` (N, 3) N at
    ``point`` (N, 3) m; ``torque`` (N, 3) N m, free moment about that point.
    """

    name: str
    time: Floats
    force: Floats
    point: Floats
    torque: Floats


def read_mot(path: str | Path, *, up: str = "y") -> tuple[GroundForce, ...]:
    """Read all ground forces of a ``.mot`` or ``.sto`` file, in the file's order.

    ``up`` is the file's up axis (OpenSim's is y), as for the markers recorded with it.
    Raises InputError, with the line, for a broken table or one without ground forces.
    """
    lines = decoded(read_bytes(path)).splitlines()
    names, first = _columns(lines, path)
    lines[first:], _ = plain_numbers(lines[first:])
    table = _table(lines, first, len(names), path)
    groups: dict[str, dict[tuple[str, int], int]] = {}
    for i, name in enumerate(names):
        match = _COLUMN.match(name)
        if match is None:
            continue
        force_kind = "v" if match["what"] and match["what"].lower() == "force" else "m"
        kind = match["kind"].lower().replace("t", "m") or force_kind
        key = "_".join(part for part in (match["before"], match["after"]) if part)
        groups.setdefault(key, {})[(kind, "xyz".index(match["axis"].lower()))] = i
    if "time" not in names or not groups:
        raise InputError(
            "the table has no time or no ground force columns such as ground_force_1_vx",
            path=path,
            line=first,
        )
    turn = to_world(up)
    time = table[:, names.index("time")]

    def vector(columns: dict[tuple[str, int], int], kind: str) -> Floats:
        parts = [
            table[:, columns[kind, axis]] if (kind, axis) in columns else np.zeros(len(table))
            for axis in range(3)
        ]
        turned: Floats = np.stack(parts, axis=1) @ turn.T
        return turned

    return tuple(
        GroundForce(
            name=name,
            time=time,
            force=vector(columns, "v"),
            point=vector(columns, "p"),
            torque=vector(columns, "m"),
        )
        for name, columns in groups.items()
        if any(kind == "v" for kind, _ in columns)
    )


def _columns(lines: list[str], path: str | Path) -> tuple[list[str], int]:
    """Column names and the index of the first line of numbers."""
    end = next((i for i, line in enumerate(lines) if line.strip().lower() == "endheader"), None)
    if end is None:
        raise InputError("this is no .mot table: there is no endheader", path=path)
    named = next((i for i in range(end + 1, len(lines)) if lines[i].strip()), None)
    if named is None:
        raise InputError("the table has no columns", path=path, line=len(lines))
    names = [name.strip() for name in lines[named].split("\t") if name.strip()]
    if len(names) < 2:
        names = lines[named].split()
    if len(names) > _MOST_COLUMNS:
        raise InputError(f"more than {_MOST_COLUMNS} columns", path=path, line=named + 1)
    return names, named + 1


def _table(lines: list[str], first: int, width: int, path: str | Path) -> Floats:
    rows = []
    for number in range(first, len(lines)):
        if not lines[number].strip():
            continue
        cells = lines[number].split()
        if len(cells) != width:
            raise InputError(
                f"a row must have {width} numbers, not {len(cells)}", path=path, line=number + 1
            )
        try:
            rows.append([float(cell) for cell in cells])
        except ValueError:
            raise InputError("a cell is not a number", path=path, line=number + 1) from None
    if not rows:
        raise InputError("the table has no rows", path=path, line=len(lines))
    return np.array(rows)


_KINDS = (
    ("ground_force_{}_v", "force"),
    ("ground_force_{}_p", "point"),
    ("ground_torque_{}_", "torque"),
)


def write_forces(forces: Sequence[GroundForce], path: str | Path) -> None:
    """Write ground forces on one clock as OpenSim's ``.mot``, or as ``.csv`` with its columns.

    The axes are OpenSim's, y up; :func:`read_mot` reads them back. Numbers have 6 decimals.

    Raises:
        UsageError: the name ends in neither ``.mot`` nor ``.csv``, or clocks differ.
        InputError: the file cannot be written.
    """
    ending = Path(path).suffix.lower()
    if ending not in (".mot", ".csv"):
        raise UsageError(f"forces are written as .mot or .csv, not as {ending or 'no ending'!r}")
    time = forces[0].time
    if any(len(force.time) != len(time) or (force.time != time).any() for force in forces):
        raise UsageError("forces in one file need one clock")
    turn = to_world("y")
    names, columns = ["time"], [time[:, None]]
    for force in forces:
        for kind, field in _KINDS:
            names += [kind.format(force.name) + axis for axis in "xyz"]
            columns.append(getattr(force, field) @ turn)  # the inverse of a rotation
    table = np.concatenate(columns, axis=1)
    separator = "\t" if ending == ".mot" else ","
    lines = [separator.join(names)]
    lines += [separator.join(f"{value + 0.0:.6f}" for value in row) for row in table]
    if ending == ".mot":
        lines[:0] = [
            Path(path).name, "version=1", f"nRows={len(table)}", f"nColumns={len(names)}",
            "inDegrees=yes", "endheader",
        ]  # fmt: skip
    write_file(path, ("\n".join(lines) + "\n").encode("utf-8"))
