"""npy and npz from strangers: claims of the header are bounded before anything is allocated.

``numpy.load`` allocates what a header claims; here the claim is compared with the bytes that
are there first. Arrays of objects are pickles and go through the restricted unpickler.
"""

from __future__ import annotations

import io
import lzma
import math
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import IO, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from physretarget.archives.pickles import unpickle
from physretarget.errors import InputError, UnsafeInputError

PART = 1024
"""Frames read at a time."""

# One hour of a 100-coordinate character at 1 kHz is 2.9 GB of float64: more is not a clip.
MAX_BYTES = 4 * 1024**3
# Deflate cannot expand by more than 1032:1; a member that claims more lies. What expands that
# much is empty: motion shrinks to a third or so, and 64 MB hold an hour of standing still.
_DEFLATE_RATIO, _LIKELY_RATIO = 1032, 100
_LIKELY_BYTES = 64 << 20
_HEADER_LIMIT = 1 << 16
_LAST_LETTER = 0x10FFFF
# NumPy parses headers as Python literals, those of Python 2 through the tokenizer.
_HEADER_DAMAGE = (
    ValueError, EOFError, SyntaxError, TypeError, RecursionError, OverflowError, MemoryError,
    KeyError, IndexError, tokenize.TokenError,
)  # fmt: skip


@dataclass(frozen=True)
class _Header:
    """What an npy file says about itself, its claims compared with the bytes that follow."""

    shape: tuple[int, ...]
    fortran: bool
    dtype: np.dtype[Any]
    size: int
    room: int


def _header(file: _Stream, *, size: int, path: str, what: str) -> _Header:
    try:
        version = np.lib.format.read_magic(file)
        reader = {
            (1, 0): np.lib.format.read_array_header_1_0,
            (2, 0): np.lib.format.read_array_header_2_0,
        }.get(version)
        if reader is None:
            raise ValueError(f"npy version {version}")
        shape, fortran, dtype = reader(file, max_header_size=_HEADER_LIMIT)
    except _HEADER_DAMAGE as error:
        raise InputError(f"{what} has no readable npy header.", path=path) from error
    if any(n < 0 for n in shape):
        raise InputError(f"{what} claims the shape {shape}.", path=path)
    room = size - file.tell()
    claimed = math.prod(shape) * dtype.itemsize
    if claimed > room and not dtype.hasobject:
        raise InputError(
            f"{what} claims {claimed} bytes {shape}, only {max(room, 0)} bytes follow its header.",
            path=path,
        )
    return _Header(shape, fortran, dtype, claimed, room)


def read_npy(content: bytes | _Stream, *, size: int, path: str, name: str = "") -> NDArray[Any]:
    """Read one array of ``size`` bytes (header included); refuse claims beyond it."""
    file: _Stream = io.BytesIO(content) if isinstance(content, bytes) else content
    what = _called(name)
    header = _header(file, size=size, path=path, what=what)
    if header.dtype.hasobject:
        return _object_array(file.read(header.room), header.shape, path)
    data = _exactly(file, header.size, path=path, what=what)
    if header.size == 0:
        return np.zeros(header.shape if header.dtype.itemsize else (0,), header.dtype)
    flat = np.frombuffer(data, header.dtype)
    return flat.reshape(header.shape, order="F" if header.fortran else "C")


def _called(name: str) -> str:
    return f"array '{name}'" if name else "the array"


def _exactly(file: _Stream, size: int, *, path: str, what: str) -> bytes:
    data = file.read(size)
    if len(data) != size:
        raise InputError(f"{what} is cut off: {len(data)} of {size} bytes.", path=path)
    return data


@dataclass(frozen=True, eq=False)
class Frames:
    """An array of numbers whose first axis are frames, read some frames at a time.

    ``parts`` starts over at every call and gives float64.
    """

    shape: tuple[int, ...]
    parts: Callable[[], Iterator[NDArray[np.float64]]]

    @classmethod
    def of(cls, array: NDArray[np.float64]) -> Frames:
        """Of an array that is there already."""

        def parts() -> Iterator[NDArray[np.float64]]:
            for first in range(0, len(array), PART):
                yield array[first : first + PART]

        return cls(array.shape, parts)


def npy_frames(
    opened: Callable[[], _Stream], *, size: int, ndim: int, path: str, name: str = ""
) -> Frames:
    """The frames of an npy file; ``opened`` gives its bytes from the start, at every call.

    Raises InputError unless it holds numbers of ``ndim`` dimensions that are all there.
    """
    what = _called(name)
    header = _header(opened(), size=size, path=path, what=what)
    if header.dtype.hasobject or header.fortran or not header.shape:
        whole = read_npy(opened(), size=size, path=path, name=name)
        return Frames.of(as_floats(whole, name=name or "qpos", ndim=ndim, path=path))
    check_numbers(header.dtype, header.shape, name=name or "qpos", ndim=ndim, path=path)

    def parts() -> Iterator[NDArray[np.float64]]:
        file = opened()
        _header(file, size=size, path=path, what=what)
        each = math.prod(header.shape[1:])
        for first in range(0, header.shape[0], PART):
            count = min(PART, header.shape[0] - first)
            data = _exactly(file, count * each * header.dtype.itemsize, path=path, what=what)
            flat = np.frombuffer(data, header.dtype) if data else np.zeros(0)
            yield flat.reshape(count, *header.shape[1:]).astype(np.float64)

    return Frames(header.shape, parts)


def _object_array(data: bytes, shape: tuple[int, ...], path: str) -> NDArray[Any]:
    value = unpickle(data, path=path)
    array = np.asarray(value) if isinstance(value, (np.ndarray, list)) else None
    if array is None or array.shape != shape:
        raise UnsafeInputError("a pickled array holds something else than it claims.", path=path)
    return array


