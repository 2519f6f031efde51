"""Multipart bodies, streamed to disk under bounds that run along.

The framework's own reader keeps files in a temporary folder of its own and bounds only their
number, so python-multipart's parser is driven here: every byte is counted as it comes.
"""

from __future__ import annotations

import asyncio
import hashlib
import os
import secrets
import time
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, Literal

from anyio import CapacityLimiter, to_thread
from fastapi import Request
from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser, parse_options_header
from starlette.requests import ClientDisconnect

from physretarget.service.errors import ApiError
from physretarget.service.state import free_bytes

FIELD_BYTES = 256 * 1024
PARTS = 64
NAME_BYTES = 200
_LINGER_S, _LINGER_BYTES = 2.0, 64 * 2**20
_GRACE_S = 20.0  # before the rate of an upload is looked at
_OVERHEAD = 1024 * 1024  # of a body besides its files: fields, headers, boundaries
_NEW = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
_threads = CapacityLimiter(6)


@dataclass(frozen=True, kw_only=True)
class Upload:
    """A file of a form, on disk under its final content address or still beside it."""

    name: str
    path: Path
    sha256: str
    bytes: int


@dataclass(frozen=True, kw_only=True)
class Form:
    """A form that was received as a whole."""

    fields: Mapping[str, str]
    files: Mapping[str, tuple[Upload, ...]]

    def file(self, name: str) -> Upload | None:
        """The one file of that name, None where there is none."""
        found = self.files.get(name, ())
        return found[0] if found else None


@dataclass(frozen=True, kw_only=True)
class Bounds:
    """What a form may hold: names of its fields; names of its files and how many of each."""

    fields: frozenset[str]
    files: Mapping[str, int]
    bytes: int
    idle: float
    rate: float


@asynccontextmanager
async def received(
    request: Request, folder: Path, bounds: Bounds, *, reserve: int = 0
) -> AsyncIterator[Form]:
    """The request's form; its files are removed from ``folder`` unless they were moved away.

    Raises:
        ApiError: 413 too much, 415 no form, 422 a part that has no place in it, 408 too slow, 507
            less than ``reserve`` bytes of disk would be left.
    """
    reader = _Reader(_boundary(request), folder, bounds)
    try:
        try:
            _check_length(request, bounds)
            _check_disk(request, folder, reserve)
            await _feed(request, reader, bounds)
            form = await to_thread.run_sync(reader.form, limiter=_threads)
        except ApiError:
            await _linger(request)
            raise
        yield form
    finally:
        reader.close()


def _boundary(request: Request) -> bytes:
    kind, options = parse_options_header(request.headers.get("content-type", ""))
    if kind != b"multipart/form-data":
        raise ApiError(415, "The body must be multipart/form-data.", field="Content-Type")
    if not options.get(b"boundary"):
        raise ApiError(422, "The multipart body's boundary is missing.", field="Content-Type")
    return options[b"boundary"]


def _check_length(request: Request, bounds: Bounds) -> None:
    told = request.headers.get("content-length", "")
    if told.isdigit() and int(told) > _most(bounds):
        raise _too_large(bounds)


def _check_disk(request: Request, folder: Path, reserve: int) -> None:
    told = request.headers.get("content-length", "")
    coming = int(told) if told.isdecimal() and len(told) < 20 else 0
    if free_bytes(folder) - coming < reserve:
        raise ApiError(
            507,
            "The service's disk is full: delete jobs or clips, or make room, and send it again.",
        )


def _most(bounds: Bounds) -> int:
    return bounds.bytes * max(1, len(bounds.files)) + _OVERHEAD


def _too_large(bounds: Bounds) -> ApiError:
    return ApiError(413, f"A file may have {bounds.bytes} bytes, no more are accepted.")


async def _feed(request: Request, reader: _Reader, bounds: Bounds) -> None:
    stream = request.stream().__aiter__()
    began = time.monotonic()
    while True:
        try:
            chunk = await asyncio.wait_for(anext(stream), bounds.idle)
        except StopAsyncIteration:
            return
        except TimeoutError as error:
            raise ApiError(408, f"Nothing came for {bounds.idle:g} s.") from error
        except ClientDisconnect as error:
            raise ApiError(400, "The client went away.") from error
        # In a thread: a body made to be slow to parse must not keep others waiting.
        await to_thread.run_sync(reader.feed, chunk, limiter=_threads)
        passed = time.monotonic() - began
        if passed > _GRACE_S and reader.total < bounds.rate * passed:
            raise ApiError(408, f"Less than {bounds.rate:g} bytes per second came.")


async def _linger(request: Request) -> None:
    """Take in some of what is still being sent, or the client would never read our answer."""
    left, until = _LINGER_BYTES, time.monotonic() + _LINGER_S
    try:
        async with asyncio.timeout_at(asyncio.get_running_loop().time() + _LINGER_S):
            async for chunk in request.stream():
                left -= len(chunk)
                if left < 0 or time.monotonic() > until:
                    return
    except (TimeoutError, ClientDisconnect, RuntimeError):
        return


@dataclass
class _Part:
    name: str
    kind: Literal["field", "file"]
    filename: str = ""
    text: bytearray = field(default_factory=bytearray)
    path: Path | None = None
    file: BinaryIO | None = None
    digest: hashlib._Hash = field(default_factory=hashlib.sha256)
    bytes: int = 0


