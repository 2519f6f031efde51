"""C3D: the binary exchange format of optical motion capture, read with ezc3d."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import ezc3d
import numpy as np

from physretarget.capture.c3d_check import check
from physretarget.capture.marker_file import RawMarkers, finish, markers_of, read_bytes
from physretarget.capture.reader import ReadOptions
from physretarget.capture.recording import Floats, ForcePlate, MarkerRecording, Names
from physretarget.errors import InputError

_MODEL_LISTS = (
    "ANGLES",
    "FORCES",
    "MOMENTS",
    "POWERS",
    "SCALARS",
    "REACTIONS",
    "MODELED_MARKERS",
)
_MODEL_LABEL = re.compile(
    r"(angles?|forces?|moments?|powers?|scalars?|grf|centreofmass\w*|centerofmass\w*|progress)$",
    re.IGNORECASE,
)
_UNNAMED = re.compile(
    r"^(\*\d*|u\d+|unlabel\w*|uname\*?\d*|unnamed\w*|trajectory\W?\d+|c_\d+|)$", re.I
)
_UNLOADED = 20.0  # N; below this a centre of pressure is noise (ISB usage: 10 to 20 N)


def read(path: str | Path, options: ReadOptions) -> MarkerRecording:
    """Read a file as the registry of readers does; see :func:`read_c3d`."""
    found = read_c3d(path, unit=options.unit, up=options.up, names=options.names)
    return found if options.subject is None else markers_of(found, options.subject)


def read_c3d(
    path: str | Path,
    *,
    unit: str | None = None,
    up: str | None = None,
    names: Names | None = None,
) -> MarkerRecording:
    """Read markers and force plates of a C3D file.

    Gaps (negative residual, NaN or exact zeros) become NaN; model outputs (angles, forces,
    segment axes …) and unnamed points are left out. The unit is the file's unless it cannot
    be a body's, and the up axis is where head and feet say it is; both can be told.

    Raises InputError for what is not C3D, is cut short, or has no markers.
    """
    content = read_bytes(path)
    frames = check(content, path)
    try:
        file = ezc3d.c3d(str(path))
    except (OSError, RuntimeError, ValueError, IndexError, MemoryError, KeyError) as error:
        raise InputError(f"ezc3d cannot read this C3D file ({error})", path=path) from error
    values = file["data"]["points"]
    if values.shape[2] < frames:
        raise InputError(
            f"the file is cut short: it promises {frames} frames and holds {values.shape[2]}",
            path=path,
        )
    point = file["parameters"]["POINT"]
    labels = _labels(point, values.shape[1])
    keep, notes = _markers(labels, point)
    if not keep:
        raise InputError(_why_none(labels, file["data"], notes), path=path)
    position = np.ascontiguousarray(np.moveaxis(values[:3, keep], 0, -1).swapaxes(0, 1))
    residual = file["data"]["meta_points"]["residuals"][0, keep].T
    position[residual < 0] = np.nan
    fps = _number(point, "RATE") or float(file["header"]["points"]["frame_rate"])

    def plates(turn: Floats, scale: float) -> tuple[ForcePlate, ...]:
        return _plates(path, file, turn, scale, notes)

    raw = RawMarkers(
        path=path,
        content=content,
        format="c3d",
        fps=fps,
        labels=tuple(labels[i] for i in keep),
        position=position,
        unit=_text(point, "UNITS"),
        up=_screen_up(point),
        usual_up="z",
        notes=tuple(notes),
    )
    return finish(raw, unit=unit, up=up, plates=plates, names=names)


def _values(group: Mapping[str, Any], name: str) -> list[Any]:
    """All values of a parameter, continued in NAME2, NAME3 … beyond 255."""
    found: list[Any] = []
    for suffix in ("", *map(str, range(2, 100))):
        if name + suffix not in group:
            break
        found += list(group[name + suffix]["value"])
    return found


def _text(group: Mapping[str, Any], name: str) -> str | None:
    values = _values(group, name)
    return str(values[0]) if values else None


def _number(group: Mapping[str, Any], name: str) -> float:
    values = _values(group, name)
    return float(values[0]) if values else 0.0


def _labels(point: Mapping[str, Any], count: int) -> list[str]:
    labels = [str(label).strip() for label in _values(point, "LABELS")][:count]
    return labels + [""] * (count - len(labels))


def _markers(labels: list[str], point: Mapping[str, Any]) -> tuple[list[int], list[str]]:
    """Indices of labels that are markers, and a note on what was left out."""
    listed = {str(label) for name in _MODEL_LISTS for label in _values(point, name)}
    present = {label.rsplit(":", 1)[-1] for label in labels}
    keep, outputs, unnamed = [], 0, 0
    for i, label in enumerate(labels):
        bare = label.rsplit(":", 1)[-1]
        # Plug-in-Gait draws a segment's axes as four points: origin, anterior, lateral, proximal.
        # LTOE and LTIB share their first letters with such points and are markers.
        axes = re.fullmatch(r"\w{3}[OALP]", bare) and all(bare[:3] + e in present for e in "OALP")
        if _UNNAMED.match(bare):
            unnamed += 1
        elif label in listed or bare in listed or _MODEL_LABEL.search(bare) or axes:
            outputs += 1
        else:
            keep.append(i)
    notes = []
    if outputs:
        notes.append(f"{outputs} model outputs among the points were left out")
    if unnamed:
        notes.append(f"{unnamed} unnamed points were left out")
    return keep, notes


def _why_none(labels: list[str], data: Mapping[str, Any], notes: list[str]) -> str:
    """Why a file has no markers."""
    if labels:
        return f"none of the file's {len(labels)} points is a named marker: {', '.join(notes)}"
    if data["rotations"].size:
        return "the file holds rotations of segments; markers, or a BVH skeleton, are needed"
    return "the file holds no points, at most analog channels"


def _screen_up(point: Mapping[str, Any]) -> str | None:
    """The file's up axis: the direction up the screen, if it is said and not sideways."""
    said = _text(point, "Y_SCREEN")
    axis = (said or "").strip().lower().lstrip("+-")
    return axis if axis in ("x", "y", "z") else None


