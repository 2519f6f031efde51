"""The suite file: which clips are judged with which model, and which captures are retargeted."""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from functools import partial
from pathlib import Path
from typing import Any, Literal, get_args

from physretarget.errors import InputError, UsageError
from physretarget.options import JOBS, Option
from physretarget.suite.compare import DIRECTIONS

Kind = Literal["validate", "retarget"]
Line = Callable[[str, int, str], int | None]
TABLES: Mapping[Kind, str] = {"validate": "case", "retarget": "retarget"}
"""Kind of job → its table in the file."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """Files that are treated the same way: one ``[[case]]`` or ``[[retarget]]`` of the file.

    ``sources`` are the globs of clips or captures, ``given`` the options by name, paths absolute.
    """

    name: str
    kind: Kind
    sources: tuple[str, ...]
    given: Mapping[str, Any]
    tags: tuple[str, ...] = ()
    owner: str = ""
    line: int | None = None

    @property
    def model(self) -> Path:
        """The MJCF file of clips or of what is made of captures."""
        path: Path = self.given["model" if self.kind == "validate" else "character"]
        return path


@dataclass(frozen=True, kw_only=True)
class Suite:
    """A suite file as read; ``history`` is a database URL, ``out`` the site's folder."""

    path: Path
    name: str
    history: str
    out: Path
    cases: tuple[Case, ...] = ()
    tolerances: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    @property
    def folder(self) -> Path:
        """Where relative paths start."""
        return self.path.parent


class _Bad(Exception):
    """A value that cannot be used, with its key; the caller adds file and line."""

    def __init__(self, key: str, message: str) -> None:
        super().__init__(message)
        self.key = key


def load_suite(path: str | os.PathLike[str]) -> Suite:
    """Read a suite file.

    Raises:
        InputError: unreadable, not TOML, an unknown key, a missing or unusable value; names the
            line.
    """
    source = Path(path).absolute()
    try:
        text = source.read_text(encoding="utf-8")
        table = tomllib.loads(text)
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}.", path=path) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"is not valid TOML: {error}.", path=path) from error
    where = _line_finder(text)
    _check_tables(table, path, where)
    reader = _Reader(source.parent)
    suite = _guarded(reader.suite, table.get("suite", {}), "suite", 0, path, where)
    cases = [
        replace(
            _guarded(partial(reader.case, kind), entry, key, index, path, where),
            line=where(key, index, ""),
        )
        for kind, key in TABLES.items()
        for index, entry in enumerate(table.get(key, []))
    ]
    if not cases:
        raise InputError("has neither a [[case]] nor a [[retarget]].", path=path)
    tolerances = {
        name: _guarded(_tolerance, entry, f"tolerance.{name}", 0, path, where)
        for name, entry in table.get("tolerance", {}).items()
    }
    return Suite(
        path=source,
        name=suite.get("name", source.stem),
        history=suite.get("history", f"sqlite:///{source.parent / (source.stem + '.sqlite')}"),
        out=suite.get("out", source.parent / f"{source.stem}-report"),
        cases=tuple(cases),
        tolerances=tolerances,
    )


def database_url(text: str, folder: Path) -> str:
    """A history as an SQLAlchemy URL: plain paths and relative SQLite URLs start at a folder."""
    if "://" not in text:
        return f"sqlite:///{folder / text}"
    if text.startswith("sqlite:///") and not text.startswith("sqlite:////"):
        return f"sqlite:///{folder / text.removeprefix('sqlite:///')}"
    if text.startswith(("postgresql://", "postgres://")):
        return "postgresql+psycopg://" + text.split("://", 1)[1]
    return text


