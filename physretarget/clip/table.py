"""csv: LAFAN1-style (xyzw) and ProtoMotions (wxyz) rows of root xyz, quaternion, joints.

Neither states its frame rate or quaternion order: they are told, or the order is inferred
when only one makes sense. BONES-SEED's and SONIC's have root angles, LeRobot's joints alone; their
headers tell.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from typing import IO

import numpy as np
from scipy.spatial.transform import Rotation

from physretarget.archives.arrays import PART
from physretarget.clip.core import Floats
from physretarget.clip.quaternion import QuatOrder
from physretarget.clip.raw import Raw
from physretarget.clip.scratch import Rows
from physretarget.errors import InputError

_TIME = ("time", "t", "time_s", "timestamp")
_COUNT = ("frame", "frame#", "frames", "index", "idx")
# 40 000 numbers of 25 digits: a line beyond is no frame, and reading it whole might not end.
_LONGEST_LINE = 1 << 20
# Comments stand at a file's beginning.
_COMMENTS = 1000

Lines = Iterator[tuple[int, str]]


def read(file: IO[bytes], *, path: str, sha256: str) -> Raw:
    """Read a table of numbers, with or without a header line of joint names."""
    lines = _lines(file, path)
    first = next(lines, None)
    if first is None:
        raise InputError("the file is empty.", path=path)
    # numpy.savetxt writes its header as a comment.
    first = (first[0], first[1].lstrip().lstrip("#"))
    cells = _split(first[1])
    header = None if all(_number(c) is not None for c in cells) else cells
    parts = _parts(lines if header is not None else chain([first], lines), path)
    ahead = next(parts, None)
    line = first[0] + (header is not None)
    if ahead is None:
        raise InputError("the file has a header but no rows.", path=path)
    if header is not None and len(header) != ahead.shape[1]:
        raise InputError(
            f"the header has {len(header)} names, the rows have {ahead.shape[1]} numbers.",
            path=path,
            line=first[0],
        )
    parts = chain([ahead], parts)
    times: list[Floats] | None = None
    width = ahead.shape[1]
    if header is not None and header[0].lower() in _COUNT:
        parts, header, width = (part[:, 1:] for part in parts), header[1:], width - 1
    if header and header[0].lower() in _TIME:
        times, header = [], header[1:]
        parts = _without_time(parts, times)
    width -= times is not None
    dialect = _dialect(header)
    if header is not None and dialect.rooted:
        parts, width = _with_quaternions(parts), width + 1
    rows = Rows(parts, width)
    order = "wxyz" if dialect.rooted else _header_order(header)
    if header is not None:
        header = [dialect.bare(name) for name in header]
        header = ["x", "y", "z", "w", *header[3:]] if dialect.rooted else header
    joints = None if header is None else tuple(header[7:] if order else header)
    return Raw(
        format=dialect.format, path=path, sha256=sha256, rows=rows, joints=joints, order=order,
        rooted=dialect.rooted or dialect.suffix == "",
        scale=dialect.scale, degrees=dialect.degrees,
        time=None if times is None else np.concatenate(times), meta={"first_line": line},
    )  # fmt: skip


@dataclass(frozen=True)
class _Dialect:
    """What the names of a header say about its numbers.

    ``suffix`` ends every joint's name; ``rooted``: the root is a translation and XYZ angles;
    ``scale`` m to the unit of lengths; ``degrees``: joints (and root angles) are in degrees.
    """

    format: str = "csv"
    suffix: str = ""
    rooted: bool = False
    scale: float | None = None
    degrees: bool = False

    def bare(self, name: str) -> str:
        """A joint's name without what the dialect adds to it."""
        name = name.removesuffix(self.suffix)
        if self.suffix == ".pos":
            for prefix in ("observation.state.", "observation.", "action."):
                name = name.removeprefix(prefix)
        return name


_ROOT_ANGLES = [f"root_{kind}{axis}" for kind in ("translate", "rotate") for axis in "XYZ"]


