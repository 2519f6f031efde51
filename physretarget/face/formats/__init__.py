"""Reading and writing curves: which reader takes a file is decided by its suffix and content."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from physretarget.errors import InputError, UsageError
from physretarget.face.formats.gltf import read_gltf, write_gltf
from physretarget.face.formats.live2d import is_live2d, read_live2d, write_live2d
from physretarget.face.formats.livelink import is_livelink, read_livelink
from physretarget.face.formats.lottie import is_lottie, read_lottie, write_lottie
from physretarget.face.formats.maya_anim import read_maya, write_maya
from physretarget.face.formats.plain import (
    is_curves,
    read_csv,
    read_json,
    write_csv,
    write_json,
)
from physretarget.face.formats.source import Source
from physretarget.face.formats.spine import is_spine, read_spine
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


@dataclass(frozen=True)
class Format:
    """A keyed format: ``matches`` looks at parsed JSON, or is None where the suffix decides.

    ``write`` returns what was lost, one sentence each.
    """

    name: str
    suffixes: tuple[str, ...]
    read: Callable[[Source], tuple[Shot, ...]] | None = None
    write: Callable[[str | PathLike[str], Shot], tuple[str, ...]] | None = None
    matches: Callable[[Any], bool] | None = None


FORMATS: list[Format] = [
    Format(
        "lottie", (".lottie.json", ".json"), lambda s: (read_lottie(s),), write_lottie, is_lottie
    ),
    Format("spine", (".json",), read_spine, None, is_spine),
    Format(
        "live2d",
        (".motion3.json", ".json"),
        lambda s: (read_live2d(s),),
        write_live2d,
        is_live2d,
    ),
    Format("maya", (".anim",), lambda s: (read_maya(s),), write_maya),
    Format("gltf", (".gltf", ".glb"), read_gltf, write_gltf),
    Format("usd", (".usda", ".usdc", ".usd"), lambda s: (read_usd(s),), write_usd),
    Format("curves", (".curves.json", ".json"), lambda s: (read_json(s),), write_json, is_curves),
]
"""Asked in this order; further formats append themselves."""


def read_shots(path: str | PathLike[str]) -> tuple[Shot, ...]:
    """Every shot of a keyed file.

    Args:
        path: A keyed file of any format that is read.

    Returns:
        Its shots.

    Raises:
        InputError: no reader knows it, or it is broken.
    """
    place = Path(path)
    suited = [f for f in FORMATS if f.read and place.name.lower().endswith(f.suffixes)]
    if not suited:
        raise InputError(f"unknown kind of file; keyed curves are {known()}.", path=place)
    source = Source.open(place)
    content = source.json() if any(f.matches for f in suited) else None
    for form in suited:
        if form.read and (form.matches is None or form.matches(content)):
            return form.read(source)
    names = ", ".join(f.name for f in suited)
    raise InputError(f"not what its suffix promises ({names}).", path=place)


def known() -> str:
    """Suffixes that can be read, for messages."""
    return ", ".join(sorted({f"*{s}" for f in FORMATS if f.read for s in f.suffixes}))


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
        (len(suffix), form)
        for form in FORMATS
        if form.write
        for suffix in form.suffixes
        if name.endswith(suffix) and (suffix != ".json" or form.name == "curves")
    ]
    if not suited:
        allowed = sorted({f"*{s}" for f in FORMATS if f.write for s in f.suffixes})
        raise UsageError(f"{name}: curves can be written as {', '.join(allowed)}.")
    write = max(suited, key=lambda pair: pair[0])[1].write
    assert write is not None
    return write(path, shot)


def read_take(path: str | PathLike[str], *, fps: float | None = None) -> Take:
    """A dense capture: Live Link Face CSV, a plain ``time,channel,…`` CSV, or keyed curves.

    Curves are sampled at their file's frame rate, at 60 Hz where it has none.

    Args:
        path: The file.
        fps: Rate at which keyed curves are sampled.

    Returns:
        The capture.
    """
    source = Source.open(path)
    if source.path.suffix.lower() != ".csv":
        return _sampled(read_shots(path), fps, source.path)
    if is_livelink(source):
        return read_livelink(source, fps=fps)
    take = read_csv(source)
    return take if fps is None else take.resampled(fps)


_CURVES_HZ = 60.0


def _sampled(shots: tuple[Shot, ...], fps: float | None, path: Path) -> Take:
    """The first shot that moves, as a dense take."""
    shot = next(
        (each for each in shots if any(len(c.keys) > 1 for c in each.curves.values())), None
    )
    if shot is None:
        raise InputError("holds no curve that moves.", path=path)
    rate, curves = fps or shot.fps or _CURVES_HZ, shot.curves.values()
    start = min(curve.start for curve in curves)
    end = max(max(curve.end for curve in curves), start + 1 / rate)
    values = np.stack([curve.sample(rate, start, end) for curve in curves], axis=1)
    notes: tuple[str, ...] = (f"Curves were sampled at {rate:g} Hz.",)
    if len(shots) > 1:
        notes += (f"Of {len(shots)} shots the first that moves is read.",)
    time = np.arange(len(values)) / rate
    return Take(shot.name, time, tuple(shot.curves), values, shot.sha256, notes)