class _Reader:
    """Tables to values; every table's keys and their readers stand in one place."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.keys_suite: dict[str, Callable[[str, Any], Any]] = {
            "name": _text, "history": self._history, "out": self._path,
        }  # fmt: skip

    def suite(self, table: dict[str, Any]) -> dict[str, Any]:
        return _read(table, self.keys_suite)

    def case(self, kind: Kind, table: dict[str, Any]) -> Case:
        options = JOBS[kind].suite
        files = "clips" if kind == "validate" else "captures"
        keys: dict[str, Callable[[str, Any], Any]] = {
            "name": _text, "tags": _texts, "owner": _text, files: self._globs,
        }  # fmt: skip
        keys |= {name: self._option(each) for each in options for name in each.names}
        needed = [each.name for each in options if each.required or each.name == "keyposes"]
        if str(table.get("mapper", "")).endswith(".npz"):
            needed.remove("keyposes")  # it has been learned
        aliases = {alias: each.name for each in options for alias in each.aliases}
        plain = {aliases.get(key, key): key for key in table}
        values = _read(table, keys, needed=(files, *needed), written=plain)
        given = {each.name: values[each.name] for each in options if each.name in values}
        model = given["model" if kind == "validate" else "character"]
        robot = ", robot" if given.get("profile") == "robot" else ""
        named = model.stem + (robot if kind == "validate" else " retargeted")
        return Case(
            name=values.get("name", named), kind=kind, sources=values[files], given=given,
            tags=values.get("tags", ()), owner=values.get("owner", ""),
        )  # fmt: skip

    def _option(self, option: Option) -> Callable[[str, Any], Any]:
        def read(key: str, value: Any) -> Any:
            try:
                found = option.read(value, f"'{key}'")
            except UsageError as error:
                raise _Bad(key, str(error)) from error
            if option.kind == "path":
                return tuple(map(self._under, found)) if option.many else self._under(found)
            if option.or_file and found not in option.choices:
                return str(self._under(found))
            return found

        return read

    def _under(self, path: Path | str) -> Path:
        return self.folder / path

    def _path(self, key: str, value: Any) -> Path:
        return self.folder / _text(key, value)

    def _globs(self, key: str, value: Any) -> tuple[str, ...]:
        found = _texts(key, value)
        if not found:
            raise _Bad(key, f"'{key}' is empty, at least one path or glob is needed.")
        return found

    def _history(self, key: str, value: Any) -> str:
        return database_url(_text(key, value), self.folder)


def _read(
    table: dict[str, Any],
    keys: Mapping[str, Callable[[str, Any], Any]],
    needed: tuple[str, ...] = (),
    written: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """The values of a table; ``written`` says under which of its names a key is there."""
    for key in table:
        if key not in keys:
            close = get_close_matches(key, keys, n=1)
            hint = f"did you mean '{close[0]}'?" if close else f"known are {', '.join(keys)}."
            raise _Bad(key, f"unknown key '{key}': {hint}")
    names = {key: key for key in table} if written is None else written
    for key in needed:
        if key not in names:
            raise _Bad("", f"'{key}' is missing.")
    return {key: keys[name](name, table[name]) for key, name in names.items()}


def _text(key: str, value: Any) -> str:
    if not isinstance(value, str) or not value:
        raise _Bad(key, f"'{key}' is {value!r}, a text is needed.")
    return value


def _texts(key: str, value: Any) -> tuple[str, ...]:
    entries = [value] if isinstance(value, str) else value
    if not isinstance(entries, list):
        raise _Bad(key, f"'{key}' is {value!r}, a text or a list of texts is needed.")
    return tuple(_text(key, entry) for entry in entries)


def _positive(key: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < 1e9:
        raise _Bad(key, f"'{key}' is {value!r}, a number above 0 is needed.")
    return float(value)


def _not_negative(key: str, value: Any) -> float:
    return 0.0 if value == 0 and not isinstance(value, bool) else _positive(key, value)


def _choice(*allowed: str) -> Callable[[str, Any], str]:
    def read(key: str, value: Any) -> str:
        if value not in allowed:
            raise _Bad(key, f"'{key}' is {value!r}; it is one of {', '.join(allowed)}.")
        return str(value)

    return read


def _tolerance(table: dict[str, Any]) -> dict[str, Any]:
    return _read(
        table,
        {
            "absolute": _not_negative,
            "relative": _not_negative,
            "direction": _choice(*get_args(DIRECTIONS)),
        },
    )


def _check_tables(table: dict[str, Any], path: str | os.PathLike[str], where: Line) -> None:
    kinds: dict[str, type] = {"suite": dict, "case": list, "retarget": list, "tolerance": dict}
    for key, value in table.items():
        if key not in kinds:
            raise InputError(
                f"unknown key '{key}': known are [suite], [[case]], [[retarget]], "
                "[tolerance.MEASURE].",
                path=path,
                line=where("", 0, key) or where(key, 0, ""),
            )
        entries = value if kinds[key] is list else [value]
        if not isinstance(value, kinds[key]) or not all(isinstance(e, dict) for e in entries):
            written = f"[[{key}]]" if kinds[key] is list else f"[{key}]"
            raise InputError(f"'{key}' must be written as {written}.", path=path,
                             line=where("", 0, key) or where(key, 0, ""))  # fmt: skip
    for name, entry in table.get("tolerance", {}).items():
        if not isinstance(entry, dict):
            raise InputError(f"write [tolerance.MEASURE], '{name}' is a value.", path=path,
                             line=where("tolerance", 0, name))  # fmt: skip


def _guarded(
    read: Callable[[dict[str, Any]], Any],
    entry: dict[str, Any],
    table: str,
    index: int,
    path: str | os.PathLike[str],
    where: Line,
) -> Any:
    try:
        return read(entry)
    except _Bad as bad:
        line = where(table, index, bad.key) or where(table, index, "")
        raise InputError(str(bad), path=path, line=line) from bad


_HEADER = re.compile(r"^\s*\[\[?\s*([^\[\]]+?)\s*\]\]?\s*(?:#.*)?$")
_KEY = re.compile(r"^\s*[\"']?([\w.-]+)[\"']?\s*=")


def _line_finder(text: str) -> Line:
    """Line of a key ('' for its header) in the n-th table of a name; tomllib keeps no lines."""
    places: dict[tuple[str, int, str], int] = {}
    seen: dict[str, int] = {}
    table, index = "", 0
    for number, line in enumerate(text.splitlines(), 1):
        header, key = _HEADER.match(line), _KEY.match(line)
        if header:
            table = header[1]
            index = seen[table] = seen.get(table, -1) + 1
            places.setdefault((table, index, ""), number)
        elif key:
            places.setdefault((table, index, key[1]), number)
    return lambda table, index, key: places.get((table, index, key))
