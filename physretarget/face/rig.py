"""Rig file (TOML): how capture channels drive a rig, and which of its channels are matched.

::

    name = "girl"
    [groups.brows]                       # lids, gaze, head, lips likewise
    library = ["*brow*"]                 # library channels this group may borrow from; all if unset
    [groups.lips]
    keyed = true                         # else lips, and they alone, are left to the capture
    [channels.brow_up]
    group = "brows"
    range = [0.0, 1.0]
    from = { BrowInnerUp = 1.0, BrowOuterUpLeft = 0.5 }   # gains; their sum plus the offset
    offset = 0.0
"""

from __future__ import annotations

import fnmatch
import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from physretarget.errors import InputError
from physretarget.face.formats.arkit import plain_name
from physretarget.face.shot import Take

LIPS = "lips"
"""The group that is left to the capture unless asked for (the paper's choice)."""

_LIP_WORDS = ("jaw", "mouth", "tongue", "lip", "cheekpuff")
_GROUP_WORDS = (
    ("brows", ("brow",)),
    ("gaze", ("eyelook", "eyeyaw", "eyepitch", "eyeroll", "eye.rotation")),
    ("lids", ("eye",)),
    ("head", ("head",)),
    ("lips", _LIP_WORDS),
)


@dataclass(frozen=True)
class RigChannel:
    """One channel: ``offset + sum gain * capture``, kept within its range."""

    name: str
    group: str
    lower: float
    upper: float
    sources: Mapping[str, float]
    offset: float = 0.0

    @property
    def range(self) -> float:
        """Width of the range, the unit of every relative error."""
        return self.upper - self.lower


@dataclass(frozen=True)
class Rig:
    """A rig's channels and, per group, the library channels that it borrows from (patterns), and
    whether it is keyed or left to the capture.
    """

    name: str
    channels: tuple[RigChannel, ...]
    library: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    keyed: Mapping[str, bool] = field(default_factory=dict)

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Rig:
        """Read a rig file; unknown keys are errors that list the known ones.

        Args:
            path: The TOML file.

        Returns:
            The rig.
        """
        place = Path(path)
        try:
            content = tomllib.loads(place.read_text(encoding="utf-8"))
        except OSError as error:
            raise InputError(f"cannot be read: {error.strerror}.", path=place) from error
        except UnicodeDecodeError as error:
            raise InputError("not UTF-8 text.", path=place) from error
        except (tomllib.TOMLDecodeError, RecursionError) as error:
            raise InputError(f"broken TOML: {error}.", path=place) from error
        return _Parser(place).rig(content)

    @classmethod
    def of(cls, take: Take) -> Rig:
        """A rig whose channels are the capture's own, grouped by ARKit's names.

        Args:
            take: The capture.

        Returns:
            The rig.
        """
        channels = []
        for name, values in zip(take.channels, take.values.T, strict=True):
            low, high = min(0.0, float(values.min())), max(1.0, float(values.max()))
            channels.append(RigChannel(name, guess_group(name), low, high, {name: 1.0}))
        return cls(take.name, tuple(channels))

    def matched(self, *, lips: bool = False) -> tuple[RigChannel, ...]:
        """Channels to be matched: of groups that the rig says are keyed, and not lips else.

        Args:
            lips: Match all groups, whatever the rig says.

        Returns:
            The channels.
        """
        return tuple(c for c in self.channels if lips or self.keyed.get(c.group, c.group != LIPS))

    def drive(self, take: Take) -> Take:
        """The capture carried onto the rig's channels, kept within their ranges.

        Args:
            take: The capture.

        Returns:
            The capture in the rig's channels, same frames.

        Raises:
            InputError: a channel the rig asks for is not in the capture, in no spelling.
        """
        columns = []
        for channel in self.channels:
            total = np.full(len(take.time), channel.offset)
            for source, gain in channel.sources.items():
                total += gain * take.channel(_spelt(source, take, channel.name))
            columns.append(np.clip(total, channel.lower, channel.upper))
        values = np.stack(columns, axis=1) if columns else np.empty((len(take.time), 0))
        names = tuple(c.name for c in self.channels)
        return Take(take.name, take.time, names, values, take.sha256, take.notes)

    def borrows(self, group: str, library_channel: str) -> bool:
        """Whether a group may take segments of a library channel.

        Args:
            group: One of the rig's groups.
            library_channel: Name of a channel in the library.

        Returns:
            Whether it may.
        """
        patterns = self.library.get(group, ())
        name = library_channel.lower()
        return not patterns or any(fnmatch.fnmatchcase(name, p.lower()) for p in patterns)