def _plates(
    path: str | Path, file: Any, turn: Floats, scale: float, notes: list[str]
) -> tuple[ForcePlate, ...]:
    """Force plates as ezc3d works them out, turned into the world: what the floor does."""
    group = file["parameters"].get("FORCE_PLATFORM", {})
    if not _number(group, "USED"):
        return ()
    try:
        found = ezc3d.c3d(str(path), extract_forceplat_data=True)["data"]["platform"]
    except (OSError, RuntimeError, ValueError, IndexError, KeyError):
        return ()  # plates of a type that ezc3d does not know: markers are still good
    header = file["header"]["analogs"]
    rate = float(header["frame_rate"]) if header["frame_rate"] else float("nan")
    plates = []
    for i, plate in enumerate(found):
        moment = 1.0 if plate["unit_moment"] in ("Nm", "N.m") else 1e-3
        length = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}.get(plate["unit_position"], scale)
        # ezc3d gives the force on the plate's own reaction: upwards on the body.
        force = np.nan_to_num(plate["force"]).T @ turn.T
        loaded = force[:, 2] > _UNLOADED
        point = np.where(loaded[:, None], plate["center_of_pressure"].T @ turn.T * length, np.nan)
        free = np.where(loaded[:, None], plate["Tz"].T @ turn.T * moment, 0.0)
        plates.append(
            ForcePlate(
                name=f"plate {i + 1}",
                corners=plate["corners"].T @ turn.T * length,
                time=np.arange(len(force)) / rate,
                force=force,
                point=point,
                free_moment=np.nan_to_num(free),
            )
        )
    return tuple(plates)
