"""The library: an animator's past curves, cut into segments that matching can borrow.

Each example curve is halved again and again at its median key, which both halves keep, down to
at least ``min_keys`` keys (Ruhland et al. 2017, "Example Curve Segmentation").
"""

from __future__ import annotations

import json
import tokenize
import zipfile
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physretarget.errors import InputError
from physretarget.face.curve import TANGENT_TYPES, Curve
from physretarget.face.formats import FORMATS, read_shots
from physretarget.face.formats.source import Source
from physretarget.face.shot import Shot
from physretarget.files import npz_bytes, write_file

Array = NDArray[np.float64]
_VERSION = 2
# What NumPy's and zip's readers raise over archives that are damaged or forged.
TORN = (
    zipfile.BadZipFile,
    zlib.error,
    tokenize.TokenError,
    SyntaxError,
    ValueError,
    ArithmeticError,
    LookupError,
    TypeError,
    EOFError,
    MemoryError,
    NotImplementedError,
    RuntimeError,
)


@dataclass(frozen=True, kw_only=True)
class LibrarySettings:
    """How examples are cut: halves of at least min_keys keys."""

    min_keys: int = 4

    def __post_init__(self) -> None:
        if self.min_keys < 2:
            raise InputError("segments need at least 2 keys.")


@dataclass(frozen=True)
class Example:
    """One hand-animated curve and where it comes from."""

    shot: str
    channel: str
    curve: Curve
    sha256: str = ""

    @cached_property
    def range(self) -> float:
        """Largest minus smallest value, the unit of its segments' amplitudes."""
        return float(np.ptp(self.curve.evaluate(_dense(self.curve))))

    @property
    def is_still(self) -> bool:
        """Whether it never moves, rounding aside."""
        return self.range <= 1e-9 * max(1.0, float(np.abs(self.curve.value).max()))


@dataclass(frozen=True)
class Segment:
    """Keys first to last (both included) of one example."""

    example: int
    first: int
    last: int

    @property
    def keys(self) -> int:
        """How many keys."""
        return self.last - self.first + 1