def _dialect(header: list[str] | None) -> _Dialect:
    """Of LeRobot (columns ``*.pos``, degrees) or of BONES-SEED and SONIC (cm, degrees, ``*_dof``).

    Both count joints in degrees; LeRobot's other convention, percent of a calibrated range, is no
    angle and cannot be told from its names.
    """
    if not header:
        return _Dialect()
    if header[:6] == _ROOT_ANGLES and all(name.endswith("_dof") for name in header[6:]):
        return _Dialect("BONES-SEED csv", "_dof", True, 0.01, True)
    if all(name.endswith(".pos") for name in header):
        return _Dialect("LeRobot csv", ".pos", degrees=True)
    return _Dialect()


def _with_quaternions(parts: Iterator[Floats]) -> Iterator[Floats]:
    """Root angles in degrees, about the fixed x, y and z in this order, as quaternions wxyz."""
    for part in parts:
        turn = Rotation.from_euler("xyz", part[:, 3:6], degrees=True).as_quat(scalar_first=True)
        yield np.concatenate([part[:, :3], turn, part[:, 6:]], axis=1)


def _without_time(parts: Iterator[Floats], times: list[Floats]) -> Iterator[Floats]:
    """Everything but the first column, which is gathered in ``times``."""
    for part in parts:
        times.append(part[:, 0].copy())
        yield part[:, 1:]


def _lines(file: IO[bytes], path: str) -> Lines:
    """Number (from 1) and text of every line that is not empty, nor a comment.

    A comment right above the numbers is kept: it may be their header.
    """
    text = io.TextIOWrapper(file, encoding="utf-8-sig")
    number, comment = 0, None
    try:
        while line := text.readline(_LONGEST_LINE):
            number += 1
            if len(line) == _LONGEST_LINE and not line.endswith("\n"):
                raise InputError(
                    f"the line is longer than {_LONGEST_LINE} characters.", path=path, line=number
                )
            if line.lstrip().startswith("#"):
                comment = (number, line) if number <= _COMMENTS else None
            elif line.strip():
                if comment is not None and _is_header(comment[1], line):
                    yield comment
                comment = None
                yield number, line
    except UnicodeDecodeError as error:
        raise InputError("is not text (UTF-8).", path=path) from error


def _parts(lines: Lines, path: str) -> Iterator[Floats]:
    """The numbers of the rows, some rows at a time."""
    block, filled = np.zeros((0, 0)), 0
    for number, line in lines:
        row = _row(line, number, path)
        if block.shape[1] == 0:
            block = np.empty((PART, len(row)))
        if len(row) != block.shape[1]:
            raise InputError(
                f"this row has {len(row)} numbers, the first has {block.shape[1]}.",
                path=path,
                line=number,
            )
        block[filled] = row
        filled += 1
        if filled == len(block):
            yield block.copy()
            filled = 0
    if filled:
        yield block[:filled].copy()


def _row(line: str, number: int, path: str) -> list[float]:
    cells = _split(line)
    row = [_number(cell) for cell in cells]
    if None in row:
        bad = cells[row.index(None)]
        raise InputError(f"'{bad:.30}' is not a number.", path=path, line=number)
    return [v for v in row if v is not None]


def _is_header(comment: str, line: str) -> bool:
    """Whether a comment names the numbers of the next line."""
    names = _split(comment.lstrip().lstrip("#"))
    return len(names) == len(_split(line)) and all(_number(name) is None for name in names)


def _split(line: str) -> list[str]:
    """Cells between semicolons (numbers may then have decimal commas), commas or blanks."""
    if ";" in line:
        cells = line.replace(",", ".").split(";")
    else:
        cells = line.split("," if "," in line else None)
    if len(cells) > 1 and not cells[-1].strip():
        cells.pop()  # a separator at the end of every line
    return [cell.strip().strip('"') for cell in cells]


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _header_order(header: list[str] | None) -> QuatOrder | None:
    """The quaternion order that a header states by naming columns 3..6, if it does."""
    if header is None or len(header) < 7:
        return None
    last = "".join(name.lower().replace("]", "").rstrip("_")[-1:] for name in header[3:7])
    orders: dict[str, QuatOrder] = {"wxyz": "wxyz", "xyzw": "xyzw"}
    return orders.get(last)
