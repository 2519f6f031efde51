"""OptiTrack Motive's CSV: bones of a skeleton, or markers, in the rows of its export.

Six header rows say of every column what it is (Bone, Marker), whose, and which axis. Bones come
with world rotations and are preferred; a take without bones gives its markers.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from physretarget.capture.marker_file import RawMarkers, finish, read_bytes
from physretarget.capture.names import recognise_centres
from physretarget.capture.reader import ReadOptions
from physretarget.capture.recording import Floats, JointRecording, MarkerRecording, sha256_of
from physretarget.capture.skeleton import Raw
from physretarget.capture.skeleton import finish as finish_joints
from physretarget.capture.text import decoded
from physretarget.errors import InputError
from physretarget.kinematics import quat_to_matrix

_UNITS = {"meters": "m", "centimeters": "cm", "millimeters": "mm", "inches": "inch"}
_AXES = {"X": 0, "Y": 1, "Z": 2, "W": 3}
_MOST_COLUMNS, _HEADER_ROWS = 20_000, 12


@dataclass(frozen=True)
class _Column:
    kind: str
    name: str
    value: str
    axis: str


def read(path: str | Path, options: ReadOptions) -> JointRecording | MarkerRecording:
    """Read a Motive export.

    Raises:
        InputError: With the line, for what cannot be understood.
    """
    content = read_bytes(path)
    rows = list(csv.reader(decoded(content).splitlines()[: _HEADER_ROWS + 1]))
    first = dict(zip(rows[0][::2], rows[0][1::2], strict=False))
    rate = first.get("Export Frame Rate") or first.get("Capture Frame Rate")
    try:
        fps = float(rate or "nan")
    except ValueError as error:
        raise InputError("the frame rate of the first line is no number.", path=path) from error
    columns, start = _columns(rows, path)
    unit = options.unit or _UNITS.get(first.get("Length Units", "").strip().lower())
    if first.get("Rotation Type", "Quaternion") != "Quaternion":
        columns = [c for c in columns if c.value != "Rotation"]
    table = _table(decoded(content).splitlines()[start:], len(columns), path, start)
    bones = _named(columns, "Bone")
    turned = any(c.kind == "Bone" and c.value == "Rotation" for c in columns)
    if bones and turned:
        return _skeleton(bones, columns, table, content, path, fps, unit, options)
    markers = bones or _named(columns, "Marker") or _named(columns, "Bone Marker")
    if not markers:
        kinds = ", ".join(sorted({c.kind for c in columns if c.kind})[:6]) or "nothing"
        raise InputError(f"there is no bone and no marker in the file; it has {kinds}.", path=path)
    kind = "Bone" if bones else ("Marker" if _named(columns, "Marker") else "Bone Marker")
    position = np.stack([_values(columns, table, kind, m, "Position", 3) for m in markers], axis=1)
    raw = RawMarkers(
        path=path, content=content, format="motive", fps=fps, labels=tuple(markers),
        position=position, unit=unit, up=None, usual_up="y",
    )  # fmt: skip
    return finish(raw, unit=options.unit, up=options.up, names=options.names)


def _columns(rows: list[list[str]], path: str | Path) -> tuple[list[_Column], int]:
    """What each column is, and the line after the header."""
    last = next((i for i, row in enumerate(rows) if row[:1] == ["Frame"]), None)
    if last is None:
        raise InputError("there is no line that begins with Frame.", path=path, line=len(rows))
    heads = {(row[1] if len(row) > 1 else ""): row for row in rows[1:last] if row}
    kinds = heads.get("Type", next((r for r in rows[1:last] if "Bone" in r or "Marker" in r), []))
    names = heads.get("Name", [])
    values = rows[last - 1]
    width = len(rows[last])
    if not kinds or not names or width > _MOST_COLUMNS:
        raise InputError("the header's rows Type and Name are missing.", path=path, line=last)

    def cell(row: list[str], i: int) -> str:
        return row[i].strip() if i < len(row) else ""

    return [
        _Column(cell(kinds, i), cell(names, i), cell(values, i), cell(rows[last], i))
        for i in range(width)
    ], last + 1


def _named(columns: list[_Column], kind: str) -> list[str]:
    return list(dict.fromkeys(c.name for c in columns if c.kind == kind and c.value == "Position"))


def _table(lines: list[str], width: int, path: str | Path, start: int) -> Floats:
    rows = []
    for number, line in enumerate(lines, start=start + 1):
        if not line.strip():
            continue
        cells = line.split(",")
        if len(cells) > width:
            raise InputError(
                f"the line has {len(cells)} cells, the header {width}.", path=path, line=number
            )
        try:
            row = [float(cell) if cell.strip() else np.nan for cell in cells]
        except ValueError as error:
            raise InputError("a cell is not a number.", path=path, line=number) from error
        rows.append(row + [np.nan] * (width - len(row)))
    if not rows:
        raise InputError("there is no frame after the header.", path=path, line=start)
    return np.array(rows)


def _values(
    columns: list[_Column], table: Floats, kind: str, name: str, value: str, width: int
) -> Floats:
    """(T, width) of one bone or marker."""
    found = np.full((len(table), width), np.nan)
    for i, column in enumerate(columns):
        axis = _AXES.get(column.axis, width)
        if (column.kind, column.name, column.value) == (kind, name, value) and axis < width:
            found[:, axis] = table[:, i]
    return found


def _skeleton(
    bones: list[str],
    columns: list[_Column],
    table: Floats,
    content: bytes,
    path: str | Path,
    fps: float,
    unit: str | None,
    options: ReadOptions,
) -> JointRecording:
    position = np.stack([_values(columns, table, "Bone", b, "Position", 3) for b in bones], axis=1)
    quats = np.stack([_values(columns, table, "Bone", b, "Rotation", 4) for b in bones], axis=1)
    good = np.asarray(np.isfinite(quats).all(axis=-1))
    quats = np.where(good[..., None], quats[..., [3, 0, 1, 2]], np.array([1.0, 0, 0, 0]))
    rotation = quat_to_matrix(quats / np.linalg.norm(quats, axis=-1, keepdims=True))
    rotation[~good] = np.nan
    order, parents = _hierarchy([name.rpartition(":")[2] for name in bones])
    raw = Raw(
        path=str(path), sha256=sha256_of(content), format="motive", fps=fps,
        names=tuple(bones[j] for j in order), parents=parents, position=position[:, order],
        rotation=rotation[:, order], unit=unit,
    )  # fmt: skip
    return finish_joints(raw, unit=options.unit, up=options.up, names=options.names)


_CHAINS = (
    ("hips", "left_thigh", "left_shank", "left_foot", "left_toe"),
    ("hips", "right_thigh", "right_shank", "right_foot", "right_toe"),
    ("spine", "left_clavicle", "left_upper_arm", "left_forearm", "left_hand", "left_finger"),
    ("spine", "right_clavicle", "right_upper_arm", "right_forearm", "right_hand", "right_finger"),
    ("spine", "neck", "head"),
)


def _hierarchy(names: list[str]) -> tuple[list[int], tuple[int, ...]]:
    """An order with parents first, and the parents: the file names no one's."""
    roles = recognise_centres(names)
    root = roles.get("hips", 0)
    used = set(roles.values())
    spine = [j for j, n in enumerate(names) if j not in used and _central(n)]
    chain = [root, *spine]
    parent = {root: -1} | {b: a for a, b in pairwise(chain)}
    for start, *parts in _CHAINS:
        above = root if start == "hips" else chain[-1]
        for part in parts:
            if part in roles and roles[part] not in parent:
                parent[roles[part]], above = above, roles[part]
    order = list(parent)
    rank = {old: new for new, old in enumerate(order)}
    return order, tuple(rank[parent[j]] if parent[j] >= 0 else -1 for j in order)


def _central(name: str) -> bool:
    return name.lower().strip("0123456789_ ") in ("ab", "chest", "spine", "abdomen", "torso")
