"""npy and npz from strangers: claims of the header are bounded before anything is allocated.

``numpy.load`` allocates what a header claims; here the claim is compared with the bytes that
are there first. Arrays of objects are pickles and go through the restricted unpickler.
"""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Iterator, Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from physretarget.clip.pickles import unpickle
from physretarget.errors import InputError, UnsafeInputError

# One hour of a 100-coordinate character at 1 kHz is 2.9 GB of float64: more is not a clip.
MAX_BYTES = 4 * 1024**3
# Deflate cannot expand by more than 1032:1; a member that claims more lies.
_DEFLATE_RATIO = 1032
_HEADER_LIMIT = 1 << 16


def read_npy(content: bytes | _Stream, *, size: int, path: str, name: str = "") -> NDArray[Any]:
    """Read one array of ``size`` bytes (header included); refuse claims beyond it."""
    file: Any = io.BytesIO(content) if isinstance(content, bytes) else content
    what = f"array '{name}'" if name else "the array"
    try:
        version = np.lib.format.read_magic(file)
        reader = {
            (1, 0): np.lib.format.read_array_header_1_0,
            (2, 0): np.lib.format.read_array_header_2_0,
        }.get(version)
        if reader is None:
            raise ValueError(f"npy version {version}")
        shape, fortran, dtype = reader(file, max_header_size=_HEADER_LIMIT)
    except (ValueError, EOFError, SyntaxError, TypeError, RecursionError, OverflowError) as error:
        raise InputError(f"{what} has no readable npy header.", path=path) from error
    if any(n < 0 for n in shape):
        raise InputError(f"{what} claims the shape {shape}.", path=path)
    room = size - file.tell()
    if dtype.hasobject:
        return _object_array(file.read(room), shape, path)
    claimed = math.prod(shape) * dtype.itemsize
    if claimed > room:
        raise InputError(
            f"{what} claims {claimed} bytes {shape}, only {max(room, 0)} bytes follow its header.",
            path=path,
        )
    data = file.read(claimed)
    if len(data) != claimed:
        raise InputError(f"{what} is cut off: {len(data)} of {claimed} bytes.", path=path)
    if claimed == 0:
        return np.zeros(shape if dtype.itemsize else (0,), dtype)
    flat = np.frombuffer(data, dtype)
    return flat.reshape(shape, order="F" if fortran else "C")


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
    """The arrays of an npz, each read only when asked for."""

    def __init__(self, content: bytes, *, path: str) -> None:
        self.path = path
        try:
            self._archive = zipfile.ZipFile(io.BytesIO(content))
            entries = self._archive.infolist()
        except (zipfile.BadZipFile, ValueError, OSError, NotImplementedError) as error:
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

    def __getitem__(self, name: str) -> NDArray[Any]:
        entry = self._entries[name]
        limit = min(MAX_BYTES, (entry.compress_size + 1) * _DEFLATE_RATIO)
        if entry.file_size > limit:
            raise UnsafeInputError(
                f"array '{name}' claims {entry.file_size} bytes, "
                f"at most {limit} are believed of {entry.compress_size} compressed bytes.",
                path=self.path,
            )
        try:
            with self._archive.open(entry) as file:
                # Checked streams know no end of their own: read_npy compares with the claim.
                return read_npy(_Told(file), size=entry.file_size, path=self.path, name=name)
        except (zipfile.BadZipFile, EOFError, OSError, NotImplementedError, RuntimeError) as error:
            raise InputError(f"array '{name}' is damaged in the file.", path=self.path) from error
        except Exception as error:  # zlib.error has no public base
            if type(error).__module__ in ("zlib", "_lzma", "lzma"):
                raise InputError(f"array '{name}' is damaged.", path=self.path) from error
            raise

    def floats(self, name: str, *, ndim: int) -> NDArray[np.float64]:
        """The named member as float64 of so many dimensions."""
        return as_floats(self[name], name=name, ndim=ndim, path=self.path)

    def strings(self, name: str) -> tuple[str, ...]:
        """The named member as a tuple of strings."""
        array = self[name]
        if array.dtype.kind == "S":
            array = np.char.decode(array, "utf-8", "replace")
        if array.ndim > 1 or not all(isinstance(v, str) for v in array.ravel().tolist()):
            raise InputError(f"array '{name}' must be a list of names.", path=self.path)
        return tuple(array.ravel().tolist())

    def scalar(self, name: str) -> float:
        """The named member as one number."""
        array = self[name]
        if array.size != 1 or array.dtype.kind not in "iufb":
            raise InputError(
                f"array '{name}' must be one number, it has shape {array.shape}.", path=self.path
            )
        return float(array.ravel()[0])


class _Told:
    """A zip member's stream that says how far it was read (ZipExtFile's tell needs a seek)."""

    def __init__(self, file: Any) -> None:
        self._file = file
        self._at = 0

    def read(self, size: int = -1, /) -> bytes:
        data: bytes = self._file.read(size)
        self._at += len(data)
        return data

    def tell(self) -> int:
        return self._at


def as_floats(value: Any, *, name: str, ndim: int, path: str) -> NDArray[np.float64]:
    """An array of numbers as float64, its dimensions checked."""
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise InputError(f"'{name}' is not a regular array of numbers.", path=path) from error
    if array.dtype.kind not in "iufb" or array.ndim != ndim:
        raise InputError(
            f"'{name}' must be {ndim}-dimensional numbers, it is {array.dtype} of shape "
            f"{array.shape}.",
            path=path,
        )
    return np.ascontiguousarray(array, dtype=np.float64)