def _spelt(source: str, take: Take, channel: str) -> str:
    """How the capture spells a channel: as the rig does, else the only one that means it."""
    if source in take.channels:
        return source
    alike = [c for c in take.channels if plain_name(c) == plain_name(source)]
    if len(alike) == 1:
        return alike[0]
    also = f"; {', '.join(alike)} all could be meant" if alike else ""
    raise InputError(
        f"rig channel {channel} is driven by {source}, which {take.name} does not have{also}; "
        f"it has {', '.join(take.channels)}."
    )


def guess_group(name: str) -> str:
    """Group of an ARKit-like channel name."""
    plain = name.lower().replace("_", "").replace("left", "").replace("right", "")
    for group, words in _GROUP_WORDS:
        if any(word in plain for word in words):
            return group
    return "other"


@dataclass(frozen=True)
class _Parser:
    path: Path

    def fail(self, message: str) -> NoReturn:
        raise InputError(message, path=self.path)

    def table(self, where: str, value: Any, allowed: tuple[str, ...] = ()) -> dict[str, Any]:
        if not isinstance(value, dict):
            self.fail(f"{where} must be a table.")
        for key in value if allowed else ():
            if key not in allowed:
                self.fail(f"{where} has no setting {key!r}; there are {', '.join(allowed)}.")
        return value

    def number(self, where: str, value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            self.fail(f"{where} must be a number, not {value!r}.")
        if not math.isfinite(value):
            self.fail(f"{where} must be finite.")
        return float(value)

    def rig(self, content: dict[str, Any]) -> Rig:
        self.table("the file", content, ("name", "groups", "channels"))
        library, keyed = {}, {}
        for group, entry in self.table("groups", content.get("groups", {})).items():
            told = self.table(f"groups.{group}", entry, ("library", "keyed"))
            patterns = told.get("library", [])
            if not isinstance(told.get("keyed", True), bool):
                self.fail(f"groups.{group}.keyed must be true or false.")
            if "keyed" in told:
                keyed[group] = told["keyed"]
            if not isinstance(patterns, list) or not all(isinstance(p, str) for p in patterns):
                self.fail(f"groups.{group}.library must be a list of patterns.")
            library[group] = tuple(patterns)
        entries = self.table("channels", content.get("channels", {}))
        if not entries:
            self.fail("the rig has no [channels.NAME].")
        channels = tuple(self.channel(name, entry, library) for name, entry in entries.items())
        return Rig(str(content.get("name", self.path.stem)), channels, library, keyed)

    def channel(self, name: str, entry: Any, groups: Mapping[str, Any]) -> RigChannel:
        where = f"channels.{name}"
        table = self.table(where, entry, ("group", "range", "from", "offset", "gain"))
        group = table.get("group", guess_group(name))
        known = (*groups, "brows", "lids", "gaze", "head", LIPS, "other")
        if group not in known:
            self.fail(
                f"{where}.group is {group!r}; it is one of {', '.join(dict.fromkeys(known))}."
            )
        span = table.get("range", [0.0, 1.0])
        if not isinstance(span, list) or len(span) != 2:
            self.fail(f"{where}.range must be [lowest, highest].")
        lower, upper = (self.number(f"{where}.range", v) for v in span)
        if not lower < upper:
            self.fail(f"{where}.range must rise, not go from {lower:g} to {upper:g}.")
        gain = self.number(f"{where}.gain", table.get("gain", 1.0))
        given = table.get("from", name)
        sources = {given: 1.0} if isinstance(given, str) else self.table(f"{where}.from", given)
        gains = {
            source: gain * self.number(f"{where}.from.{source}", value)
            for source, value in sources.items()
        }
        offset = self.number(f"{where}.offset", table.get("offset", 0.0))
        return RigChannel(name, group, lower, upper, gains, offset)