class _Reader:
    """Turns the parser's callbacks into fields and files."""

    def __init__(self, boundary: bytes, folder: Path, bounds: Bounds) -> None:
        self.total = 0
        self._folder = folder
        self._bounds = bounds
        self._fields: dict[str, str] = {}
        self._files: dict[str, list[Upload]] = {}
        self._made: list[Path] = []
        self._part: _Part | None = None
        self._headers: dict[bytes, bytes] = {}
        self._header = [b"", b""]
        self._parts = 0
        self._ended = False
        try:
            self._parser = MultipartParser(
                boundary,
                {
                    "on_part_begin": self._begin,
                    "on_part_data": self._data,
                    "on_part_end": self._end,
                    "on_header_field": lambda d, s, e: self._grow(0, d[s:e]),
                    "on_header_value": lambda d, s, e: self._grow(1, d[s:e]),
                    "on_header_end": self._header_end,
                    "on_headers_finished": self._opened,
                    "on_end": self._finished,
                },
            )
        except FormParserError as error:
            raise ApiError(422, "The multipart body's boundary is not usable.") from error

    def feed(self, chunk: bytes) -> None:
        self.total += len(chunk)
        if self.total > _most(self._bounds):
            raise _too_large(self._bounds)
        try:
            self._parser.write(chunk)
        except FormParserError as error:
            raise ApiError(422, "The multipart body is broken.") from error

    def form(self) -> Form:
        if not self._ended:
            raise ApiError(422, "The multipart body ends before its last boundary.")
        return Form(
            fields=self._fields, files={name: tuple(each) for name, each in self._files.items()}
        )

    def close(self) -> None:
        if self._part is not None and self._part.file is not None:
            self._part.file.close()
        for path in self._made:
            path.unlink(missing_ok=True)

    # ---- callbacks -----------------------------------------------------------------------------

    def _begin(self) -> None:
        self._parts += 1
        if self._parts > PARTS:
            raise ApiError(413, f"A form may have {PARTS} parts.")
        self._headers = {}

    def _grow(self, which: int, content: bytes) -> None:
        self._header[which] += content

    def _header_end(self) -> None:
        self._headers[self._header[0].lower()] = self._header[1]
        self._header = [b"", b""]

    def _opened(self) -> None:
        _, options = parse_options_header(self._headers.get(b"content-disposition", b""))
        name = options.get(b"name", b"").decode("utf-8", "replace")
        filename = options.get(b"filename")
        if name in self._bounds.files and filename is not None:
            if len(self._files.get(name, ())) >= self._bounds.files[name]:
                raise ApiError(422, "There are more files of that name than allowed.", field=name)
            path = self._folder / f"upload-{secrets.token_hex(12)}"
            self._part = _Part(name=name, kind="file", filename=_safe(filename), path=path)
            self._made.append(path)
            self._part.file = os.fdopen(os.open(path, _NEW, 0o600), "wb")
        elif name in self._bounds.fields and filename is None:
            if name in self._fields:
                raise ApiError(422, "The field is there twice.", field=name)
            self._part = _Part(name=name, kind="field")
        else:
            raise ApiError(422, self._misplaced(name, filename is not None), field=_printable(name))

    def _misplaced(self, name: str, is_file: bool) -> str:
        if name in self._bounds.files:
            return "The part must be a file (it has no filename)."
        if name in self._bounds.fields:
            return "The part must be a plain field (it has a filename)."
        known = ", ".join(sorted({*self._bounds.fields, *self._bounds.files}))
        return f"There is no such {'file' if is_file else 'field'}; there are {known}."

    def _data(self, data: bytes, start: int, end: int) -> None:
        part = self._part
        assert part is not None
        part.bytes += end - start
        if part.file is None:
            if part.bytes > FIELD_BYTES:
                raise ApiError(413, f"A field may have {FIELD_BYTES} bytes.", field=part.name)
            part.text += data[start:end]
            return
        if part.bytes > self._bounds.bytes:
            raise _too_large(self._bounds)
        content = memoryview(data)[start:end]
        part.digest.update(content)
        part.file.write(content)

    def _end(self) -> None:
        part, self._part = self._part, None
        assert part is not None
        if part.file is None:
            try:
                self._fields[part.name] = part.text.decode("utf-8")
            except UnicodeDecodeError as error:
                raise ApiError(422, "The field is not UTF-8.", field=part.name) from error
            return
        part.file.close()
        assert part.path is not None
        self._files.setdefault(part.name, []).append(
            Upload(
                name=part.filename, path=part.path, sha256=part.digest.hexdigest(),
                bytes=part.bytes,
            )
        )  # fmt: skip

    def _finished(self) -> None:
        self._ended = True


def _safe(filename: bytes) -> str:
    """The last part of a client's file name, printable, never empty."""
    name = filename.decode("utf-8", "replace").replace("\\", "/").rpartition("/")[2]
    kept = _printable(name).strip(" .")
    stem, dot, suffix = kept.rpartition(".")
    if not dot or len(suffix) > 16:
        return _cut(kept, NAME_BYTES) or "unnamed"
    return f"{_cut(stem, NAME_BYTES - len(suffix.encode()) - 1)}.{suffix}"


def _cut(text: str, most: int) -> str:
    """As many characters as fit into so many bytes: folders count bytes."""
    return text.encode()[:most].decode("utf-8", "ignore")


def _printable(text: str) -> str:
    return "".join(c if c.isprintable() else "_" for c in text)[:1000]
