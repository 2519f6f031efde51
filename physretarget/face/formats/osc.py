"""Recordings of OSC messages, VMC's among them, as text: one message a line.

Lines are those of liblo's ``oscdump``, ``TIME ADDRESS TYPES ARGUMENTS`` with OSC's own time tags
in hexadecimal, or JSON objects with a time (``time``, ``timestamp`` or ``t``), ``address`` and
``args``. VMC sends the weights of a frame one by one, ``/VMC/Ext/Blend/Val NAME WEIGHT``, and then
``/VMC/Ext/Blend/Apply``; what has not been sent keeps its value, as receivers do it. Any
other address with one number, such as VRChat's ``/avatar/parameters/JawOpen``, is a channel by its
last word; there a frame ends where a channel comes again, or 4 ms after it began.

Bones, cameras and devices are no part of a face's weights and are not read.
"""

from __future__ import annotations

import json
import math
import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from physretarget.errors import InputError
from physretarget.face.formats.arkit import full_name
from physretarget.face.formats.dense import LONGEST, dense_take
from physretarget.face.formats.source import Source
from physretarget.face.shot import Take

_TAG = re.compile(r"([0-9a-fA-F]{8})\.([0-9a-fA-F]{8})")
_LINE = re.compile(r"(\S+)\s+(/\S+)\s*(\S*)\s*(.*)")
_FIRST = re.compile(rb"(?:[0-9a-fA-F]{8}\.[0-9a-fA-F]{8}|\d+(?:\.\d+)?)\s+/[\w/]+")
_VALUE, _APPLY = "/VMC/Ext/Blend/Val", "/VMC/Ext/Blend/Apply"
_TIMES = ("time", "timestamp", "t")
_TOGETHER = 0.004  # s that the messages of one frame come within, where no message ends it


@dataclass(frozen=True)
class _Message:
    time: float
    tagged: bool  # whether the time is OSC's, in seconds
    address: str
    arguments: tuple[Any, ...]


def is_osc(source: Source) -> bool:
    """Whether the first line is an OSC message."""
    first = source.content[:4096].lstrip(b"\xef\xbb\xbf \r\n").split(b"\n", 1)[0]
    if not first.startswith(b"{"):
        return _FIRST.match(first) is not None
    try:
        entry = json.loads(first)
    except (ValueError, RecursionError):
        return False
    return isinstance(entry, dict) and "address" in entry and "args" in entry


def read_osc(source: Source, *, fps: float | None = None) -> Take:
    """Read a recording.

    Args:
        source: the file.
        fps: frame rate of the take; the recording's own by default.

    Returns:
        The take.

    Raises:
        InputError: with the line, when a message is broken; or when none holds a weight.
    """
    frames = list(_frames(source))
    names = list(dict.fromkeys(name for _, row in frames for name in row))
    if not names:
        raise InputError("holds no message with a weight.", path=source.path)
    if len(names) > 10_000 or len(names) * len(frames) > 50 * LONGEST:
        raise InputError(f"{len(names)} channels; a face has some hundred.", path=source.path)
    column = {name: k for k, name in enumerate(names)}
    table = np.full((len(frames), len(names)), math.nan)
    for index, (_, row) in enumerate(frames):
        if index:
            table[index] = table[index - 1]  # what has not been sent keeps its value
        for name, value in row.items():
            table[index, column[name]] = value
    first = frames[0][0]
    return dense_take(source, [time - first for time, _ in frames], names, table, fps=fps)


def _frames(source: Source) -> Iterator[tuple[float, dict[str, float]]]:
    """Time and the channels that were sent, frame by frame."""
    row: dict[str, float] = {}
    began = 0.0
    whole = _APPLY.encode() in source.content
    for message in _messages(source):
        channel = _channel(message)
        if message.address == _APPLY:
            if row:
                yield message.time, row
            row = {}
        elif channel is not None:
            name, value = channel
            late = message.tagged and message.time - began > _TOGETHER
            if not whole and row and (name in row or late):
                yield began, row
                row = {}
            if not row:
                began = message.time
            row[name] = value
    if row and not whole:
        yield began, row


def _channel(message: _Message) -> tuple[str, float] | None:
    """Name and value of a weight, if the message holds one."""
    given = message.arguments
    numbers = [a for a in given if isinstance(a, int | float) and not isinstance(a, bool)]
    if message.address == _VALUE:
        if len(given) == 2 and isinstance(given[0], str) and len(numbers) == 1:
            return full_name(given[0]), float(numbers[0])
        return None
    if message.address.startswith("/VMC/") or len(given) != 1 or len(numbers) != 1:
        return None
    return full_name(message.address.rpartition("/")[2]), float(numbers[0])


def _messages(source: Source) -> Iterator[_Message]:
    for number, line in enumerate(source.text().splitlines(), 1):
        text = line.strip()
        if not text:
            continue
        try:
            message = _from_json(text) if text.startswith("{") else _from_dump(text)
        except (ValueError, TypeError, KeyError, OverflowError, RecursionError):
            message = None
        if message is None or not math.isfinite(message.time):
            raise InputError(
                "no OSC message TIME ADDRESS TYPES ARGUMENTS, nor JSON with time, address, args.",
                path=source.path,
                line=number,
            )
        if any(isinstance(a, float) and not math.isfinite(a) for a in message.arguments):
            raise InputError("a value is not finite.", path=source.path, line=number)
        yield message


def _from_json(text: str) -> _Message | None:
    entry = json.loads(text)
    time = next((entry[key] for key in _TIMES if key in entry), None)
    args = entry["args"]
    if time is None or isinstance(time, bool) or not isinstance(entry["address"], str):
        return None
    arguments = tuple(args if isinstance(args, list) else [args])
    return _Message(float(time), False, entry["address"], arguments)


def _from_dump(text: str) -> _Message | None:
    found = _LINE.fullmatch(text)
    if found is None:
        return None
    when, address, types, rest = found.groups()
    tag = _TAG.fullmatch(when)
    time = int(tag[1], 16) + int(tag[2], 16) / 2**32 if tag else float(when)
    words = shlex.split(rest, posix=True)
    if len(words) != len(types):
        return None
    made: list[Any] = []
    for kind, word in zip(types, words, strict=True):
        made.append(float(word) if kind in "fd" else int(word) if kind in "ih" else word)
    return _Message(time, tag is not None, address, tuple(made))