class _Stream(Protocol):
    def read(self, size: int = -1, /) -> bytes: ...

    def tell(self) -> int: ...


class Members(Mapping[str, NDArray[Any]]):
    """The arrays of an npz (its bytes, or the open file), each read only when asked for."""

    def __init__(self, content: bytes | IO[bytes], *, path: str) -> None:
        self.path = path
        try:
            self._archive = zipfile.ZipFile(
                io.BytesIO(content) if isinstance(content, bytes) else content
            )
            entries = self._archive.infolist()
        except ZIP_DAMAGE as error:
            raise InputError("is not a readable npz (zip) file.", path=path) from error
        self._entries = {
            entry.filename.removesuffix(".npy"): entry
            for entry in entries
            if entry.filename.endswith(".npy")
        }

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)

    def __contains__(self, name: object) -> bool:
        return name in self._entries  # without reading it

    def __getitem__(self, name: str) -> NDArray[Any]:
        file = self._open(name)
        return read_npy(file, size=self._entries[name].file_size, path=self.path, name=name)

    def frames(self, name: str, *, ndim: int) -> Frames:
        """The named member as float64 of so many dimensions, read some frames at a time.

        Args:
            name: Member of the npz file.
            ndim: Dimensions that it must have.

        Returns:
            The member, read some frames at a time.
        """
        return npy_frames(
            lambda: self._open(name), size=self._entries[name].file_size, ndim=ndim,
            path=self.path, name=name,
        )  # fmt: skip

    def _open(self, name: str) -> _Member:
        entry = self._entries[name]
        likely = max(_LIKELY_BYTES, _LIKELY_RATIO * entry.compress_size)
        limit = min(MAX_BYTES, likely, (entry.compress_size + 1) * _DEFLATE_RATIO)
        if entry.file_size > limit:
            raise UnsafeInputError(
                f"array '{name}' claims {entry.file_size} bytes, "
                f"at most {limit} are believed of {entry.compress_size} compressed bytes.",
                path=self.path,
            )
        return _Member(lambda: self._archive.open(entry), name=name, path=self.path)

    def floats(self, name: str, *, ndim: int) -> NDArray[np.float64]:
        """The named member as float64 of so many dimensions.

        Args:
            name: Member of the npz file.
            ndim: Dimensions that it must have.

        Returns:
            The array.
        """
        return as_floats(self[name], name=name, ndim=ndim, path=self.path)

    def strings(self, name: str) -> tuple[str, ...]:
        """The named member as a tuple of strings.

        Args:
            name: Member of the npz file.

        Returns:
            The strings.
        """
        array = self[name]
        if array.dtype.kind == "S":
            array = np.char.decode(array, "utf-8", "replace")
        names = texts(array.ravel()) if array.ndim <= 1 else None
        if names is None:
            raise InputError(f"array '{name}' must be a list of names.", path=self.path)
        return names

    def scalar(self, name: str) -> float:
        """The named member as one number.

        Args:
            name: Member of the npz file.

        Returns:
            The number.
        """
        array = self[name]
        if array.size != 1 or array.dtype.kind not in "iufb":
            raise InputError(
                f"array '{name}' must be one number, it has shape {array.shape}.", path=self.path
            )
        return float(array.ravel()[0])


# What zipfile raises of damaged archives; a stranger's compression or a password is NotImplemented
# or Runtime.
ZIP_DAMAGE = (
    zipfile.BadZipFile, EOFError, OSError, NotImplementedError, RuntimeError, ValueError,
    IndexError, struct.error, zlib.error, lzma.LZMAError,
)  # fmt: skip


class _Member:
    """A zip member's stream that says how far it was read (ZipExtFile's tell needs a seek)."""

    def __init__(self, opened: Callable[[], IO[bytes]], *, name: str, path: str) -> None:
        self._name, self._path = name, path
        self._at = 0
        with self._damage():
            self._file = opened()

    def read(self, size: int = -1, /) -> bytes:
        with self._damage():
            data = self._file.read(size)
        self._at += len(data)
        return data

    def tell(self) -> int:
        return self._at

    @contextmanager
    def _damage(self) -> Iterator[None]:
        try:
            yield
        except ZIP_DAMAGE as error:
            raise InputError(
                f"array '{self._name}' is damaged in the file.", path=self._path
            ) from error


def texts(array: NDArray[Any]) -> tuple[str, ...] | None:
    """The texts of a (n,) array; None where there is something else, or no sound text."""
    if array.dtype.kind == "U" and array.dtype.itemsize:
        # NumPy makes texts of any number: what is no letter breaks whoever prints it.
        letters = np.ascontiguousarray(array.astype(array.dtype.newbyteorder("="))).view(np.uint32)
        if letters.max(initial=0) > _LAST_LETTER:
            return None
    values = array.tolist()
    if not all(isinstance(v, str) for v in values):
        return None
    try:
        "".join(values).encode()
    except UnicodeEncodeError:
        return None
    return tuple(values)


def check_numbers(
    dtype: np.dtype[Any], shape: tuple[int, ...], *, name: str, ndim: int, path: str
) -> None:
    """Raise InputError unless these are numbers of so many dimensions."""
    if dtype.kind not in "iufb" or len(shape) != ndim:
        raise InputError(
            f"'{name}' must be {ndim}-dimensional numbers, it is {dtype} of shape {shape}.",
            path=path,
        )


def as_floats(value: Any, *, name: str, ndim: int, path: str) -> NDArray[np.float64]:
    """An array of numbers as float64, its dimensions checked."""
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise InputError(f"'{name}' is not a regular array of numbers.", path=path) from error
    check_numbers(array.dtype, array.shape, name=name, ndim=ndim, path=path)
    return np.ascontiguousarray(array, dtype=np.float64)
