"""The one list of facial formats: who reads and writes a file, and what the docs say of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from os import PathLike
from typing import Any, Protocol

from physretarget.errors import InputError
from physretarget.face.formats.audio2face import is_audio2face, read_audio2face
from physretarget.face.formats.facecap import is_facecap, read_facecap
from physretarget.face.formats.gltf import read_gltf, write_gltf
from physretarget.face.formats.ifacialmocap import is_ifacialmocap, read_ifacialmocap
from physretarget.face.formats.live2d import is_live2d, read_live2d, write_live2d
from physretarget.face.formats.livelink import is_livelink, read_livelink
from physretarget.face.formats.lottie import is_lottie, read_lottie, write_lottie
from physretarget.face.formats.maya_anim import read_maya, write_maya
from physretarget.face.formats.mediapipe import is_mediapipe, read_mediapipe
from physretarget.face.formats.osc import is_osc, read_osc
from physretarget.face.formats.plain import (
    is_audio2face_table,
    is_curves,
    is_table,
    read_csv,
    read_json,
    write_csv,
    write_json,
)
from physretarget.face.formats.source import Source
from physretarget.face.formats.spine import is_spine, read_spine
from physretarget.face.formats.unity import is_unity, read_unity
from physretarget.face.formats.usd import read_usd, write_usd
from physretarget.face.shot import Shot, Take


class TakeReader(Protocol):
    """Reads a dense capture, at a frame rate or at its own."""

    def __call__(self, source: Source, /, *, fps: float | None = None) -> Take: ...


@dataclass(frozen=True, kw_only=True)
class Format:
    """One format.

    Attributes:
        name: the format's, for messages.
        suffixes: of files, the first the one that names it in writing.
        sniff: whether a file with such a suffix is one, by its content.
        shots: reads keyed curves, or None.
        take: reads a dense capture, or None; keyed curves are sampled instead.
        write: writes keyed curves and returns what was lost, or None.
        title, held, clock, lost: the row in the docs: what it is called, what is read of it,
            where its frame rate comes from, what writing loses.
    """

    name: str
    suffixes: tuple[str, ...]
    sniff: Callable[[Source], bool]
    shots: Callable[[Source], tuple[Shot, ...]] | None = None
    take: TakeReader | None = None
    write: Callable[[str | PathLike[str], Shot], tuple[str, ...]] | None = None
    title: str
    held: str
    clock: str
    lost: str = ""


def _json(test: Callable[[Any], bool]) -> Callable[[Source], bool]:
    """A test of parsed JSON as one of the file; broken JSON raises, with its line."""
    return lambda source: test(source.json())


def _always(source: Source) -> bool:
    return True


FORMATS: tuple[Format, ...] = (
    Format(
        name="curves", suffixes=(".curves.json", ".json"), sniff=_json(is_curves),
        shots=lambda s: (read_json(s),), write=write_json,
        title="this project's JSON", held="keyed curves", clock="`fps`", lost="nothing",
    ),
    Format(
        name="lottie", suffixes=(".lottie.json", ".json"), sniff=_json(is_lottie),
        shots=lambda s: (read_lottie(s),), write=write_lottie,
        title="Lottie", held="transform channels, sliders", clock="`fr`", lost="tangent kinds",
    ),
    Format(
        name="spine", suffixes=(".json",), sniff=_json(is_spine), shots=read_spine,
        title="Spine 3, 4", held="bone timelines", clock="none",
    ),
    Format(
        name="live2d", suffixes=(".motion3.json", ".json"), sniff=_json(is_live2d),
        shots=lambda s: (read_live2d(s),), write=write_live2d,
        title="Live2D motion", held="all curves", clock="`Fps`",
        lost="tangent kinds except linear and stepped",
    ),
    Format(
        name="audio2face", suffixes=(".json",), sniff=_json(is_audio2face), take=read_audio2face,
        title="Audio2Face JSON", held="`weightMat`", clock="`exportFps`",
    ),
    Format(
        name="mediapipe", suffixes=(".json", ".jsonl", ".ndjson"), sniff=is_mediapipe,
        take=read_mediapipe, title="MediaPipe JSON", held="blend shapes of the first face",
        clock="times of the frames, or `fps`",
    ),
    Format(
        name="unity", suffixes=(".anim",), sniff=is_unity, shots=read_unity,
        title="Unity clip (extra `unity`)", held="float curves, positions, scales, Euler angles",
        clock="`m_SampleRate`",
    ),
    Format(
        name="maya", suffixes=(".anim",), sniff=_always, shots=lambda s: (read_maya(s),),
        write=write_maya, title="Maya animation", held="curves over time", clock="`timeUnit`",
        lost="last digit of angles and times",
    ),
    Format(
        name="gltf", suffixes=(".glb", ".gltf"), sniff=_always, shots=read_gltf, write=write_gltf,
        title="glTF 2.0 (extra `gltf`)", held="translation, scale, rotation, morph weights",
        clock="none", lost="handle lengths; keys are added",
    ),
    Format(
        name="usd", suffixes=(".usda", ".usdc", ".usd"), sniff=_always,
        shots=lambda s: (read_usd(s),), write=write_usd,
        title="USD splines (extra `usd`)", held="the file's own layer", clock="its time codes",
        lost="upright handles",
    ),
    Format(
        name="audio2face table", suffixes=(".csv",), sniff=is_audio2face_table, take=read_csv,
        title="Audio2Face CSV", held="`blendShapes.` columns", clock="`timeCode`",
    ),
    Format(
        name="livelink", suffixes=(".csv",), sniff=is_livelink, take=read_livelink,
        title="Live Link Face CSV", held="all columns", clock="timecodes",
    ),
    Format(
        name="facecap", suffixes=(".txt", ".csv"), sniff=is_facecap, take=read_facecap,
        title="Face Cap recording", held="weights, head, eyes", clock="times of the frames",
    ),
    Format(
        name="osc", suffixes=(".txt", ".osc", ".log", ".jsonl", ".ndjson"), sniff=is_osc,
        take=read_osc, title="VMC and other OSC messages, as text", held="weights",
        clock="times of the messages",
    ),
    Format(
        name="ifacialmocap", suffixes=(".txt", ".csv", ".jsonl", ".ndjson"), sniff=is_ifacialmocap,
        take=read_ifacialmocap, title="iFacialMocap packets", held="weights, head, eyes",
        clock="times of the packets, else 60 Hz",
    ),
    Format(
        name="table", suffixes=(".csv", ".tsv", ".txt"), sniff=is_table, take=read_csv,
        title="CSV, MediaPipe CSV", held="columns after `time`, `timestamp_ms`, …",
        clock="times of the rows",
    ),
)  # fmt: skip
"""Asked in this order; a suffix is shared by what the content tells apart."""


def format_of(source: Source) -> Format:
    """Who reads a file.

    Args:
        source: the file.

    Returns:
        Its format.

    Raises:
        InputError: no reader knows it, or it is broken.
    """
    name = source.path.name.lower()
    suited = [f for f in FORMATS if (f.shots or f.take) and name.endswith(f.suffixes)]
    if not suited:
        raise InputError(f"unknown kind of file; these are read: {known()}.", path=source.path)
    found = next((f for f in suited if f.sniff(source)), None)
    if found is None:
        names = ", ".join(f.title for f in suited)
        raise InputError(f"its content is none of {names}.", path=source.path)
    return found


def known(*, keyed: bool = False) -> str:
    """Suffixes that can be read, for messages.

    Args:
        keyed: only those of keyed curves.
    """
    return ", ".join(
        sorted({f"*{s}" for f in FORMATS if f.shots or (f.take and not keyed) for s in f.suffixes})
    )


def written() -> str:
    """Suffixes that can be written, for messages."""
    return ", ".join(sorted({f"*{f.suffixes[0]}" for f in FORMATS if f.write}))


def table() -> str:
    """The docs' table of formats, in Markdown."""
    lines = ["| format | suffix | as a shot | as a capture | frame rate from | lost in writing |"]
    lines.append("|" + "---|" * 6)
    for each in FORMATS:
        suffixes = ", ".join(f"`{s}`" for s in each.suffixes)
        shot = each.held if each.shots else ""
        take = "sampled" if each.shots else each.held
        lost = each.lost if each.write else "not written"
        lines.append(f"| {each.title} | {suffixes} | {shot} | {take} | {each.clock} | {lost} |")
    return "\n".join(lines) + "\n"


__all__ = ["FORMATS", "Format", "format_of", "known", "table", "write_csv", "written"]
