"""iFacialMocap's packets, one a line, as recorders save what the app sends.

A packet is ``mouthSmile_R-0|eyeBlink_L-7|…|=head#x,y,z,px,py,pz|rightEye#x,y,z|leftEye#x,y,z|``;
newer apps write ``&`` where ``-`` stood, and negative weights. Weights are percent and become
fractions, angles are degrees. Ahead of a packet may stand its time and a blank, a comma or a tab;
or a line is JSON with the time under ``t`` and the packet under ``d``. Without times there are
60 packets a second, as the app sends them. ``trackingStatus`` 0 is a lost face, hence a gap.
"""

from __future__ import annotations

import json
import math
import re
from typing import Any

import numpy as np

from physretarget.errors import InputError
from physretarget.face.formats.arkit import full_name
from physretarget.face.formats.dense import LONGEST, dense_take
from physretarget.face.formats.source import Source
from physretarget.face.shot import Take

RATE = 60.0
"""Packets a second that the app sends."""
_LINE = re.compile(r"\s*(?:(-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?)[\s,;]+)?(\S.*?)\s*")
_WEIGHT = re.compile(r"([A-Za-z_]\w*)[-&](-?\d+(?:\.\d+)?)")
_POSE = re.compile(r"=?(head|leftEye|rightEye)#(.*)")
_FIRST = re.compile(rb"[^|\r\n]{0,80}?[A-Za-z_]\w{0,40}[-&]-?\d{1,4}(?:\.\d+)?\|")


def is_ifacialmocap(source: Source) -> bool:
    """Whether the first line holds a packet."""
    first = source.content[:400].lstrip(b"\xef\xbb\xbf \r\n")
    return _FIRST.match(first) is not None


def read_ifacialmocap(source: Source, *, fps: float | None = None) -> Take:
    """Read a recording.

    Args:
        source: the file.
        fps: frame rate of the take; the recording's own by default.

    Returns:
        The take.

    Raises:
        InputError: with the line, when a packet is broken.
    """
    times: list[float | None] = []
    rows: list[dict[str, float]] = []
    for number, line in enumerate(source.text().splitlines(), 1):
        if not line.strip():
            continue
        time, packet = _timed(source, number, line)
        times.append(time)
        rows.append(_packet(source, number, packet))
        if len(rows) > LONGEST:
            raise InputError(f"more than {LONGEST} packets.", path=source.path, line=number)
    names = list(dict.fromkeys(name for row in rows for name in row))
    if len(names) > 1000:
        raise InputError(f"{len(names)} channels; a face has some sixty.", path=source.path)
    column = {name: k for k, name in enumerate(names)}
    table = np.full((len(rows), len(names)), math.nan)
    for index, row in enumerate(rows):
        for name, value in row.items():
            table[index, column[name]] = value
    known = [t for t in times if t is not None]
    if len(known) == len(rows):
        return dense_take(source, known, names, table, fps=fps)
    if known:
        raise InputError("some packets have a time and some have none.", path=source.path)
    note = f"The packets have no times; {RATE:g} a second were taken for granted."
    even = np.arange(len(rows)) / RATE
    return dense_take(source, even, names, table, unit="s", fps=fps, notes=(note,))


def _timed(source: Source, number: int, line: str) -> tuple[float | None, str]:
    if line.lstrip().startswith("{"):
        try:
            entry: Any = json.loads(line)
            time, packet = entry["t"], entry["d"]
            if isinstance(packet, str) and not isinstance(time, bool):
                return float(time), packet
        except (ValueError, TypeError, KeyError, RecursionError, OverflowError):
            pass
        raise InputError("no packet with t and d.", path=source.path, line=number)
    found = _LINE.fullmatch(line)
    time, packet = found.groups() if found else (None, line)
    return None if time is None else float(time), packet


def _packet(source: Source, number: int, packet: str) -> dict[str, float]:
    """Values by channel; none where the face was lost."""
    row: dict[str, float] = {}
    tracked = True
    for part in packet.replace("=", "|").split("|"):
        if not part.strip():
            continue
        weight, pose = _WEIGHT.fullmatch(part.strip()), _POSE.fullmatch(part.strip())
        if weight and weight[1] == "trackingStatus":
            tracked = float(weight[2]) != 0
        elif weight:
            row[full_name(weight[1])] = float(weight[2]) / 100.0
        elif pose:
            row |= _pose(source, number, pose[1], pose[2])
        else:
            raise InputError(
                f"{part[:40]!r} is no weight and no pose.", path=source.path, line=number
            )
    if not all(math.isfinite(v) for v in row.values()):
        raise InputError("a value is not finite.", path=source.path, line=number)
    return row if tracked else {}


def _pose(source: Source, number: int, part: str, text: str) -> dict[str, float]:
    kinds = ("rotation", "position") if part == "head" else ("rotation",)
    names = [f"{part}.{kind}.{axis}" for kind in kinds for axis in "xyz"]
    try:
        values = [float(v) for v in text.split(",")]
    except ValueError as error:
        raise InputError(f"not a number: {error}.", path=source.path, line=number) from error
    if len(values) not in (3, len(names)):
        raise InputError(f"{part} has {len(values)} numbers.", path=source.path, line=number)
    return dict(zip(names, values, strict=False))
