"""Arrays set aside: in memory while they are few, in a temporary file beyond."""

from __future__ import annotations

import tempfile
import threading
from collections.abc import Iterable, Iterator
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from physretarget.archives.arrays import PART

Floats = NDArray[np.float64]

# Some minutes of a robot's motion: shorter clips never touch a disk.
HELD_BYTES = 4 << 20
_FLOAT = np.dtype(np.float64)


class Scratch:
    """Bytes set aside in the order they come; read back in any order, by several threads too.

    The temporary file has no name and goes with the object, or with the process.
    """

    def __init__(self, held: int | None = None) -> None:
        self._limit = HELD_BYTES if held is None else held
        self._held = bytearray()
        self._file: IO[bytes] | None = None
        self._size = 0
        self._lock = threading.Lock()  # one file position for all readers

    def add(self, array: NDArray[Any]) -> int:
        """Set an array aside; returns where."""
        content = np.ascontiguousarray(array).data.cast("B") if array.size else b""
        place = self._size
        self._size += len(content)
        if self._file is None and self._size > self._limit:
            self._file = tempfile.TemporaryFile(prefix="physretarget-")  # noqa: SIM115
            self._file.write(self._held)
            self._held = bytearray()
        if self._file is None:
            self._held += content
        else:
            with self._lock:
                self._file.seek(place)
                self._file.write(content)
        return place

    def get(self, place: int, count: int, dtype: np.dtype[Any]) -> NDArray[Any]:
        """So many numbers from a place on, as a new array."""
        array = np.empty(count, dtype)
        size = array.nbytes
        if size == 0:
            return array
        into = array.data.cast("B")
        if self._file is None:
            into[:] = self._held[place : place + size]
            return array
        with self._lock:
            self._file.seek(place)
            into[:] = self._file.read(size)
        return array


class Rows:
    """(T, n) numbers of a motion, read by ranges of frames."""

    def __init__(self, parts: Iterable[Floats], width: int) -> None:
        self.width = width
        self._scratch = Scratch()
        self._frames = 0
        for part in parts:
            self._scratch.add(np.asarray(part, dtype=np.float64))
            self._frames += len(part)

    @classmethod
    def of(cls, values: Floats) -> Rows:
        """An array that is there already."""
        return cls((values[i : i + PART] for i in range(0, len(values), PART)), values.shape[1])

    def __len__(self) -> int:
        return self._frames

    @property
    def shape(self) -> tuple[int, int]:
        """(frames, numbers per frame)."""
        return self._frames, self.width

    def between(self, first: int, last: int) -> Floats:
        """(last - first, n) frames first to last - 1, within the motion."""
        first, last = max(0, first), min(last, self._frames)
        count = max(0, last - first)
        flat = self._scratch.get(8 * first * self.width, count * self.width, _FLOAT)
        return flat.reshape(count, self.width)

    def parts(self) -> Iterator[tuple[int, Floats]]:
        """(first frame, some frames) until all were there."""
        for first in range(0, self._frames, PART):
            yield first, self.between(first, first + PART)

    def columns(self, columns: NDArray[np.int64]) -> Floats:
        """(T, k) some columns of all frames."""
        found = np.empty((self._frames, len(columns)))
        for first, part in self.parts():
            found[first : first + len(part)] = part[:, columns]
        return found
