"""Whether a C3D file's header and parameters can be true, checked before ezc3d sees them.

ezc3d trusts counts and lengths and can crash the interpreter where they lie; nothing is
allocated here. The layout is that of the C3D user guide (c3d.org), chapters 3 to 5.
"""

from __future__ import annotations

import math
import struct
from pathlib import Path

from physretarget.errors import InputError, UnsafeInputError

_BLOCK = 512
_TYPES = (-1, 1, 2, 4)  # characters, bytes, 16-bit integers, floats
_MIPS = 86
# ezc3d takes the first value of these without looking whether there is one.
_NUMBERS = (
    ("POINT", "USED"), ("POINT", "RATE"), ("POINT", "SCALE"), ("POINT", "FRAMES"),
    ("POINT", "DATA_START"), ("ANALOG", "USED"), ("ANALOG", "RATE"), ("ANALOG", "GEN_SCALE"),
)  # fmt: skip
# ezc3d reads the length as a signed byte: 128 becomes four gigabytes.
_LONGEST_DESCRIPTION = 127

Parameter = tuple[int, tuple[int, ...], bytes]  # type, dimensions, raw values


def check(content: bytes, path: str | Path) -> int:
    """The number of frames that the header promises.

    Raises InputError where the file is no C3D, its parameters are damaged or data is missing;
    UnsafeInputError where it promises many times what it could hold.
    """
    if len(content) < 2 * _BLOCK or content[1] != 0x50:
        raise InputError("this is not a C3D file: its second byte must be 0x50", path=path)
    start = (content[0] - 1) * _BLOCK
    if start < _BLOCK or start + 4 > len(content):
        raise InputError("the header points outside the file for its parameters", path=path)
    order = ">" if content[start + 3] == _MIPS else "<"
    points, analog, first, last = struct.unpack(order + "4H", content[2:10])
    data = (struct.unpack(order + "H", content[16:18])[0] - 1) * _BLOCK
    frames = max(0, int(last) - int(first) + 1)
    # Numbers take two or four bytes; what ezc3d then finds tells the rest.
    _fits(content, data, frames, points, 4 * points + analog, path)
    parameters = _parameters(content, start + 4, order, path)
    used = _whole(parameters, "POINT", "USED", order)
    if used is None or used != points:
        raise InputError(f"the header counts {points} points, POINT:USED {used}", path=path)
    for name in ("LABELS", "RATE", "SCALE", "UNITS"):
        if points and ("POINT", name) not in parameters:
            raise InputError(f"the parameter POINT:{name} is missing", path=path)
    for group, name in _NUMBERS:
        kind, _, raw = parameters.get((group, name), (4, (), bytes(4)))
        if kind < 1 or len(raw) < kind:
            raise InputError(f"the parameter {group}:{name} holds no number", path=path)
    channels = _whole(parameters, "ANALOG", "USED", order) or 0
    per_frame = struct.unpack(order + "H", content[18:20])[0]
    if channels * per_frame != analog:
        raise InputError(
            f"the header counts {analog} analog values a frame, its parameters "
            f"{channels} channels of {per_frame}",
            path=path,
        )
    return frames


def _fits(
    content: bytes, data: int, frames: int, points: int, numbers: int, path: str | Path
) -> None:
    needed = data + frames * numbers * 2
    if data < _BLOCK or needed > len(content):
        kind = UnsafeInputError if needed > 16 * len(content) else InputError
        raise kind(
            f"the file is cut short: its header promises {frames} frames of {points} points "
            f"(at least {needed} bytes) and it has {len(content)} bytes",
            path=path,
        )


def _parameters(
    content: bytes, at: int, order: str, path: str | Path
) -> dict[tuple[str, str], Parameter]:
    """All parameters by group and name; every length inside the file and inside its entry."""
    groups: dict[int, str] = {}
    found: dict[tuple[int, str], Parameter] = {}
    while at + 2 <= len(content):
        length, group = struct.unpack("2b", content[at : at + 2])
        length = abs(length)
        if length == 0 or group == 0:
            break
        name_end = at + 2 + length
        if name_end + 3 > len(content):
            break
        name = content[at + 2 : name_end].decode("latin-1").upper()
        (jump,) = struct.unpack(order + "H", content[name_end : name_end + 2])
        following = name_end + jump if jump else len(content)
        if following > len(content):
            raise InputError(f"parameter {name!r} reaches beyond the file", path=path)
        body = content[name_end + 2 : following]
        if group < 0:
            if -group in groups:
                raise InputError(f"parameter group {name!r} takes another one's number", path=path)
            groups[-group] = name
            description = body[0] if body else 0
            used = 1 + description
        else:
            parameter, used, description = _parameter(body, name, path)
            found[group, name] = parameter
        if description > _LONGEST_DESCRIPTION:
            raise UnsafeInputError(
                f"the description of {name!r} claims {description} characters, at most "
                f"{_LONGEST_DESCRIPTION} are read", path=path,
            )  # fmt: skip
        # The last entry may end with no pointer; every other one ends where the next begins.
        if used > len(body) or (jump and used < len(body)):
            raise InputError(f"parameter {name!r} does not fill its entry", path=path)
        if not jump:
            break
        at = following
    if {group for group, _ in found} - set(groups):
        raise InputError("a parameter belongs to no group", path=path)
    if len(set(groups.values())) < len(groups):
        raise InputError("two parameter groups have one name", path=path)
    return {(groups[group], name): parameter for (group, name), parameter in found.items()}


def _parameter(body: bytes, name: str, path: str | Path) -> tuple[Parameter, int, int]:
    """A parameter, the bytes that it and its description take, and those of the latter."""
    wrong = InputError(f"parameter {name!r} is damaged", path=path)
    if len(body) < 2:
        raise wrong
    kind, count = struct.unpack("bB", body[:2])
    if kind not in _TYPES or count > 7 or len(body) < 2 + count:
        raise wrong
    sizes = tuple(body[2 : 2 + count])
    end = 2 + count + math.prod(sizes) * abs(kind)
    if end >= len(body):
        raise wrong
    return (kind, sizes, body[2 + count : end]), end + 1 + body[end], body[end]


def _whole(
    parameters: dict[tuple[str, str], Parameter], group: str, name: str, order: str
) -> int | None:
    """A parameter's first value as a whole number, None where it is not there."""
    kind, _, raw = parameters.get((group, name), (0, (), b""))
    code = {1: "b", 2: "H", 4: "f"}.get(kind)
    if code is None or len(raw) < kind:
        return None
    (value,) = struct.unpack(order + code, raw[:kind])
    return int(value) if math.isfinite(value) else None
