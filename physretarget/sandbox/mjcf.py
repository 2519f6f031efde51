"""A stranger's model, looked at before MuJoCo sees it.

MuJoCo opens whatever a file names and allocates whatever it asks for. Here the XML is read by
expat, which resolves nothing; every word must be known (:mod:`.vocabulary`), every file lie
inside the upload with a header that is true (:mod:`.assets`), and what it all comes to must be
bounded (:mod:`.bounds`).

Two parsers read the same text, expat here and tinyxml2 in MuJoCo. Where they could differ
(codings, document types, processing instructions, XML that is not well-formed) it is refused.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import NoReturn
from xml.parsers import expat

from physretarget.errors import InputError, UnsafeInputError
from physretarget.sandbox.archive import printable
from physretarget.sandbox.assets import CONTENT_TYPES, SUFFIXES, check_asset
from physretarget.sandbox.bounds import Budget, numbers_of
from physretarget.sandbox.limits import Limits
from physretarget.sandbox.vocabulary import (
    ATTRIBUTES,
    ELEMENTS,
    FILE_ATTRIBUTES,
    FOLDER_ATTRIBUTES,
    REFUSED_ELEMENTS,
)

MODEL_SUFFIXES = (".xml", ".mjcf")
_CODINGS = (None, "utf-8", "us-ascii", "ascii")
_NAME_BYTES = 1024
_FOLDERS = 32  # different folders that compilers may name
_MULTIPLYING = {"replicate": "count"}


def check_model(root: Path, main: Path, limits: Limits) -> None:
    """Check a model and everything that it names.

    Args:
        root: the folder of the upload; nothing outside is looked at.
        main: the model, in this folder or below.
        limits: bounds.

    Raises:
        InputError: it is no MJCF model, or names a file that was not uploaded.
        UnsafeInputError: it tries to reach outside, to load code, or to exhaust something.
    """
    root = root.resolve(strict=True)
    main = root / main
    _check_tree(root, limits)
    if not _inside(main, root) or not main.is_file() or main.suffix.lower() not in MODEL_SUFFIXES:
        raise InputError(
            f"is no model file of the upload ({', '.join(MODEL_SUFFIXES)}).", path=main
        )
    _check(root, main, limits)


def check_file(main: Path, limits: Limits) -> None:
    """The same for a model that lies among other files: it may name those of its folder.

    Raises as :func:`check_model`.
    """
    if not main.is_file():
        raise InputError("there is no such file, or it is a folder.", path=main)
    main = main.resolve()
    _check(main.parent, main, limits)


def _check(root: Path, main: Path, limits: Limits) -> None:
    reading = _Reading(root, main, limits)
    reading.read(_real(main), times=1)
    wrong = reading.budget.total()
    if wrong:
        raise UnsafeInputError(f"{wrong}.", path=main)
    for reference in reading.references:
        reading.check_reference(reference)


def _check_tree(root: Path, limits: Limits) -> None:
    """Plain files and folders only: then a path inside the folder leads inside the folder."""
    count = 0
    for folder, folders, files in os.walk(root):
        count += len(folders) + len(files)
        if count > limits.archive_files:
            raise UnsafeInputError(f"has more than {limits.archive_files} files.", path=root)
        for name in (*folders, *files):
            path = Path(folder, name)
            mode = path.lstat().st_mode
            if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
                raise UnsafeInputError("is neither a file nor a folder.", path=path)


def _real(path: Path) -> Path:
    """Where a path leads, as MuJoCo will open it: without ``..``, links followed."""
    return Path(os.path.realpath(path))


def _inside(path: Path, root: Path) -> bool:
    return _real(path).is_relative_to(root)


@dataclass(frozen=True)
class _Reference:
    """One attribute that names a file."""

    element: str
    attribute: str
    value: str
    content_type: str | None
    file: Path
    line: int


class _Reading:
    """One model with the files that it includes."""

    def __init__(self, root: Path, main: Path, limits: Limits) -> None:
        self._root = root
        self._main = _real(main)
        self._limits = limits
        self._seen: set[Path] = set()
        self._bytes = 0
        self._assets = 0
        self._checked: set[tuple[Path, str]] = set()
        self._folders = {""}
        self.budget = Budget(limits)
        self.references: list[_Reference] = []

    def read(self, file: Path, *, times: int) -> None:
        """Read a file that stands within so many repetitions, and what it includes."""
        if file in self._seen:
            raise UnsafeInputError("is included twice, or includes itself.", path=file)
        self._seen.add(file)
        if len(self._seen) > self._limits.xml_includes + 1:
            raise UnsafeInputError(
                f"more than {self._limits.xml_includes} files are included.", path=self._main
            )
        for inner, repeated in _File(self, file, times).parse(self._text(file)):
            self.read(inner, times=repeated)

    def _text(self, file: Path) -> bytes:
        self._bytes += file.stat().st_size
        if self._bytes > self._limits.xml_bytes:
            raise UnsafeInputError(
                f"its XML takes more than {self._limits.xml_bytes} bytes.", path=self._main
            )
        content = file.read_bytes()
        if b"\0" in content:
            raise UnsafeInputError("holds NUL bytes, or is UTF-16: UTF-8 is read.", path=file)
        try:
            content.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            raise InputError(f"is no UTF-8 text (byte {error.start}).", path=file) from error
        if not content.strip():
            raise InputError("the file is empty, an MJCF model was expected.", path=file)
        return content

    def included(self, reference: _Reference) -> Path:
        """The file that an include names."""
        found = {*self._found(reference, [""])}
        # MuJoCo looks beside the file or beside the model: both must not exist and differ.
        if len(found) > 1:
            raise UnsafeInputError(
                f"include {printable(reference.value)} may mean two files.",
                path=reference.file,
                line=reference.line,
            )
        return found.pop()

    def add_folder(self, value: str, file: Path, line: int) -> None:
        """A folder that a compiler names: it matters once a file is looked for in it."""
        self._folders.add(value)
        if len(self._folders) > _FOLDERS:
            raise UnsafeInputError(f"names more than {_FOLDERS} folders.", path=file, line=line)

    def check_reference(self, reference: _Reference) -> None:
        """Every place where MuJoCo may look lies inside; every file there is what it claims."""
        if reference.content_type is not None:
            expected = CONTENT_TYPES.get(Path(reference.value).suffix.lower())
            if reference.content_type != expected:
                raise UnsafeInputError(
                    f"content type {printable(reference.content_type)} is not that of "
                    f"{printable(reference.value)}.",
                    path=reference.file,
                    line=reference.line,
                )
        for path in self._found(reference, sorted(self._folders)):
            if (path, reference.element) in self._checked:
                continue
            self._checked.add((path, reference.element))
            self._assets += path.stat().st_size
            if self._assets > self._limits.asset_bytes:
                raise UnsafeInputError(
                    f"its files take more than {self._limits.asset_bytes} bytes.", path=self._main
                )
            check_asset(path, reference.element, self._limits)

    def _found(self, reference: _Reference, folders: list[str]) -> set[Path]:
        """The existing files that a reference may mean, all of them inside."""
        value, file, line = reference.value, reference.file, reference.line
        self._check_name(value, reference.element, file, line)
        values = {value, value.rsplit("/", 1)[-1]}  # with ``strippath`` the last part only
        bases = {file.parent, self._main.parent}
        places = [base / folder / v for base, folder, v in product(bases, folders, values)]
        for place in places:
            self._check_inside(place, value, file, line)
        found = {_real(place) for place in places if place.is_file()}
        if not found:
            raise InputError(
                f"{reference.element} names the file {printable(value)}, "
                "which is not in the upload.",
                path=file,
                line=line,
            )
        return found

    def _check_name(self, value: str, what: str, file: Path, line: int) -> None:
        if (
            value.startswith(("/", "~"))
            or any(c in value for c in "\\:")
            or not value.isprintable()
            or len(value.encode()) > self._limits.name_bytes
        ):
            raise UnsafeInputError(
                f"{what} {printable(value)} is no plain relative name.", path=file, line=line
            )

    def _check_inside(self, place: Path, value: str, file: Path, line: int) -> None:
        if not _inside(place, self._root):
            raise UnsafeInputError(
                f"{printable(value)} lies outside the upload.", path=file, line=line
            )


class _File:
    """One XML file: its elements counted, its references collected."""

    def __init__(self, reading: _Reading, file: Path, times: int) -> None:
        self._reading = reading
        self._limits = reading._limits
        self._file = file
        self._parser = expat.ParserCreate("utf-8")
        self._parser.buffer_text = True
        self._repeats = [times]  # of each open element
        self._includes: list[tuple[Path, int]] = []

    def parse(self, content: bytes) -> Iterator[tuple[Path, int]]:
        """The files included, each with how often it is repeated."""
        parser = self._parser
        parser.XmlDeclHandler = self._declaration
        parser.StartDoctypeDeclHandler = lambda *_: self._refuse("a document type is refused")
        parser.EntityDeclHandler = lambda *_: self._refuse("an entity is refused")
        parser.ProcessingInstructionHandler = lambda *_: self._refuse(
            "a processing instruction is refused"
        )
        parser.StartElementHandler = self._start
        parser.EndElementHandler = lambda _: self._repeats.pop()
        try:
            parser.Parse(content, True)
        except expat.ExpatError as error:
            raise InputError(
                f"broken XML: {expat.ErrorString(error.code)}.", path=self._file, line=error.lineno
            ) from error
        yield from self._includes

    def _refuse(self, why: str) -> NoReturn:
        raise UnsafeInputError(f"{why}.", path=self._file, line=self._parser.CurrentLineNumber)

    def _declaration(self, version: str, coding: str | None, standalone: int) -> None:
        if (coding.lower() if coding else None) not in _CODINGS:
            self._refuse(f"coding {printable(str(coding))} is refused, UTF-8 is read")

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        if len(self._repeats) == 1 and tag not in ("mujoco", "mujocoinclude"):
            raise InputError(
                f"the root element is {printable(tag)}, <mujoco> was expected.",
                path=self._file,
                line=self._parser.CurrentLineNumber,
            )
        if len(self._repeats) > self._limits.xml_depth:
            self._refuse(f"elements are nested deeper than {self._limits.xml_depth}")
        self._check_words(tag, attributes)
        times = self._repeats[-1]
        wrong = self._reading.budget.add(tag, attributes, times)
        if wrong:
            self._refuse(f"<{tag}>: {wrong}")
        if tag in _MULTIPLYING:
            times *= self._count(attributes.get(_MULTIPLYING[tag], "1"))
        self._repeats.append(times)
        self._collect(tag, attributes, times)

    def _check_words(self, tag: str, attributes: dict[str, str]) -> None:
        if tag in REFUSED_ELEMENTS:
            self._refuse(f"<{tag}> is refused in a model that is uploaded")
        if tag not in ELEMENTS:
            self._refuse(f"{printable(tag)} is no element that is known here")
        for name, value in attributes.items():
            if name not in ATTRIBUTES:
                self._refuse(f"<{tag}> has {printable(name)}, no attribute that is known here")
            most = _NAME_BYTES if name in ("name", "class") else self._limits.xml_attribute_bytes
            if len(value.encode("utf-8", "surrogatepass")) > most:
                self._refuse(f"<{tag} {name}> is longer than {most} bytes")

    def _count(self, text: str) -> int:
        numbers = numbers_of(text)
        if not numbers or not 0 <= numbers[0] <= self._limits.xml_elements:
            self._refuse(f"count {printable(text)} is refused")
        return max(1, int(numbers[0]))

    def _collect(self, tag: str, attributes: dict[str, str], times: int) -> None:
        line = self._parser.CurrentLineNumber
        for name in sorted(FOLDER_ATTRIBUTES & set(attributes)):
            self._reading.add_folder(attributes[name], self._file, line)
        for name in sorted(FILE_ATTRIBUTES & set(attributes)):
            if tag != "include" and tag not in SUFFIXES:
                self._refuse(f"<{tag}> may name no file")
            kind = attributes.get("content_type")
            reference = _Reference(tag, name, attributes[name], kind, self._file, line)
            if tag == "include":
                self._includes.append((self._reading.included(reference), times))
            else:
                self._reading.references.append(reference)
        if tag == "include" and "file" not in attributes:
            self._refuse("<include> names no file")
