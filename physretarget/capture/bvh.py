"""BVH (Biovision hierarchy) files.

Any channel order and count per joint, position channels on every joint, End Sites anywhere,
names with blanks, colons and dots, CRLF, tabs and blank lines. Angles are degrees, applied in
the order of the channels: ``R = R_first @ R_second @ R_third``.

Position channels replace the joint's OFFSET, as the writers of 6-channel files mean it, unless
a file's numbers say that they are meant as an addition.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from physretarget.capture.recording import Floats, JointRecording, sha256_of
from physretarget.capture.skeleton import Raw, chain_positions, finish, nice_rate
from physretarget.errors import InputError

_CHANNEL = re.compile(r"([xyz])(position|rotation)$", re.IGNORECASE)
_MAX_JOINTS = 2000
_MAX_VALUE = 1e7  # larger numbers are no length in any unit and no angle


@dataclass
class _Joint:
    name: str
    parent: int
    offset: tuple[float, float, float] | None = None
    channels: list[tuple[str, int]] | None = None  # (kind, axis)


@dataclass
class _Hierarchy:
    joints: list[_Joint] = field(default_factory=list)
    end_sites: dict[str, tuple[int, Floats]] = field(default_factory=dict)

    @property
    def width(self) -> int:
        return sum(len(joint.channels or ()) for joint in self.joints)


def read_bvh(path: str | Path, *, unit: str | None = None, up: str | None = None) -> JointRecording:
    """Read a BVH file; unit and up axis are guessed, and the guess noted, unless told.

    Raises InputError with path and line for anything that is not a sound BVH file. A value
    written as ``nan`` stays NaN.
    """
    content = Path(path).read_bytes()
    digest = sha256_of(content)
    hierarchy, frame_time, values, remarks = _parse(content, path)
    del content
    position, rotation, notes = _assemble(hierarchy, values)
    raw = Raw(
        path=str(path),
        sha256=digest,
        format="bvh",
        fps=nice_rate(frame_time),
        names=tuple(joint.name for joint in hierarchy.joints),
        parents=tuple(joint.parent for joint in hierarchy.joints),
        position=position,
        rotation=rotation,
        end_sites=hierarchy.end_sites,
        notes=(*remarks, *notes),
    )
    return finish(raw, unit=unit, up=up)


def _parse(content: bytes, path: str | Path) -> tuple[_Hierarchy, float, Floats, tuple[str, ...]]:
    """Skeleton, frame time, the channels' values (T, channels), and what was odd."""
    wide = content.startswith((b"\xff\xfe", b"\xfe\xff"))  # as Windows' editors save "Unicode"
    text = content.decode("utf-16" if wide else "utf-8-sig", errors="replace")
    text = text.rstrip("\x00\x1a")  # padding, and DOS' end of file
    if not text.strip():
        raise InputError("The file is empty.", path=path)
    if "\r" in text:
        text = text.replace("\r\n", "\n").replace("\r", "\n")
    lines = text.split("\n")
    start = _motion_line(lines, path)
    hierarchy = _parse_hierarchy(lines[:start], path)
    return hierarchy, *_parse_motion(lines, start, hierarchy.width, path)


def _motion_line(lines: list[str], path: str | Path) -> int:
    if next(line for line in lines if line.strip()).strip().upper() != "HIERARCHY":
        raise InputError("A BVH file starts with HIERARCHY; this one does not.", path=path, line=1)
    for number, line in enumerate(lines):
        if line.strip().upper() == "MOTION":
            return number
    raise InputError(
        "There is no MOTION section: the file is truncated or holds a skeleton alone.",
        path=path,
        line=len(lines),
    )


def _statements(lines: list[str]) -> Iterator[tuple[int, str]]:
    """Line numbers (from 1) and statements; braces are statements of their own."""
    for number, line in enumerate(lines, start=1):
        for piece in re.split(r"([{}])", line):
            if piece.strip():
                yield number, piece.strip()


