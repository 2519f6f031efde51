"""The skeleton of a BVH file: everything between HIERARCHY and MOTION."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from physretarget.capture.recording import Floats
from physretarget.capture.text import plain_numbers
from physretarget.errors import InputError

_CHANNEL = re.compile(r"([xyz])(position|rotation)$", re.IGNORECASE)
_MAX_JOINTS = 2000
MAX_VALUE = 1e7  # larger numbers are no length in any unit and no angle


@dataclass
class Joint:
    """A joint as the file states it: channels are (kind, axis) in the file's order."""

    name: str
    parent: int
    offset: tuple[float, float, float] | None = None
    channels: list[tuple[str, int]] | None = None


@dataclass
class Hierarchy:
    """The skeleton: joints with parents first, and each end site's joint and offset."""

    joints: list[Joint] = field(default_factory=list)
    end_sites: dict[str, tuple[int, Floats]] = field(default_factory=dict)

    @property
    def width(self) -> int:
        """Channels of all joints together: the numbers of one frame."""
        return sum(len(joint.channels or ()) for joint in self.joints)


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
    if len(numbers) != count or not all(abs(number) < MAX_VALUE for number in numbers):
        given = " ".join(words)[:60]
        raise InputError(
            f"OFFSET needs {count} finite numbers, not {given!r}.", path=path, line=line
        )
    return numbers


def parse_hierarchy(lines: list[str], path: str | Path) -> Hierarchy:
    """Parse everything between HIERARCHY and MOTION."""
    tree = Hierarchy()
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
    tree: Hierarchy, stack: list[int | str], key: str, name: str, path: str | Path, line: int
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
    tree.joints.append(Joint(name, parent))
    return len(tree.joints) - 1


def _open_end(tree: Hierarchy, stack: list[int | str], path: str | Path, line: int) -> str:
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


def _close(tree: Hierarchy, stack: list[int | str], path: str | Path, line: int) -> None:
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
    tree: Hierarchy, stack: list[int | str], words: list[str], path: str | Path, line: int
) -> None:
    if not stack:
        raise InputError("OFFSET stands outside a joint.", path=path, line=line)
    (plain,), _ = plain_numbers([" ".join(words)])
    x, y, z = _numbers(plain.split(), 3, path, line)
    owner = stack[-1]
    if isinstance(owner, str):
        tree.end_sites[owner] = (tree.end_sites[owner][0], np.array([x, y, z]))
    else:
        tree.joints[owner].offset = (x, y, z)


def _set_channels(
    tree: Hierarchy, stack: list[int | str], words: list[str], path: str | Path, line: int
) -> None:
    owner = stack[-1] if stack else None
    if isinstance(owner, str) and words == ["0"]:
        return  # some writers say of an End Site that it has none
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
