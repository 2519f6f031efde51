"""csv: LAFAN1-style (xyzw) and ProtoMotions (wxyz) rows of root xyz, quaternion, joints.

Neither states its frame rate or quaternion order: they are told, or the order is inferred
when only one makes sense.
"""

from __future__ import annotations

import numpy as np

from physretarget.clip.core import Floats
from physretarget.clip.quaternion import QuatOrder
from physretarget.clip.raw import Raw
from physretarget.errors import InputError

_TIME = ("time", "t", "time_s", "timestamp")


def read(content: bytes, *, path: str, sha256: str) -> Raw:
    """Read a table of numbers, with or without a header line of joint names."""
    try:
        lines = content.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise InputError("is not text (UTF-8).", path=path) from error
    first = next((i for i, line in enumerate(lines) if line.strip()), None)
    if first is None:
        raise InputError("the file is empty.", path=path)
    cells = _split(lines[first])
    header = None if all(_number(c) is not None for c in cells) else cells
    start = first + (header is not None)
    values = _numbers(lines, start, path)
    time = None
    if header is not None and len(header) != values.shape[1]:
        raise InputError(
            f"the header has {len(header)} names, the rows have {values.shape[1]} numbers.",
            path=path,
            line=first + 1,
        )
    if header is not None and header[0].lower() in _TIME:
        time, values, header = values[:, 0].copy(), values[:, 1:], header[1:]
    order = _header_order(header)
    joints = None if header is None else tuple(header[7:] if order else header)
    return Raw(
        format="csv", path=path, sha256=sha256, values=values, joints=joints,
        order=order, time=time,
    )  # fmt: skip


def _split(line: str) -> list[str]:
    separator = "," if "," in line else (";" if ";" in line else None)
    return [cell.strip().strip('"') for cell in line.split(separator)]


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _numbers(lines: list[str], start: int, path: str) -> Floats:
    rows: list[list[float]] = []
    for number, line in enumerate(lines[start:], start=start + 1):
        if not line.strip():
            continue
        cells = _split(line)
        row = [_number(cell) for cell in cells]
        if None in row:
            bad = cells[row.index(None)]
            raise InputError(f"'{bad:.30}' is not a number.", path=path, line=number)
        if rows and len(row) != len(rows[0]):
            raise InputError(
                f"this row has {len(row)} numbers, the first has {len(rows[0])}.",
                path=path,
                line=number,
            )
        rows.append([v for v in row if v is not None])
    if not rows:
        raise InputError("the file has a header but no rows.", path=path)
    return np.array(rows, dtype=np.float64)


def _header_order(header: list[str] | None) -> QuatOrder | None:
    """The quaternion order that a header states by naming columns 3..6, if it does."""
    if header is None or len(header) < 7:
        return None
    last = "".join(name.lower().replace("]", "").rstrip("_")[-1:] for name in header[3:7])
    orders: dict[str, QuatOrder] = {"wxyz": "wxyz", "xyzw": "xyzw"}
    return orders.get(last)