def _numbers(words: list[str], count: int, path: str | Path, line: int) -> list[float]:
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(abs(number) < _MAX_VALUE for number in numbers):
        given = " ".join(words)[:60]
        raise InputError(
            f"OFFSET needs {count} finite numbers, not {given!r}.", path=path, line=line
        )
    return numbers


def _parse_hierarchy(lines: list[str], path: str | Path) -> _Hierarchy:
    """Parse everything between HIERARCHY and MOTION."""
    tree = _Hierarchy()
    stack: list[int | str] = []  # indices of open joints; a name for an open End Site
    pending: int | str | None = None
    number = 1
    for number, statement in _statements(lines):
        word, rest = [*statement.split(None, 1), ""][:2]
        key = word.upper()
        if pending is not None and key != "{":
            raise InputError("Expected '{' after a joint's name.", path=path, line=number)
        if key == "HIERARCHY" and not tree.joints and not stack:
            continue
        if key in ("ROOT", "JOINT"):
            pending = _open_joint(tree, stack, key, rest.strip(), path, number)
        elif key in ("END", "ENDSITE"):
            pending = _open_end(tree, stack, path, number)
        elif key == "{":
            if pending is None:
                raise InputError("Unexpected '{'.", path=path, line=number)
            stack.append(pending)
            pending = None
        elif key == "}":
            _close(tree, stack, path, number)
        elif key == "OFFSET":
            _set_offset(tree, stack, rest.split(), path, number)
        elif key == "CHANNELS":
            _set_channels(tree, stack, rest.split(), path, number)
        else:
            raise InputError(
                f"Unknown word {word[:40]!r} in the hierarchy.", path=path, line=number
            )
    if stack or pending is not None:
        raise InputError("A '}' is missing: the hierarchy is truncated.", path=path, line=number)
    if not tree.joints:
        raise InputError("The hierarchy holds no joint.", path=path, line=number)
    return tree


def _open_joint(
    tree: _Hierarchy, stack: list[int | str], key: str, name: str, path: str | Path, line: int
) -> int:
    parent = stack[-1] if stack else -1
    if (key == "ROOT") != (parent == -1) or isinstance(parent, str):
        raise InputError(f"{key} {name!r} stands in the wrong place.", path=path, line=line)
    if not name:
        raise InputError(f"{key} has no name.", path=path, line=line)
    if len(tree.joints) >= _MAX_JOINTS:
        raise InputError(f"More than {_MAX_JOINTS} joints.", path=path, line=line)
    taken = {joint.name for joint in tree.joints}
    again = 2
    while name in taken:  # some writers repeat names, for fingers above all
        name, again = f"{name.rsplit('#', 1)[0]}#{again}", again + 1
    tree.joints.append(_Joint(name, parent))
    return len(tree.joints) - 1


def _open_end(tree: _Hierarchy, stack: list[int | str], path: str | Path, line: int) -> str:
    parent = stack[-1] if stack else None
    if not isinstance(parent, int):
        raise InputError("End Site stands outside a joint.", path=path, line=line)
    if len(tree.end_sites) >= _MAX_JOINTS:
        raise InputError(f"More than {_MAX_JOINTS} end sites.", path=path, line=line)
    base = name = f"{tree.joints[parent].name}_end"
    again = 2
    while name in tree.end_sites:
        name, again = f"{base}{again}", again + 1
    tree.end_sites[name] = (parent, np.full(3, np.nan))
    return name


def _close(tree: _Hierarchy, stack: list[int | str], path: str | Path, line: int) -> None:
    if not stack:
        raise InputError("A '}' too many.", path=path, line=line)
    closed = stack.pop()
    if isinstance(closed, str):
        if np.isnan(tree.end_sites[closed][1]).any():
            raise InputError("An End Site has no OFFSET.", path=path, line=line)
        return
    joint = tree.joints[closed]
    if joint.offset is None:
        raise InputError(f"The joint {joint.name!r} has no OFFSET.", path=path, line=line)


