"""Reading text and JSON so that every failure names the file and, where known, the line."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any, NoReturn

from physretarget.errors import InputError


@dataclass(frozen=True)
class Source:
    """A file's bytes and their SHA-256."""

    path: Path
    content: bytes

    @classmethod
    def open(cls, path: str | PathLike[str]) -> Source:
        """Read a file whole."""
        place = Path(path)
        try:
            return cls(place, place.read_bytes())
        except OSError as error:
            raise InputError(f"cannot be read: {error.strerror}.", path=place) from error

    @property
    def sha256(self) -> str:
        """Hash of the bytes."""
        return hashlib.sha256(self.content).hexdigest()

    @property
    def name(self) -> str:
        """File name without folder, as sources are quoted."""
        return self.path.name

    def text(self) -> str:
        """Decoded as UTF-8, a byte order mark dropped."""
        try:
            return self.content.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            line = self.content[: error.start].count(b"\n") + 1
            raise InputError("not UTF-8 text.", path=self.path, line=line) from error

    def json(self) -> Any:
        """Parsed strictly: NaN and infinities, which JSON does not have, are refused."""
        return self._parsed

    @cached_property
    def _parsed(self) -> Any:

        def refuse(constant: str) -> NoReturn:
            raise InputError(f"{constant} is not a number that JSON allows.", path=self.path)

        try:
            return json.loads(self.text(), parse_constant=refuse)
        except json.JSONDecodeError as error:
            raise InputError(
                f"broken JSON: {error.msg} (column {error.colno}).",
                path=self.path,
                line=error.lineno,
            ) from error
        except (RecursionError, ValueError) as error:
            raise InputError(
                "broken JSON: nested too deeply or a number too long.", path=self.path
            ) from error

    def fail(self, where: str, message: str) -> NoReturn:
        """Raise InputError for a place inside the file that has no line."""
        raise InputError(f"{where}: {message}", path=self.path)


def number(source: Source, where: str, value: Any) -> float:
    """A finite float, or an InputError that says what stood there."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        source.fail(where, f"{str(value)[:40]!r} is not a number.")
    if (isinstance(value, int) and abs(value) > 1e300) or not math.isfinite(value):
        source.fail(where, "the number is not finite.")
    return float(value)


def numbers(source: Source, where: str, value: Any, count: int | None = None) -> list[float]:
    """A list of finite floats; a lone number counts as a list of one."""
    if isinstance(value, list):
        found = [number(source, where, v) for v in value]
    else:
        found = [number(source, where, value)]
    if count is not None and len(found) != count:
        source.fail(where, f"{len(found)} numbers where {count} are needed.")
    return found


def mapping(source: Source, where: str, value: Any) -> dict[str, Any]:
    """A JSON object."""
    if not isinstance(value, dict):
        source.fail(where, f"an object is needed, not {type(value).__name__}.")
    return value


def sequence(source: Source, where: str, value: Any) -> list[Any]:
    """A JSON array."""
    if not isinstance(value, list):
        source.fail(where, f"a list is needed, not {type(value).__name__}.")
    return value
