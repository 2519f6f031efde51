"""From a marker file's numbers to a recording in metres with z up; what is guessed is noted."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from physretarget.capture.marker_sets import up_axis, upside_down
from physretarget.capture.recording import (
    Floats,
    ForcePlate,
    MarkerRecording,
    Source,
    sha256_of,
)
from physretarget.capture.skeleton import to_world, unit_scale
from physretarget.errors import InputError, UnsafeInputError

_LARGEST_FILE = 2**30  # bytes; a 10-minute capture of 60 markers at 200 Hz takes 0.1 GiB
_SPELLINGS = {
    "mm": "mm", "millimeter": "mm", "millimeters": "mm", "millimetre": "mm", "millimetres": "mm",
    "cm": "cm", "centimeter": "cm", "centimeters": "cm", "centimetre": "cm", "centimetres": "cm",
    "m": "m", "meter": "m", "meters": "m", "metre": "m", "metres": "m",
    "in": "inch", "inch": "inch", "inches": "inch",
}  # fmt: skip
# A capture volume's worth of body: marker sets from knees to head are within these metres.
_BODY = (0.6, 2.6)

# Given the rotation to the world and metres per unit, the plates on the recording's clock.
Plates = Callable[[Floats, float], tuple[ForcePlate, ...]]


@dataclass(frozen=True, kw_only=True, eq=False)
class RawMarkers:
    """Markers in their file's unit and axes: ``position`` (T, M, 3), NaN in gaps.

    ``unit`` and ``up`` are what the file says, None where it is silent; ``usual_up`` is the
    custom of the format. ``start`` is the file's own time of the first frame, s.
    """

    path: str | Path
    content: bytes
    format: str
    fps: float
    labels: tuple[str, ...]
    position: Floats
    unit: str | None
    up: str | None
    usual_up: str
    notes: tuple[str, ...] = ()
    start: float = 0.0


def read_bytes(path: str | Path) -> bytes:
    """The content of a file that exists, is not empty and is not absurdly large."""
    place = Path(path)
    if not place.is_file():
        raise InputError("there is no such file", path=path)
    size = place.stat().st_size
    if size == 0:
        raise InputError("the file is empty", path=path)
    if size > _LARGEST_FILE:
        raise UnsafeInputError(
            f"the file has {size / 2**30:.1f} GiB; at most {_LARGEST_FILE // 2**30} GiB is read",
            path=path,
        )
    return place.read_bytes()


def finish(
    raw: RawMarkers, *, unit: str | None, up: str | None, plates: Plates | None = None
) -> MarkerRecording:
    """Scale and turn raw markers into the world.

    ``unit`` and ``up`` as told by the user win over what the file says; the file's unit is
    checked against the size of a body, its up axis against where head and feet are.
    """
    if not (np.isfinite(raw.fps) and 0.1 <= raw.fps <= 1e5):
        raise InputError(f"a rate of {raw.fps} frames per second makes no sense", path=raw.path)
    notes = list(raw.notes)
    position = without_gaps(raw.position)
    known = np.isfinite(position).all(axis=-1)
    if position.size == 0 or not known.any():
        raise InputError("there is not one visible marker in the file", path=raw.path)
    if np.abs(position[known]).max() > 1e8:
        raise InputError("coordinates beyond 1e8 are no positions in any unit", path=raw.path)
    name = unit or _unit(raw, position, notes)
    axis = up or _up(raw, position, notes)
    scale, turn = unit_scale(name), to_world(axis)
    return MarkerRecording(
        source=Source(
            path=str(raw.path),
            sha256=sha256_of(raw.content),
            format=raw.format,
            unit=name,
            up=axis,
            fps=raw.fps,
            frames=len(position),
            start=raw.start,
        ),
        labels=raw.labels,
        time=np.arange(len(position)) / raw.fps,
        position=position @ (scale * turn.T),
        plates=plates(turn, scale) if plates else (),
        notes=tuple(notes),
    )


def without_gaps(position: Floats) -> Floats:
    """A copy in which non-finite coordinates and exact zeros (T, M, 3) are NaN throughout."""
    missing = ~np.isfinite(position).all(axis=-1) | (position == 0).all(axis=-1)
    return np.where(missing[..., None], np.nan, position)


def _extent(position: Floats) -> float:
    """Median over frames of the largest extent of the marker cloud along any axis."""
    some = position[:: max(1, len(position) // 200)]
    some = some[np.isfinite(some).all(axis=-1).sum(axis=1) >= 3]
    if not len(some):
        return float("nan")
    return float(np.median((np.nanmax(some, axis=1) - np.nanmin(some, axis=1)).max(axis=1)))


def _unit(raw: RawMarkers, position: Floats, notes: list[str]) -> str:
    extent = _extent(position)
    stated = _SPELLINGS.get(re.sub(r"[^a-z]", "", (raw.unit or "").lower()))
    size = extent * unit_scale(stated) if stated else float("nan")
    if stated and (np.isnan(size) or _BODY[0] / 4 <= size <= _BODY[1] * 4):
        return stated
    for name in ("mm", "m", "cm"):
        if _BODY[0] <= extent * unit_scale(name) <= _BODY[1]:
            said = f"the file says {raw.unit!r}, but" if raw.unit else "the file names no unit, and"
            notes.append(f"unit guessed as {name}: {said} the body measures {extent:.4g} units")
            return name
    if stated:
        return stated
    raise InputError(
        f"the unit is not known and the markers' extent of {extent:.4g} fits no body; tell the "
        "unit",
        path=raw.path,
    )


def _up(raw: RawMarkers, position: Floats, notes: list[str]) -> str:
    seen = up_axis(raw.labels, position, raw.up or raw.usual_up)
    if seen is None:
        chosen = raw.up or raw.usual_up
        why = "as the file says" if raw.up else f"the custom of {raw.format.upper()} files"
        notes.append(f"up axis taken as {chosen}, {why}: the poses do not tell")
        if upside_down(raw.labels, position, chosen):
            notes[-1] = (
                f"the feet are above the head along {chosen}: if this is no handstand, the axis "
                f"points down, which --up -{chosen} tells"
            )
        return chosen
    if raw.up and raw.up != seen:
        notes.append(
            f"up axis found as {seen}: the head is above the feet along it, although the file "
            f"says {raw.up}"
        )
    elif not raw.up and seen != raw.usual_up:
        notes.append(f"up axis found as {seen}: the head is above the feet along it")
    return seen