def _set_offset(
    tree: _Hierarchy, stack: list[int | str], words: list[str], path: str | Path, line: int
) -> None:
    if not stack:
        raise InputError("OFFSET stands outside a joint.", path=path, line=line)
    x, y, z = _numbers(words, 3, path, line)
    owner = stack[-1]
    if isinstance(owner, str):
        tree.end_sites[owner] = (tree.end_sites[owner][0], np.array([x, y, z]))
    else:
        tree.joints[owner].offset = (x, y, z)


def _set_channels(
    tree: _Hierarchy, stack: list[int | str], words: list[str], path: str | Path, line: int
) -> None:
    owner = stack[-1] if stack else None
    if not isinstance(owner, int):
        raise InputError("CHANNELS stands outside a joint.", path=path, line=line)
    if tree.joints[owner].channels is not None:
        raise InputError("A joint has CHANNELS twice.", path=path, line=line)
    matches = [_CHANNEL.match(word) for word in words[1:]]
    if not words or not words[0].isdecimal() or int(words[0]) != len(matches):
        raise InputError(
            "CHANNELS does not name as many channels as it says.", path=path, line=line
        )
    channels = []
    for match, word in zip(matches, words[1:], strict=True):
        if match is None:
            raise InputError(f"Unknown channel {word[:40]!r}.", path=path, line=line)
        channels.append((match[2].lower(), "xyz".index(match[1].lower())))
    moves = [channel for channel in channels if channel[0] == "position"]
    if len(set(moves)) != len(moves) or len(channels) > 9:
        raise InputError("A joint has the same channel several times.", path=path, line=line)
    tree.joints[owner].channels = channels


def _header(
    lines: list[str], start: int, pattern: str, what: str, path: str | Path
) -> tuple[int, str]:
    """The next non-blank line, which must be the header line ``what``."""
    for number in range(start, len(lines)):
        if lines[number].strip():
            match = re.match(pattern, lines[number].strip(), re.IGNORECASE)
            if match:
                return number, match[1]
            break
    else:
        number = len(lines) - 1
    raise InputError(f"Expected '{what}' here.", path=path, line=number + 1)


def _parse_motion(
    lines: list[str], start: int, width: int, path: str | Path
) -> tuple[float, Floats, tuple[str, ...]]:
    """Frame time in seconds, the values (T, width) after the MOTION line, and what was odd."""
    at, count = _header(lines, start + 1, r"frames\s*:?\s*(\d{1,12})(?:\.0*)?$", "Frames: N", path)
    at, seconds = _header(lines, at + 1, r"frame\s*time\s*:?\s*(\S+)$", "Frame Time: s", path)
    try:
        frame_time = float(seconds)
    except ValueError:
        frame_time = np.nan
    if not 1e-4 <= frame_time <= 2.0:
        raise InputError(
            f"The frame time is {seconds[:40]!r}; it must lie between 0.0001 and 2 s.",
            path=path,
            line=at + 1,
        )
    if width == 0:
        raise InputError("No joint has a channel, so nothing moves.", path=path, line=at + 1)
    rows = _rows(_frame_lines(lines, at + 1, width, int(count)), width, path)
    if len(rows) == 0:
        raise InputError("There are no frames.", path=path, line=len(lines))
    if len(rows) < int(count):
        raise InputError(
            f"Frames: {count} is declared, but the file holds {len(rows)}.",
            path=path,
            line=len(lines),
        )
    if len(rows) > int(count):
        return frame_time, rows, (f"{count} frames are declared; all {len(rows)} were read",)
    return frame_time, rows, ()


