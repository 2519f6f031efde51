"""Key pose files: TOML, one table per pose."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path

import numpy as np
import tomli_w
from numpy.typing import NDArray

from physretarget.capture.actor import CONTACT_POINTS, REFERENCE_ACTOR
from physretarget.errors import InputError
from physretarget.files import write_file
from physretarget.keyposes.layout import ACTOR_LAYOUT, JointError, Layout, layout_of
from physretarget.keyposes.limbs import Choice, check_choice
from physretarget.keyposes.pose import KeyPose, KeyPoseSet, merged
from physretarget.mjcf import Character

__all__ = ["FORMAT", "load", "load_keyposes", "save"]

Array = NDArray[np.float64]

FORMAT = "physretarget/keyposes/1"
MAX_CHARACTERS = 4 * 2**20  # the largest that comes with the package has 150 thousand
MAX_LINE = 8192
TOP_KEYS = ("format", "license", "reference_actor", "character", "limbs", "pose")
POSE_KEYS = ("name", "note", "planted", "source", "actor", "character")


def load_keyposes(
    paths: Sequence[str | PathLike[str]] | str | PathLike[str], character: Character
) -> KeyPoseSet:
    """Read one or several key pose files of one character as one set.

    Args:
        paths: One file, or several that are used together.
        character: The character that was posed.

    Returns:
        All key poses, in order.

    Raises:
        InputError: as :func:`load` and :func:`merged`.
    """
    if isinstance(paths, str | PathLike):
        paths = [paths]
    return merged([load(path, character) for path in paths])


def load(path: str | PathLike[str], character: Character) -> KeyPoseSet:
    """Read a key pose file.

    A file posed on an earlier version of the same character is accepted as long as the joints
    fit, with a remark: a new colour changes a model's hash but no pose.

    Args:
        path: The TOML file.
        character: The character that was posed.

    Returns:
        The set.

    Raises:
        InputError: the file cannot be read, is no key pose file, belongs to another character
            or reference actor, or has an unusable pose; with the line.
    """
    file = Path(path)
    try:
        text = file.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", path=file) from error
    except UnicodeDecodeError as error:
        raise InputError("is no UTF-8 text, so no key pose file", path=file) from error
    _check_size(text, file)
    try:
        content = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # also for numbers of too many digits
        line = re.search(r"line (\d+)", str(error))
        raise InputError(
            f"is no valid TOML: {error}", path=file, line=int(line[1]) if line else None
        ) from error
    return _Reader(file, text, character).read(content)


def _check_size(text: str, file: Path) -> None:
    # Keys of many parts and long numbers take time with the square of their length.
    if len(text) > MAX_CHARACTERS:
        raise InputError(
            f"has {len(text)} characters, at most {MAX_CHARACTERS} are read", path=file
        )
    for number, line in enumerate(text.splitlines(), start=1):
        if len(line) > MAX_LINE:
            raise InputError(
                f"the line is longer than {MAX_LINE} characters", path=file, line=number
            )


def save(keyposes: KeyPoseSet, path: str | PathLike[str], character: Character) -> None:
    """Write a key pose file, whole or not at all.

    Args:
        keyposes: The key poses.
        path: The TOML file.
        character: The character that was posed.
    """
    layout = layout_of(character)
    content = {
        "format": FORMAT,
        "license": keyposes.license,
        "reference_actor": keyposes.reference_actor,
        "character": {"name": keyposes.character_name, "sha256": keyposes.character_sha256},
        **({"limbs": dict(keyposes.limbs)} if keyposes.limbs else {}),
        "pose": [_pose_table(pose, layout) for pose in keyposes.poses],
    }
    write_file(path, _compact(tomli_w.dumps(content)).encode())


def _pose_table(pose: KeyPose, layout: Layout) -> dict[str, object]:
    return {
        "name": pose.name,
        "note": pose.note,
        "planted": list(pose.planted),
        "source": {"file": pose.source, "sha256": pose.sha256, "time": round(pose.time, 6)},
        "actor": ACTOR_LAYOUT.table(pose.actor_qpos),
        "character": layout.table(pose.qpos),
    }


def _compact(text: str) -> str:
    """Arrays of scalars and free roots on one line each: one joint, one line."""
    text = re.sub(
        r"= \[\n((?:    [^\n]*,\n)+)\]",
        lambda found: "= [" + ", ".join(x.strip(" ,") for x in found[1].splitlines()) + "]",
        text,
    )
    return re.sub(
        r"\n\[pose\.(?:actor|character)\.([^\]\n]+)\]\n(height = .*)\n(roll = .*)\n(pitch = .*)\n",
        r"\1 = { \2, \3, \4 }\n",
        text,
    )


class _Reader:
    """Reads one file; keeps its text so that errors can name the line."""

    def __init__(self, path: Path, text: str, character: Character) -> None:
        self.path = path
        self.lines = text.splitlines()
        self.character = character
        self.layout = layout_of(character)
        self.starts = [
            number
            for number, line in enumerate(self.lines, start=1)
            if re.match(r"\s*\[\[\s*pose\s*\]\]", line)
        ]

    def read(self, content: Mapping[str, object]) -> KeyPoseSet:
        self._known(content, TOP_KEYS, None)
        if content.get("format") != FORMAT:
            raise self._error(f"is no key pose file: format must be {FORMAT!r}", key="format")
        remarks = self._same_character(content)
        if content.get("reference_actor") != REFERENCE_ACTOR:
            raise self._error(
                f"was posed on reference actor {content.get('reference_actor')!r}; this version "
                f"knows {REFERENCE_ACTOR!r}",
                key="reference_actor",
            )
        tables = content.get("pose")
        if not isinstance(tables, list):  # an empty list is a file that is begun
            raise self._error("has no [[pose]]")
        poses = [self._pose(table, index) for index, table in enumerate(tables)]
        seen: set[str] = set()
        for index, pose in enumerate(poses):
            if pose.name in seen:
                raise self._error(f"two key poses are named {pose.name!r}", pose=index, key="name")
            seen.add(pose.name)
        return KeyPoseSet(
            character_name=self.character.name,
            character_sha256=self.character.sha256,
            license=_text(content.get("license", "")),
            poses=tuple(poses),
            limbs=self._limbs(content),
            remarks=remarks,
        )

    def _same_character(self, content: Mapping[str, object]) -> tuple[str, ...]:
        told = content.get("character")
        if not isinstance(told, dict) or not told.get("name"):
            raise self._error("does not say whose key poses it holds: [character] name is missing")
        if told["name"] != self.character.name:
            raise self._error(
                f"holds key poses of {told['name']!r}, but the character is "
                f"{self.character.name!r}",
                key="name",
            )
        if told.get("sha256") == self.character.sha256:
            return ()
        return (f"{self.path.name} was posed on another version of {self.character.name!r}",)

    def _limbs(self, content: Mapping[str, object]) -> Choice:
        table = content.get("limbs", {})
        if not isinstance(table, dict):
            raise self._error("limbs must be a table", key="limbs")
        for actor, mine in table.items():
            try:
                check_choice(self.character, actor, mine)
            except InputError as error:
                raise self._error(f"limbs: {error}", key=actor) from error
        return tuple(table.items())

    def _pose(self, table: object, index: int) -> KeyPose:
        if not isinstance(table, dict):
            raise self._error("a pose must be a table", pose=index)
        self._known(table, POSE_KEYS, index)
        name = table.get("name")
        if not isinstance(name, str) or not name:
            raise self._error("the pose has no name", pose=index, key="name")
        source = self._table(table, "source", index)
        time = source.get("time")
        if isinstance(time, bool) or not isinstance(time, int | float) or not time >= 0:
            raise self._error(
                f"pose {name!r}: source time must be a number of seconds, not {time!r}",
                pose=index,
                key="time",
            )
        return KeyPose(
            name=name,
            source=_text(source.get("file", "")),
            sha256=_text(source.get("sha256", "")),
            time=float(time),
            actor_qpos=self._qpos(table, "actor", ACTOR_LAYOUT, index),
            qpos=self._qpos(table, "character", self.layout, index),
            planted=self._planted(table, index),
            note=_text(table.get("note", "")),
        )

    def _qpos(self, table: Mapping[str, object], key: str, layout: Layout, index: int) -> Array:
        try:
            return layout.qpos(self._table(table, key, index))
        except JointError as error:
            raise self._error(
                f"pose {table['name']!r}, {key}: {error.message}",
                pose=index,
                key=error.joint,
                section=key,
            ) from error

    def _planted(self, table: Mapping[str, object], index: int) -> tuple[str, ...]:
        planted = table.get("planted", [])
        if not isinstance(planted, list):
            raise self._error("planted must be a list of names", pose=index, key="planted")
        for point in planted:
            if point not in CONTACT_POINTS:
                raise self._error(
                    f"pose {table['name']!r}: {point!r} is no contact point of the actor: "
                    f"{', '.join(CONTACT_POINTS)}",
                    pose=index,
                    key="planted",
                )
        return tuple(planted)

    def _table(self, table: Mapping[str, object], key: str, index: int) -> Mapping[str, object]:
        value = table.get(key)
        if not isinstance(value, dict):
            raise self._error(f"pose {table['name']!r} has no table {key!r}", pose=index)
        return value

    def _known(self, table: Mapping[str, object], keys: Sequence[str], pose: int | None) -> None:
        for key in table:
            if key not in keys:
                raise self._error(
                    f"unknown key {key!r}; allowed are {', '.join(keys)}", pose=pose, key=key
                )

    def _error(
        self,
        message: str,
        *,
        pose: int | None = None,
        key: str | None = None,
        section: str | None = None,
    ) -> InputError:
        return InputError(message, path=self.path, line=self._line(pose, key, section))

    def _line(self, pose: int | None, key: str | None, section: str | None) -> int | None:
        """The line of a key within a pose (or the whole file), else where the pose begins."""
        first, last = 1, len(self.lines)
        if pose is not None and pose < len(self.starts):
            first = self.starts[pose]
            last = self.starts[pose + 1] - 1 if pose + 1 < len(self.starts) else last
        elif pose is not None:
            return None
        begin = first if pose is not None else None
        if section is not None:
            for number in range(first, last + 1):
                if re.match(rf"\s*\[pose\.{section}\]", self.lines[number - 1]):
                    first = begin = number
                    break
        if key is None:
            return begin
        name = re.escape(key)
        pattern = re.compile(rf'\s*(\[.*\b{name}\]|"?{name}"?\s*[=.])')
        for number in range(first, last + 1):
            if pattern.match(self.lines[number - 1]):
                return number
        return begin


def _text(value: object) -> str:
    return value if isinstance(value, str) else str(value)
