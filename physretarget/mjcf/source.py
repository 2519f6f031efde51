"""The text of an MJCF file and what it refers to: read and hashed.

MuJoCo compiles whatever a file names: meshes by any path, plugins, textures of any size. What
a stranger's file may name is for :mod:`physretarget.sandbox.mjcf` to say, before it is read here.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.parsers import expat

from physretarget.errors import InputError, UnsafeInputError
from physretarget.sandbox.limits import Limits
from physretarget.sandbox.mjcf import check_file

__all__ = ["Element", "Source", "read_source", "source_of_text"]

MAX_XML_BYTES = 8 * 2**20  # the largest model of the MuJoCo Menagerie is well below 1 MiB
MAX_ELEMENTS = 50_000
MAX_DEPTH = 400
MAX_INCLUDES = 64

_DIRECTORY = {
    "mesh": "meshdir",
    "skin": "meshdir",
    "hfield": "meshdir",
    "texture": "texturedir",
    "model": "assetdir",  # a model to attach; what it names in turn is not followed
}


@dataclass(frozen=True)
class Element:
    """One start tag: its name, attributes and the line it stands on (from 1)."""

    tag: str
    attributes: dict[str, str]
    line: int
    path: Path | None = None


@dataclass(frozen=True)
class Source:
    """An MJCF text with everything it refers to.

    ``sha256`` covers the text, included files and assets, so that two characters with the same
    hash compile to the same model. ``elements`` is empty for XML that expat cannot read.
    """

    text: str
    path: Path | None
    elements: tuple[Element, ...]
    assets: tuple[Path, ...]
    sha256: str
    notes: tuple[str, ...] = ()


def read_source(path: Path, *, untrusted: bool = False) -> Source:
    """Read an MJCF file, following its includes.

    An ``untrusted`` one is checked first, as an upload is.

    Raises:
        InputError: the file is missing, unreadable, empty or not text, or names a missing asset.
        UnsafeInputError: it is larger than any model, or untrusted and refused.
    """
    if untrusted:
        check_file(path, Limits())
    return _source(_text(path), path)


def source_of_text(text: str) -> Source:
    """Wrap an MJCF text that stands in no file; file names in it are relative to nothing."""
    return _source(text, None)


def _text(path: Path) -> str:
    try:
        size = path.stat().st_size
        if size > MAX_XML_BYTES:
            raise UnsafeInputError(
                f"the XML has {size} bytes, at most {MAX_XML_BYTES} are read", path=path
            )
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"not a text file (byte {error.start} is no UTF-8)", path=path) from error
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror or error}", path=path) from error
    if not text.strip():
        raise InputError("the file is empty, an MJCF model was expected", path=path)
    return text


def _source(text: str, path: Path | None) -> Source:
    folder = (path.parent if path else Path()).resolve()
    digest = hashlib.sha256(text.encode())
    try:
        elements = _parse(text, path)
        elements += list(_includes(elements, path, folder, digest))
    except _NotWellFormed as error:
        note = f"line {error.line} is no well-formed XML ({error}); assets are not in the hash"
        return Source(text, path, (), (), digest.hexdigest(), (note,))
    assets = tuple(_assets(elements, folder))
    for asset in assets:
        digest.update(asset.name.encode() + b"\0" + asset.read_bytes())
    return Source(text, path, tuple(elements), assets, digest.hexdigest())


class _NotWellFormed(Exception):
    """Expat could not read it; MuJoCo's own parser is laxer (``--`` in comments) and may."""

    def __init__(self, message: str, line: int) -> None:
        super().__init__(message)
        self.line = line


def _parse(text: str, path: Path | None) -> list[Element]:
    parser = expat.ParserCreate("utf-8")
    elements: list[Element] = []
    depth = 0

    def refuse(*_: object) -> None:
        raise UnsafeInputError(
            "entities are refused in a model",
            path=path,
            line=parser.CurrentLineNumber,
        )

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        elements.append(Element(tag, attributes, parser.CurrentLineNumber, path))
        if depth > MAX_DEPTH or len(elements) > MAX_ELEMENTS:
            raise UnsafeInputError(
                f"more than {MAX_ELEMENTS} elements, or nested deeper than {MAX_DEPTH}",
                path=path,
                line=parser.CurrentLineNumber,
            )

    def end(_: str) -> None:
        nonlocal depth
        depth -= 1

    parser.EntityDeclHandler = refuse  # MuJoCo expands none, so nothing useful is lost
    parser.StartElementHandler = start
    parser.EndElementHandler = end
    try:
        parser.Parse(text.encode(), True)
    except expat.ExpatError as error:
        raise _NotWellFormed(
            f"broken XML: {expat.ErrorString(error.code)}", error.lineno
        ) from error
    return elements


def _includes(
    elements: list[Element],
    path: Path | None,
    folder: Path,
    digest: hashlib._Hash,
) -> Iterator[Element]:
    """Elements of the files included, breadth first. MuJoCo admits each file once."""
    waiting = [element for element in elements if element.tag == "include"]
    seen = 0
    while waiting:
        element = waiting.pop(0)
        seen += 1
        if seen > MAX_INCLUDES:
            raise UnsafeInputError(f"more than {MAX_INCLUDES} included files", path=path)
        beside = element.path.parent.resolve() if element.path else folder
        name = element.attributes.get("file", "")
        file = _resolve(element, name, [beside, folder])
        text = _text(file)
        digest.update(file.name.encode() + b"\0" + text.encode())
        inner = _parse(text, file)
        waiting += [each for each in inner if each.tag == "include"]
        yield from inner


def _assets(elements: list[Element], folder: Path) -> Iterator[Path]:
    compiler: dict[str, str] = {}
    for element in elements:
        if element.tag == "compiler":
            compiler |= element.attributes
    strip = compiler.get("strippath") == "true"
    for element in elements:
        if element.tag not in _DIRECTORY:
            continue
        below = compiler.get(_DIRECTORY[element.tag], compiler.get("assetdir", ""))
        for name, value in element.attributes.items():
            if not name.startswith("file") or not value:
                continue
            value = value.replace("\\", "/").rsplit("/", 1)[-1] if strip else value
            beside = element.path.parent.resolve() if element.path else folder
            yield _resolve(element, value, [folder / below, beside / below, folder, beside])


def _resolve(element: Element, name: str, places: list[Path]) -> Path:
    """Find the file that an element names in the first of the places that has it."""
    for place in places:
        if (place / name).is_file():
            return (place / name).resolve()
    label = element.attributes.get("name")
    label = f"{element.tag} {label!r}" if label else element.tag
    raise InputError(
        f"{label} names the file {name!r}, which does not exist",
        path=element.path,
        line=element.line,
    )
