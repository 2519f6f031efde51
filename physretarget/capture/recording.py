"""What a capture reader returns, whatever the file format: joints or markers over time.

World: metres, seconds, z up, right-handed; time starts at 0 and is uniform.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Source:
    """Where a recording came from and how its numbers were understood."""

    path: str
    sha256: str
    format: str  # "bvh", "amc", "deepmimic", "c3d", "trc"
    unit: str  # the file's length unit: "m", "cm", "mm", "inch", "cmu"
    up: str  # the file's up axis: "x", "y", "z", or with a minus sign
    fps: float  # the file's own frame rate
    frames: int  # frames in the file
    start: float = 0.0  # s, the file's own time of its first frame, where it has one

    @property
    def name(self) -> str:
        """The file's name without its folder."""
        return Path(self.path).name


@dataclass(frozen=True, kw_only=True, eq=False)
class JointRecording:
    """A skeleton's joints over T frames.

    ``parents[j]`` is -1 for a root, else an index below ``j``. ``position`` (T, J, 3) are
    joint centres and ``rotation`` (T, J, 3, 3) the joints' frames (columns = local axes), both
    in the world. What a joint's local axes mean is the file's own business: rest poses are
    not to be trusted. NaN where the file has no number. ``end_sites`` maps an end's name to
    (index of its joint, offset in that joint's frame, metres).
    """

    source: Source
    names: tuple[str, ...]
    parents: tuple[int, ...]
    time: Floats
    position: Floats
    rotation: Floats
    end_sites: Mapping[str, tuple[int, Floats]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class ForcePlate:
    """A force plate: the force that the floor applies to the body, world axes.

    ``corners`` (4, 3) m; ``time`` (N,) s on the recording's clock, at the plate's own rate;
    ``force`` (N, 3) N; ``point`` (N, 3) m, centre of pressure, NaN where unloaded;
    ``free_moment`` (N, 3) N m about that point.
    """

    name: str
    corners: Floats
    time: Floats
    force: Floats
    point: Floats
    free_moment: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class MarkerRecording:
    """Optical markers over T frames: ``position`` (T, M, 3) m, NaN where a marker is missing."""

    source: Source
    labels: tuple[str, ...]
    time: Floats
    position: Floats
    plates: tuple[ForcePlate, ...] = ()
    notes: tuple[str, ...] = ()


class Names(Protocol):
    """What a user says of names; see name_map.py."""

    def of_joints(self, names: Sequence[str], parents: Sequence[int]) -> tuple[str, ...]:
        """Names of a file's joints as the readers know them."""

    def of_markers(self, labels: Sequence[str]) -> tuple[str, ...]:
        """Labels of a file's markers as the readers know them."""


def sha256_of(content: bytes) -> str:
    """The SHA-256 of a file's content, in hexadecimal."""
    return hashlib.sha256(content).hexdigest()
