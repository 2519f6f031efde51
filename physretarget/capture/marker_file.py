"""From a marker file's numbers to a recording in metres with z up; what is guessed is noted."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physretarget.capture.marker_sets import subjects, up_axis, upside_down
from physretarget.capture.recording import (
    Floats,
    ForcePlate,
    MarkerRecording,
    Names,
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

# How far from the middle of its frame a marker can be, in the median distance of all: one that
# does not move at all, and any. Heads and feet are within 4; a second actor may be some metres off.
_FAR_IF_STILL, _FAR = 8.0, 200.0

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
    raw: RawMarkers,
    *,
    unit: str | None,
    up: str | None,
    plates: Plates | None = None,
    names: Names | None = None,
) -> MarkerRecording:
    """Scale and turn raw markers into the world.

    ``unit`` and ``up`` as told by the user win over what the file says; the file's unit is
    checked against the size of a body, its up axis against where head and feet are. ``names``
    says what markers are whose labels say nothing.
    """
    if names is not None:
        raw = replace(raw, labels=names.of_markers(raw.labels))
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


def markers_of(recording: MarkerRecording, subject: str) -> MarkerRecording:
    """The markers of one of the people in a file, by the name before the colon of their labels.

    Raises:
        InputError: No label carries that name.
    """
    owners = [owner.strip(":_- ") for owner in subjects(recording.labels)]
    people = list(dict.fromkeys(owner for owner in owners if owner))
    if subject.isdecimal() and subject not in people and 1 <= int(subject) <= len(people):
        subject = people[int(subject) - 1]
    keep = [i for i, owner in enumerate(owners) if owner == subject]
    if not keep:
        listed = ", ".join(repr(name) for name in people) or "no label has a subject's name"
        raise InputError(
            f"there is no subject {subject!r}; in the file: {listed}", path=recording.source.path
        )
    return replace(
        recording,
        labels=tuple(recording.labels[i] for i in keep),
        position=recording.position[:, keep],
        notes=(*recording.notes, f"subject: {subject}"),
    )


def without_gaps(position: Floats) -> Floats:
    """A copy in which what stands for a missing marker (T, M, 3) is NaN throughout.

    Missing are non-finite coordinates, exact zeros, and the numbers that writers put where there
    is no marker (-9999, 1e7): far away from the others and never moving, or with three equal
    coordinates again and again. Far is measured in the median distance of markers from the
    middle of their frame, a quarter of a body's height.
    """
    missing = ~np.isfinite(position).all(axis=-1) | (position == 0).all(axis=-1)
    known = np.where(missing[..., None], np.nan, position)
    missing |= _repeated_equal(known)
    known = np.where(missing[..., None], np.nan, position)
    shown = ~missing.all(axis=1)
    if not shown.any():
        return known
    seen = known[shown]
    off = np.abs(seen - np.nanmedian(seen, axis=1, keepdims=True)).max(axis=-1)
    usual = float(np.nanmedian(off))
    still = np.zeros(seen.shape[:2], dtype=bool)
    same = (seen[1:] == seen[:-1]).all(axis=-1)
    still[1:] |= same
    still[:-1] |= same
    with np.errstate(invalid="ignore"):
        missing[shown] |= (off > _FAR_IF_STILL * usual) & still
        missing[shown] |= off > _FAR * usual
    return np.where(missing[..., None], np.nan, position)


def _repeated_equal(position: Floats) -> NDArray[np.bool_]:
    """(T, M) triples of one number three times that the file holds in a tenth of a column."""
    first, second, third = np.moveaxis(position, -1, 0)
    equal = np.asarray((first == second) & (second == third))
    values, counts = np.unique(position[equal][:, 0], return_counts=True)
    often = values[counts >= max(2, 0.1 * len(position))]
    repeated: NDArray[np.bool_] = equal & np.isin(position[..., 0], often)
    return repeated


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
