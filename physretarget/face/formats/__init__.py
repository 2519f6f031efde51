"""Reading and writing curves: which reader takes a file is decided by its suffix and content."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import numpy as np

from physretarget.errors import InputError, UsageError
from physretarget.face.formats.dense import LONGEST, MOST
from physretarget.face.formats.gltf import read_gltf, write_gltf
from physretarget.face.formats.live2d import read_live2d, write_live2d
from physretarget.face.formats.livelink import read_livelink
from physretarget.face.formats.lottie import read_lottie, write_lottie
from physretarget.face.formats.maya_anim import read_maya, write_maya
from physretarget.face.formats.plain import read_csv, read_json, write_csv, write_json
from physretarget.face.formats.registry import FORMATS, Format, format_of, known, written
from physretarget.face.formats.source import Source
from physretarget.face.formats.spine import read_spine
from physretarget.face.formats.usd import read_usd, write_usd
from physretarget.face.shot import Shot, Take

__all__ = [
    "FORMATS",
    "Format",
    "read_csv",
    "read_gltf",
    "read_json",
    "read_live2d",
    "read_livelink",
    "read_lottie",
    "read_maya",
    "read_shots",
    "read_spine",
    "read_take",
    "read_usd",
    "write_csv",
    "write_gltf",
    "write_json",
    "write_live2d",
    "write_lottie",
    "write_maya",
    "write_shot",
    "write_usd",
]


def read_shots(path: str | PathLike[str]) -> tuple[Shot, ...]:
    """Every shot of a keyed file.

    Args:
        path: A keyed file of any format that is read.

    Returns:
        Its shots.

    Raises:
        InputError: no reader knows it, it is broken, or it is a dense capture without keys.
    """
    source = Source.open(path)
    form = format_of(source)
    if form.shots is None:
        raise InputError(
            f"a dense capture ({form.title}), without keys; keyed curves are {known(keyed=True)}.",
            path=source.path,
        )
    return form.shots(source)


def write_shot(path: str | PathLike[str], shot: Shot) -> tuple[str, ...]:
    """Write in the format that the suffix names; returns what was lost.

    Args:
        path: The file; its suffix names the format.
        shot: The curves.

    Returns:
        One sentence for everything that the format could not hold.
    """
    name = Path(path).name.lower()
    suited = [
        (len(suffix), form.write)
        for form in FORMATS
        if form.write
        for suffix in form.suffixes
        if name.endswith(suffix) and (suffix != ".json" or form.name == "curves")
    ]
    if not suited:
        raise UsageError(f"{name}: curves can be written as {written()}.")
    return max(suited, key=lambda pair: pair[0])[1](path, shot)


def read_take(path: str | PathLike[str], *, fps: float | None = None) -> Take:
    """A dense capture of any format that is read; keyed curves are sampled.

    Curves are sampled at their file's frame rate, else at the rate of their keys where these stand
    evenly as in a recording, else at 60 Hz.

    Args:
        path: The file.
        fps: Frame rate of the take; the recording's own by default.

    Returns:
        The capture.

    Raises:
        InputError: no reader knows it, or it is broken.
    """
    source = Source.open(path)
    form = format_of(source)
    if form.take is not None:
        return form.take(source, fps=fps)
    assert form.shots is not None  # what is read is a shot or a take
    return _sampled(form.shots(source), fps, source.path)


_CURVES_HZ = 60.0
_SLOWEST_HZ = 20.0  # of a recording: slower ones miss a blink of a tenth of a second


def _sampled(shots: tuple[Shot, ...], fps: float | None, path: Path) -> Take:
    """The first shot that moves, as a dense take."""
    shot = next(
        (each for each in shots if any(len(c.keys) > 1 for c in each.curves.values())), None
    )
    if shot is None:
        raise InputError("holds no curve that moves.", path=path)
    curves = shot.curves.values()
    rate = fps or shot.fps or _key_rate(shot) or _CURVES_HZ
    start = min(curve.start for curve in curves)
    end = max(max(curve.end for curve in curves), start + 1 / rate)
    if not (end - start) * rate < LONGEST or (end - start) * rate * len(curves) > MOST:
        raise InputError(
            f"its curves span {end - start:g} s, too much to sample at {rate:g} Hz.", path=path
        )
    values = np.stack([curve.sample(rate, start, end) for curve in curves], axis=1)
    notes: tuple[str, ...] = (f"Curves were sampled at {rate:g} Hz.",)
    if len(shots) > 1:
        notes += (f"Of {len(shots)} shots the first that moves is read.",)
    time = np.arange(len(values)) / rate
    return Take(shot.name, time, tuple(shot.curves), values, shot.sha256, notes)


def _key_rate(shot: Shot) -> float | None:
    """Keys a second, if they stand evenly and no further apart than a recording's frames."""
    time = max((c.time for c in shot.curves.values()), key=len)
    step = float(time[-1] - time[0]) / (len(time) - 1)
    even = bool(np.abs(np.diff(time) - step).max() < 0.1 * step)
    return 1.0 / step if even and step <= 1.0 / _SLOWEST_HZ and len(time) > _SLOWEST_HZ else None
