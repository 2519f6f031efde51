"""The clip itself and its file: a deterministic npz that is never pickled."""

from __future__ import annotations

import json
import os
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physretarget.clip.scratch import Rows
from physretarget.errors import InputError
from physretarget.files import npz_bytes, write_file

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion(ABC):
    """What a clip says, however its poses are kept.

    ``time`` (T,) s strictly increasing. ``contact_active`` (T, nc) says, where it is known,
    which of the ``contact_points`` stand. ``meta`` is JSON-able: tool version, inputs with their
    SHA-256, parameters, seed. ``notes`` are sentences about what was inferred or repaired on
    reading.
    """

    time: Floats
    joint_names: tuple[str, ...] = ()
    model_name: str = ""
    model_sha256: str = ""
    contact_points: tuple[str, ...] = ()
    contact_active: Bools | None = None
    meta: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    path: str | None = None
    sha256: str | None = None
    format: str = "physretarget"

    @property
    @abstractmethod
    def nq(self) -> int:
        """Coordinates per frame."""

    @abstractmethod
    def between(self, first: int, last: int) -> Floats:
        """(last - first, nq) poses of the frames first to last - 1, as far as there are such.

        Args:
            first: First frame.
            last: Frame after the last one.

        Returns:
            (last - first, nq) poses.
        """

    def whole(self) -> Clip:
        """The motion with all its poses in one array."""
        told = {f.name: getattr(self, f.name) for f in fields(Motion)}
        return Clip(qpos=self.between(0, self.frames), **told)

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.time)

    @property
    def duration(self) -> float:
        """Seconds from the first frame to the last."""
        return float(self.time[-1] - self.time[0])

    @property
    def fps(self) -> float:
        """Frames per second, the mean over the clip (0 for a single frame)."""
        return (self.frames - 1) / self.duration if self.frames > 1 else 0.0

    @property
    def name(self) -> str:
        """The file's name, or the model's where the clip was never a file."""
        return Path(self.path).name if self.path else (self.model_name or "clip")

    def _check_contacts(self) -> None:
        active = self.contact_active
        wanted = (len(self.time), len(self.contact_points))
        if active is not None and active.shape != wanted:
            raise InputError(
                f"contact_active has shape {active.shape}, {wanted} (frames, contact points) "
                "is needed.",
                path=self.path,
            )


@dataclass(frozen=True, kw_only=True, eq=False)
class LongClip(Motion):
    """A motion whose poses are read when they are asked for: memory does not grow with them."""

    rows: Rows

    def __post_init__(self) -> None:
        check_time(self.time, self.rows.shape, path=self.path)
        for first, part in self.rows.parts():
            check_finite(part, first, path=self.path)
        self._check_contacts()

    @property
    def nq(self) -> int:
        """Coordinates per frame."""
        return self.rows.width

    def between(self, first: int, last: int) -> Floats:
        """(last - first, nq) poses of the frames first to last - 1.

        Args:
            first: First frame.
            last: Frame after the last one.

        Returns:
            (last - first, nq) poses.
        """
        return self.rows.between(first, last)


@dataclass(frozen=True, kw_only=True, eq=False)
class Clip(Motion):
    """A character's motion, see :class:`Motion`.

    ``qpos`` (T, nq) in MuJoCo's layout: metres, radians, quaternions wxyz.
    """

    qpos: Floats

    def __post_init__(self) -> None:
        check_time(self.time, self.qpos.shape, path=self.path)
        check_finite(self.qpos, 0, path=self.path)
        self._check_contacts()

    def whole(self) -> Clip:
        """The clip itself."""
        return self

    @property
    def nq(self) -> int:
        """Coordinates per frame."""
        return int(self.qpos.shape[1])

    def between(self, first: int, last: int) -> Floats:
        """(last - first, nq) poses of the frames first to last - 1.

        Args:
            first: First frame.
            last: Frame after the last one.

        Returns:
            (last - first, nq) poses.
        """
        return self.qpos[max(0, first) : last]

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the clip: written beside its place, then renamed, so never half there.

        Args:
            path: The .npz file.
        """
        write_file(path, self.to_bytes())

    def to_bytes(self) -> bytes:
        """The bytes of the clip file: members sorted by name, dates fixed."""
        return npz_bytes(self.arrays())

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Members of the clip file, by name."""
        meta = json.dumps(dict(self.meta), sort_keys=True, ensure_ascii=True, allow_nan=False)
        arrays: dict[str, NDArray[Any]] = {
            "qpos": np.ascontiguousarray(self.qpos, dtype="<f8"),
            "time": np.ascontiguousarray(self.time, dtype="<f8"),
            "joint_names": _strings(self.joint_names),
            "model_name": np.array(self.model_name, dtype=np.str_),
            "model_sha256": np.array(self.model_sha256, dtype=np.str_),
            "contact_points": _strings(self.contact_points),
            "meta": np.array(meta, dtype=np.str_),
        }
        if self.contact_active is not None:
            arrays["contact_active"] = np.ascontiguousarray(self.contact_active, dtype=np.bool_)
        if self.notes:
            arrays["notes"] = _strings(self.notes)
        return arrays


def _strings(values: tuple[str, ...]) -> NDArray[np.str_]:
    return np.array(values, dtype=np.str_) if values else np.zeros(0, dtype="<U1")


def check_time(time: Floats, shape: tuple[int, ...], *, path: str | None) -> None:
    """Reject times that do not fit the poses' shape, or do not increase, naming the frame."""
    if len(shape) != 2 or time.ndim != 1 or shape[0] != len(time):
        raise InputError(
            f"qpos has shape {shape} and time {time.shape}, (frames, nq) and (frames,) are needed.",
            path=path,
        )
    if 0 in shape:
        raise InputError("the clip is empty: it has no frames or no coordinates.", path=path)
    if not np.isfinite(time).all():
        frame = int(np.flatnonzero(~np.isfinite(time))[0])
        raise InputError(f"time is {time[frame]}, a number is needed.", path=path, frame=frame)
    late = time[1:] <= time[:-1]
    if late.any():
        frame = int(np.flatnonzero(late)[0]) + 1
        raise InputError(
            f"time goes from {time[frame - 1]:.6g} s to {time[frame]:.6g} s, "
            "it must increase from frame to frame.",
            path=path,
            frame=frame,
        )


def check_finite(qpos: Floats, first: int, *, path: str | None) -> None:
    """Reject poses (T, nq) that are no numbers; ``first`` is the number of their first frame."""
    bad = ~np.isfinite(qpos)
    if bad.any():
        frame, column = (int(i) for i in np.argwhere(bad)[0])
        raise InputError(
            f"qpos column {column} is {qpos[frame, column]}, every value must be a finite number.",
            path=path,
            frame=first + frame,
        )