@dataclass(frozen=True, eq=False)
class Library:
    """Examples and their segments, longest first."""

    examples: tuple[Example, ...]
    settings: LibrarySettings = LibrarySettings()

    @classmethod
    def of(cls, shots: Iterable[Shot], settings: LibrarySettings | None = None) -> Library:
        """A library of shots; curves of one key or one value teach nothing and are left out.

        Args:
            shots: The animator's shots.
            settings: What counts as a segment.

        Returns:
            The library.
        """
        examples = tuple(
            example
            for shot in shots
            for channel, curve in shot.curves.items()
            if len(curve.keys) > 1
            and not (example := Example(shot.name, channel, curve, shot.sha256)).is_still
        )
        return cls(examples, settings or LibrarySettings())

    @classmethod
    def build(
        cls,
        paths: Iterable[str | PathLike[str]],
        settings: LibrarySettings | None = None,
        *,
        previous: Library | None = None,
        progress: Callable[[str], None] = lambda name: None,
        left_out: Callable[[str], None] = lambda why: None,
    ) -> Library:
        """Read files and folders; files whose content ``previous`` already holds are not parsed.

        What lies in a folder and cannot be read is left out, and ``left_out`` is told why.

        Args:
            paths: Files and folders.
            settings: What counts as a segment.
            previous: A library whose files need not be parsed again.
            progress: Called with the name of every file.
            left_out: Called with one sentence for every file that is no shot.

        Returns:
            The library.

        Raises:
            InputError: a named file is broken, or nothing with keys was found.
        """
        kept: dict[str, list[Example]] = {}
        for example in previous.examples if previous else ():
            kept.setdefault(example.sha256, []).append(example)
        examples: list[Example] = []
        given = [Path(path) for path in paths]
        named = {path for path in given if not path.is_dir()}
        for path in _files(given):
            progress(path.name)
            source = Source.open(path)
            if source.sha256 in kept:
                examples += kept[source.sha256]
            else:
                try:
                    shots = read_shots(path)
                except InputError as error:
                    if path in named:
                        raise
                    left_out(f"{error}")
                    continue
                examples += cls.of(shots).examples
        if not examples:
            raise InputError("no file with animated curves was found in the paths given.")
        wanted = settings or (previous.settings if previous else LibrarySettings())
        return cls(tuple(examples), wanted)

    @cached_property
    def segments(self) -> tuple[Segment, ...]:
        """Every segment once, longest in time first (ties: by origin)."""
        found: set[tuple[int, int, int]] = set()
        for index, example in enumerate(self.examples):
            count = len(example.curve.keys)
            found |= {(index, a, b) for a, b in halves(count, self.settings.min_keys)}
        ordered = sorted(found, key=lambda s: (-self._duration(*s), s))
        return tuple(Segment(*s) for s in ordered)

    def _duration(self, example: int, first: int, last: int) -> float:
        keys = self.examples[example].curve.keys
        return keys[last].time - keys[first].time

    def duration(self, segment: Segment) -> float:
        """Seconds from its first to its last key.

        Args:
            segment: A segment of this library.

        Returns:
            Its length, s.
        """
        return self._duration(segment.example, segment.first, segment.last)

    def curve(self, segment: Segment) -> Curve:
        """The segment's own keys, time rebased to zero.

        Args:
            segment: A segment of this library.

        Returns:
            Its curve, from 0 s.
        """
        whole = self.examples[segment.example].curve
        keys = whole.keys[segment.first : segment.last + 1]
        return Curve(keys, whole.weighted).shifted(-keys[0].time)

    def without(self, drop: Callable[[Example], bool]) -> Library:
        """The library less some examples (for held-out measurements).

        Args:
            drop: Says which examples go.

        Returns:
            The smaller library.
        """
        kept = tuple(e for e in self.examples if not drop(e))
        return Library(kept, self.settings)

    @property
    def seconds(self) -> float:
        """Length of the animation: per shot its longest curve, summed."""
        longest: dict[str, float] = {}
        for example in self.examples:
            length = example.curve.end - example.curve.start
            longest[example.shot] = max(longest.get(example.shot, 0.0), length)
        return sum(longest.values())

    def describe(self) -> str:
        """What is in it, for people: one line per shot."""
        shots: dict[str, list[Example]] = {}
        for example in self.examples:
            shots.setdefault(example.shot, []).append(example)
        keys = sum(len(e.curve.keys) for e in self.examples)
        lines = [
            f"{len(shots)} shots, {self.seconds:.1f} s, {len(self.examples)} curves, {keys} keys, "
            f"{len(self.segments)} segments"
        ]
        for shot, members in shots.items():
            count = sum(len(e.curve.keys) for e in members)
            lines.append(f"{shot}: {len(members)} curves, {count} keys")
        return "\n".join(lines)

    def to_bytes(self) -> bytes:
        """npz without pickle; the same library gives the same bytes."""
        tables = [e.curve.table for e in self.examples]
        kinds = [
            (TANGENT_TYPES.index(k.in_type), TANGENT_TYPES.index(k.out_type), int(k.broken))
            for e in self.examples
            for k in e.curve.keys
        ]
        entries = [[e.shot, e.channel, e.sha256, e.curve.weighted] for e in self.examples]
        meta = {"version": _VERSION, "settings": asdict(self.settings), "examples": entries}
        arrays: Mapping[str, NDArray[Any]] = {
            "keys": np.concatenate(tables) if tables else np.empty((0, 6)),
            "kinds": np.array(kinds, dtype=np.int8).reshape(-1, 3),
            "count": np.array([len(t) for t in tables], dtype=np.int64),
            "meta": np.frombuffer(json.dumps(meta, sort_keys=True).encode(), dtype=np.uint8),
        }
        return npz_bytes(arrays)

    def save(self, path: str | PathLike[str]) -> None:
        """Write beside, then rename.

        Args:
            path: The .npz file.
        """
        write_file(path, self.to_bytes())

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Library:
        """Read what save wrote.

        Args:
            path: The .npz file.

        Returns:
            The library.
        """
        try:
            with np.load(path, allow_pickle=False) as archive:
                content = {name: archive[name] for name in ("keys", "kinds", "count", "meta")}
            meta = json.loads(content["meta"].tobytes())
            if meta["version"] != _VERSION:
                raise InputError(
                    f"library version {meta['version']}; this is {_VERSION}.", path=path
                )
            for name, kind in (("keys", "f"), ("kinds", "i"), ("count", "i"), ("meta", "u")):
                if not isinstance(content[name], np.ndarray) or content[name].dtype.kind != kind:
                    raise TypeError(name)
            ends = np.cumsum(content["count"])
            examples = [
                _example(entry, content["keys"][end - n : end], content["kinds"][end - n : end])
                for entry, end, n in zip(meta["examples"], ends, content["count"], strict=True)
            ]
            return cls(tuple(examples), LibrarySettings(**meta["settings"]))
        except OSError as error:
            raise InputError(f"cannot be read: {error.strerror or error}.", path=path) from error
        except TORN as error:
            raise InputError("not a library written by face library.", path=path) from error


def _example(entry: Sequence[Any], table: Array, kinds: NDArray[np.int8]) -> Example:
    shot, channel, sha256, weighted = entry
    names = [(TANGENT_TYPES[a], TANGENT_TYPES[b], bool(c)) for a, b, c in kinds.tolist()]
    curve = Curve.from_table(table, names, bool(weighted))
    return Example(str(shot), str(channel), curve, str(sha256))


def halves(count: int, min_keys: int) -> list[tuple[int, int]]:
    """Recursive halving of keys 0 to count-1 at the median key, shared by both halves."""
    found: list[tuple[int, int]] = []
    waiting = [(0, count - 1)] if count >= min_keys else []
    while waiting:
        first, last = waiting.pop()
        found.append((first, last))
        middle = (first + last) // 2
        if min(middle - first, last - middle) + 1 >= min_keys:
            waiting += [(first, middle), (middle, last)]
    return found


def _dense(curve: Curve) -> Array:
    return np.linspace(curve.start, curve.end, 8 * len(curve.keys) + 1)


def _files(paths: Iterable[str | PathLike[str]]) -> list[Path]:
    suffixes = tuple(s for f in FORMATS if f.shots for s in f.suffixes)
    files: list[Path] = []
    for path in map(Path, paths):
        if path.is_dir():
            found = sorted(p for p in path.rglob("*") if p.name.lower().endswith(suffixes))
            files += [p for p in found if p.is_file()]
        else:
            files.append(path)
    return files
