"""Per-frame results of a clip, gathered chunk by chunk and read one name at a time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physretarget.clip.scratch import Scratch

Array = NDArray[np.generic]


class Gathered(Mapping[str, Array]):
    """Arrays by name, whose frames came in parts: in memory while few, on disk beyond.

    Every look-up reads the array anew, so that memory holds what is being worked on and no more.
    """

    def __init__(self) -> None:
        self._scratch = Scratch()
        # Of every name: type, shape of a frame, and place and frames of every part.
        self._kinds: dict[str, tuple[np.dtype[Any], tuple[int, ...]]] = {}
        self._parts: dict[str, list[tuple[int, int]]] = {}

    def add(self, parts: Mapping[str, Array]) -> None:
        """Further frames of some names."""
        for name, part in parts.items():
            self._kinds.setdefault(name, (part.dtype, part.shape[1:]))
            assert self._kinds[name] == (part.dtype, part.shape[1:]), name
            self._parts.setdefault(name, []).append((self._scratch.add(part), len(part)))

    def __getitem__(self, name: str) -> Array:
        parts, (dtype, shape) = self._parts[name], self._kinds[name]
        each = math.prod(shape)
        array = np.empty((sum(frames for _, frames in parts), *shape), dtype)
        first = 0
        for place, frames in parts:
            part = self._scratch.get(place, frames * each, dtype)
            array[first : first + frames] = part.reshape(frames, *shape)
            first += frames
        return array

    def __iter__(self) -> Iterator[str]:
        return iter(self._kinds)

    def __len__(self) -> int:
        return len(self._kinds)


class Shown(Mapping[str, NDArray[np.float32]]):
    """Arrays that are made when they are asked for; a copy in another process holds them all."""

    def __init__(self, makers: Mapping[str, Callable[[], NDArray[np.float32]]]) -> None:
        self._makers = dict(makers)

    def __getitem__(self, name: str) -> NDArray[np.float32]:
        return self._makers[name]()

    def __iter__(self) -> Iterator[str]:
        return iter(self._makers)

    def __len__(self) -> int:
        return len(self._makers)

    def __reduce__(self) -> tuple[type[dict[str, Any]], tuple[dict[str, Any]]]:
        return dict, (dict(self),)