def _frame_lines(
    lines: list[str], start: int, width: int, count: int
) -> Iterator[tuple[int, list[str]]]:
    """Line numbers (from 1) and words of each frame; some writers break a frame's line.

    Broken lines are put together only if the file holds exactly the values that it declares.
    """
    first = next((line for line in lines[start:] if line.strip()), "")
    if len(first.split()) < width and (
        sum(len(lines[i].split()) for i in range(start, len(lines))) == width * count
    ):
        pending: list[str] = []
        began = start
        for number in range(start, len(lines)):
            began = began if pending else number
            pending += lines[number].split()
            while len(pending) >= width:
                yield began + 1, pending[:width]
                pending, began = pending[width:], number
        return
    for number in range(start, len(lines)):
        words = lines[number].split()
        if words:
            yield number + 1, words


_BLOCK = 2000  # rows turned into an array at a time: Python floats take four times the memory


def _rows(frames: Iterable[tuple[int, list[str]]], width: int, path: str | Path) -> Floats:
    """All frames; the error names the line whose count or number is wrong."""
    blocks = [np.empty((0, width))]
    values: list[float] = []
    for number, words in frames:
        if len(words) != width:
            raise InputError(
                f"A frame needs {width} values, this line has {len(words)}.",
                path=path,
                line=number,
            )
        try:
            row = [float(word) for word in words]
        except ValueError:
            raise InputError("A value is not a number.", path=path, line=number) from None
        if not -_MAX_VALUE <= min(row) <= max(row) <= _MAX_VALUE and any(
            abs(value) > _MAX_VALUE for value in row
        ):
            raise InputError(
                f"A value is infinite or beyond {_MAX_VALUE:g}.", path=path, line=number
            )
        values += row
        if len(values) >= _BLOCK * width:
            blocks.append(np.array(values).reshape(-1, width))
            values = []
    return np.concatenate([*blocks, np.array(values).reshape(-1, width)])


def _elementary(axis: int, degrees: Floats) -> Floats:
    """Rotations (T, 3, 3) about one coordinate axis."""
    angle = np.radians(degrees)
    cos, sin = np.cos(angle), np.sin(angle)
    matrix = np.zeros((len(angle), 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix[:, axis, axis] = 1.0
    matrix[:, i, i] = matrix[:, j, j] = cos
    matrix[:, i, j] = -sin
    matrix[:, j, i] = sin
    return matrix


def _assemble(tree: _Hierarchy, values: Floats) -> tuple[Floats, Floats, tuple[str, ...]]:
    """World positions and rotations from the channels."""
    added: list[str] = []
    parents = [joint.parent for joint in tree.joints]
    position, rotation = chain_positions(parents, _local(tree, values, added), len(values))
    notes: tuple[str, ...] = ()
    if added:
        notes = (f"position channels of {len(added)} joints are added to their OFFSET",)
    return position, rotation, notes


def _local(tree: _Hierarchy, values: Floats, added: list[str]) -> Iterator[tuple[Floats, Floats]]:
    """Each joint's place and rotation in its parent's frame; ``added`` collects names."""
    frames, column = len(values), 0
    for joint in tree.joints:
        offset = np.array(joint.offset)
        place = np.tile(offset, (frames, 1))
        rotation = np.tile(np.eye(3), (frames, 1, 1))
        moves, columns = [], []
        for kind, axis in joint.channels or ():
            if kind == "rotation":
                rotation = rotation @ _elementary(axis, values[:, column])
            else:
                moves.append(axis)
                columns.append(column)
            column += 1
        if moves:
            place[:, moves] = values[:, columns]
            if joint.parent >= 0 and _means_addition(offset[moves], place[:, moves]):
                place[:, moves] += offset[moves]
                added.append(joint.name)
        yield place, rotation


def _means_addition(offset: Floats, moved: Floats) -> bool:
    """Whether a joint's position channels stay near zero although its OFFSET is far from it."""
    good = moved[np.isfinite(moved).all(axis=1)]
    if not len(good):
        return False
    middle = np.median(good, axis=0)
    size = float(np.linalg.norm(offset))
    return float(np.linalg.norm(middle)) < 0.2 * size < 0.5 * float(np.linalg.norm(middle - offset))
