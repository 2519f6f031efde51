"""The text of an MJCF file: read, hashed, and refused where it is not to be trusted.

MuJoCo compiles whatever a file names: meshes by any path, plugins, textures of any size. A
file from a stranger is therefore read here first, by expat, which resolves no external
entities; nothing that it names is opened before the checks have passed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.parsers import expat

from physretarget.errors import InputError, UnsafeInputError
from physretarget.sandbox.bounds import SIZES

__all__ = ["Element", "Source", "read_source", "source_of_text"]

MAX_XML_BYTES = 8 * 2**20  # the largest model of the MuJoCo Menagerie is well below 1 MiB
MAX_ASSET_BYTES = 256 * 2**20
MAX_ELEMENTS = 50_000
MAX_DEPTH = 400
MAX_INCLUDES = 64

# Elements that load code, run simulations while compiling, or multiply other elements.
_REFUSED_ELEMENTS = frozenset(
    {"plugin", "extension", "replicate", "composite", "flexcomp", "lengthrange", "attach", "model"}
)
_BOUNDED_ANYWHERE = {"nsample": 10_000, "num": 10_000}
_BOUNDED_PREFIX = {"nuser_": 10_000}
_UNITS = {"K": 2**10, "M": 2**20, "G": 2**30, "T": 2**40, "P": 2**50, "E": 2**60}
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

    ``untrusted`` refuses document types and entities, files outside the model's folder, plugins,
    elements that multiply, and sizes beyond any sensible model.

    Raises:
        InputError: the file is missing, unreadable, empty or not text, or names a missing asset.
        UnsafeInputError: the file is untrusted and asks for one of the above.
    """
    text = _text(path)
    return _source(text, path, untrusted=untrusted)


def source_of_text(text: str, *, untrusted: bool = False) -> Source:
    """Wrap an MJCF text that stands in no file; file names in it are relative to nothing."""
    if untrusted and len(text) > MAX_XML_BYTES:
        raise UnsafeInputError(f"the XML has {len(text)} bytes, at most {MAX_XML_BYTES} are read")
    return _source(text, None, untrusted=untrusted)


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


def _source(text: str, path: Path | None, *, untrusted: bool) -> Source:
    folder = (path.parent if path else Path()).resolve()
    digest = hashlib.sha256(text.encode())
    try:
        elements = _parse(text, path, untrusted=untrusted)
        elements += list(_includes(elements, path, folder, digest, untrusted=untrusted))
    except _NotWellFormed as error:
        if untrusted:
            raise InputError(str(error), path=path, line=error.line) from error
        note = f"line {error.line} is no well-formed XML ({error}); assets are not in the hash"
        return Source(text, path, (), (), digest.hexdigest(), (note,))
    if untrusted:
        _check(elements)
    assets = tuple(_assets(elements, folder, untrusted=untrusted))
    for asset in assets:
        digest.update(asset.name.encode() + b"\0" + asset.read_bytes())
    return Source(text, path, tuple(elements), assets, digest.hexdigest())


class _NotWellFormed(Exception):
    """Expat could not read it; MuJoCo's own parser is laxer (``--`` in comments) and may."""

    def __init__(self, message: str, line: int) -> None:
        super().__init__(message)
        self.line = line


def _parse(text: str, path: Path | None, *, untrusted: bool) -> list[Element]:
    parser = expat.ParserCreate("utf-8")
    elements: list[Element] = []
    depth = 0

    def refuse(*_: object) -> None:
        raise UnsafeInputError(
            "document types and entities are refused in a model",
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
    if untrusted:
        parser.StartDoctypeDeclHandler = refuse
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
    *,
    untrusted: bool,
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
        file = _resolve(element, name, [beside, folder], folder, untrusted)
        text = _text(file)
        digest.update(file.name.encode() + b"\0" + text.encode())
        inner = _parse(text, file, untrusted=untrusted)
        waiting += [each for each in inner if each.tag == "include"]
        yield from inner


def _assets(elements: list[Element], folder: Path, *, untrusted: bool) -> Iterator[Path]:
    compiler: dict[str, str] = {}
    for element in elements:
        if element.tag == "compiler":
            compiler |= element.attributes
    strip = compiler.get("strippath") == "true"
    total = 0
    for element in elements:
        if element.tag not in _DIRECTORY:
            continue
        below = compiler.get(_DIRECTORY[element.tag], compiler.get("assetdir", ""))
        for name, value in element.attributes.items():
            if not name.startswith("file") or not value:
                continue
            value = value.replace("\\", "/").rsplit("/", 1)[-1] if strip else value
            beside = element.path.parent.resolve() if element.path else folder
            file = _resolve(
                element, value, [folder / below, beside / below, folder, beside], folder, untrusted
            )
            total += file.stat().st_size
            if untrusted and total > MAX_ASSET_BYTES:
                raise UnsafeInputError(
                    f"its assets take more than {MAX_ASSET_BYTES} bytes", path=element.path
                )
            yield file


def _resolve(
    element: Element, name: str, places: list[Path], folder: Path, untrusted: bool
) -> Path:
    """Find the file that an element names; untrusted ones must stay in the model's folder."""
    path, line = element.path, element.line
    if untrusted:
        if ":" in name or "\0" in name:
            raise UnsafeInputError(
                f"{element.tag} file {name!r} is no plain file name", path=path, line=line
            )
        for place in places:
            if not (place / name).resolve().is_relative_to(folder):
                raise UnsafeInputError(
                    f"{element.tag} file {name!r} lies outside the model's folder",
                    path=path,
                    line=line,
                )
    for place in places:
        if (place / name).is_file():
            return (place / name).resolve()
    label = element.attributes.get("name")
    label = f"{element.tag} {label!r}" if label else element.tag
    raise InputError(f"{label} names the file {name!r}, which does not exist", path=path, line=line)


def _check(elements: list[Element]) -> None:
    """Refuse what could run, escape or exhaust something (see the module's tables)."""
    if elements[0].tag != "mujoco":
        raise UnsafeInputError(
            f"the root element is <{elements[0].tag}>, <mujoco> was expected", path=elements[0].path
        )
    for element in elements:
        if element.tag in _REFUSED_ELEMENTS:
            raise UnsafeInputError(
                f"<{element.tag}> is refused in an untrusted model",
                path=element.path,
                line=element.line,
            )
        for name, value in element.attributes.items():
            bound = _bound(element.tag, name)
            if bound is not None and _whole(value) > bound:
                raise UnsafeInputError(
                    f"<{element.tag} {name}> asks for {value}, at most {bound} is allowed",
                    path=element.path,
                    line=element.line,
                )


def _bound(tag: str, name: str) -> int | None:
    for prefix, bound in _BOUNDED_PREFIX.items():
        if name.startswith(prefix):
            return bound
    return SIZES.get((tag, name), _BOUNDED_ANYWHERE.get(name))


def _whole(value: str) -> float:
    """A whole number with MuJoCo's optional unit (``64M``); what is none is MuJoCo's to refuse."""
    value = value.strip()
    factor = _UNITS.get(value[-1:].upper(), 1)
    try:
        return max(float(part) for part in value.rstrip("kKmMgGtTpPeE").split()) * factor
    except ValueError:
        return 0.0
