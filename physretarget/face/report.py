"""The report of one take: one HTML file that shows where every key comes from.

Per channel one timeline with the capture, the result, its keys and, below, the spans by source.
The page draws the result from the keys themselves, as exact Béziers at any zoom.
"""

from __future__ import annotations

import html
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from os import PathLike
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from physretarget import __version__, assets
from physretarget.errors import InputError
from physretarget.face.curve import Curve
from physretarget.face.events import Event, find_events
from physretarget.face.library import Library
from physretarget.face.match import Result
from physretarget.face.measure import turning_point_timing
from physretarget.face.reduce import REDUCERS, reduce_curve
from physretarget.face.rig import Rig
from physretarget.face.sources import Piece
from physretarget.files import write_file

Array = NDArray[np.float64]
SpanKind = Literal["matched", "plain", "rest", "fitted", "locked", "reduced"]
"""matched: a past shot explains it better than any ease; plain: an ease does as well; rest: nothing
moves; fitted: a gap between borrowed segments; locked: the animator's own keys, kept; reduced: made
by plain key reduction."""


@dataclass(frozen=True)
class Origin:
    """Where a span's shape comes from.

    start, end: seconds in the shot. scale, amplitude: result over example in time and in height.
    error: root mean square misfit as a fraction of what the channel moves. margin: by how many nats
    the shape is likelier than an ease; None where it was not weighed. confidence: probability of
    keys within a frame of both ends. alike: how many segments of the library share the shape.
    example: the borrowed keys themselves. what: what the curve does.
    """

    shot: str
    channel: str
    start: float
    end: float
    scale: float
    amplitude: float
    error: float
    margin: float | None = None
    alike: int = 1
    example: Curve | None = None
    what: str = ""
    confidence: float | None = None


@dataclass(frozen=True)
class SourceSpan:
    """Seconds [start, end] of the result; ``low`` flags a confidence too small to trust."""

    start: float
    end: float
    kind: SpanKind
    origin: Origin | None = None
    low: bool = False


@dataclass(frozen=True, eq=False)
class ChannelReport:
    """One channel: capture (T,) on the take's times, result, spans, numbers of locked keys."""

    name: str
    group: str
    lower: float
    upper: float
    capture: Array
    result: Curve
    spans: tuple[SourceSpan, ...] = ()
    error: float | None = None
    timing: float | None = None
    locked: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class TakeReport:
    """Everything on the page.

    figures: label → text at the top. comparison: rows of a table, first row its head. time (T,).
    events: what happens across channels. dense: (T,) values of channels that are left to the
    capture, for the face that is drawn.
    """

    title: str
    method: str
    time: Array
    channels: tuple[ChannelReport, ...]
    figures: Mapping[str, str] = field(default_factory=dict)
    comparison: Sequence[Sequence[str]] = ()
    notes: Sequence[str] = ()
    events: Sequence[Event] = ()
    dense: Mapping[str, Array] = field(default_factory=dict)


def take_report(
    result: Result,
    rig: Rig,
    library: Library | None = None,
    *,
    title: str | None = None,
    baselines: bool = True,
) -> TakeReport:
    """The report of a match, beside plain reducers at each channel's own number of keys.

    The library lets the page draw the borrowed keys. ``baselines=False`` saves their time.
    """
    settings = result.settings
    method = (
        f"{settings.preset}, {settings.method}, tau {settings.tau:g}"
        if settings.preset
        else f"fidelity {settings.fidelity:g}, key cost {settings.key_cost:g}"
    )
    own = settings.method if settings.preset else "match"
    examples = {(e.shot, e.channel): e.curve for e in library.examples} if library else {}
    places = {c.name: c for c in rig.channels}
    time = result.take.time
    channels, scores = [], dict[str, list[tuple[int, float, float]]]()
    for name, found in result.channels.items():
        capture = result.take.channel(name)
        outputs: dict[str, Curve] = {own: found.curve}
        if baselines:
            count = len(found.curve.keys)
            for how in REDUCERS:
                outputs[how] = reduce_curve(
                    capture, result.take.fps, how, keys=count, start=float(time[0])
                )
        for label, curve in outputs.items():
            scores.setdefault(label, []).append(_scores(curve, capture, time, found.unit))
        timing = scores[own][-1][2]
        spans = tuple(_source(piece, examples) for piece in found.pieces)
        where = places[name]
        channels.append(
            ChannelReport(
                name, where.group, where.lower, where.upper, capture, found.curve, spans,
                found.error, timing, found.locked,
            )
        )  # fmt: skip
    flagged = sum(span.low for c in channels for span in c.spans)
    comparison = [("same number of keys", "keys", "error (RMS)", "turning points off by")]
    comparison += [(label, *_row(rows)) for label, rows in scores.items()]
    figures = {
        "channels": str(len(channels)),
        "keys": f"{result.keys}",
        "fewer than the capture": f"{100 * result.reduction:.1f} %",
        "error (RMS)": _row(scores.get(own, []))[1],
        "turning points off by": _row(scores.get(own, []))[2],
        "doubtful spans": str(flagged),
    }
    events = find_events(result.shot().curves, {c.name: c.group for c in rig.channels})
    dense = {name: result.take.channel(name) for name in result.dense}
    return TakeReport(
        title or result.take.name, method, time, tuple(channels), figures,
        comparison if baselines else (), (*result.notes,), events, dense,
    )  # fmt: skip


def _scores(curve: Curve, capture: Array, time: Array, unit: float) -> tuple[int, float, float]:
    """Keys, error over unit, and frames that turning points standing out by 10 % are off."""
    output = curve.evaluate(time)
    error = float(np.sqrt(np.mean((output - capture) ** 2))) / max(unit, 1e-12)
    return len(curve.keys), error, turning_point_timing(output, capture, 0.1 * unit).frames


def _row(rows: list[tuple[int, float, float]]) -> tuple[str, str, str]:
    if not rows:
        return "0", "–", "–"
    keys, errors, timing = (np.array(column) for column in zip(*rows, strict=True))
    frames = f"{np.nanmean(timing):.2f} frames" if np.isfinite(timing).any() else "–"
    return str(int(keys.sum())), f"{100 * errors.mean():.2f} %", frames


def _source(piece: Piece, examples: Mapping[tuple[str, str], Curve]) -> SourceSpan:
    curve = examples.get((piece.shot, piece.channel))
    if curve is not None:
        near = [k for k in curve.keys if piece.source_start <= k.time <= piece.source_end]
        curve = Curve(tuple(near)) if len(near) > 1 else None
    origin = Origin(
        piece.shot, piece.channel, piece.source_start, piece.source_end, piece.stretch,
        piece.amplitude, piece.error, piece.margin if piece.shot else None, piece.alike, curve,
        piece.kind, piece.confidence,
    )  # fmt: skip
    kind: SpanKind = "matched" if piece.shot else "rest" if piece.kind == "hold" else "plain"
    shown: SpanKind = "fitted" if piece.fitted else kind
    return SourceSpan(piece.start, piece.end, shown, origin, piece.doubtful)


def write_report(path: str | PathLike[str], report: TakeReport) -> None:
    """Render and write.

    Raises:
        InputError: a channel's capture does not fit the take's times.
    """
    write_file(path, render(report).encode())


def render(report: TakeReport) -> str:
    """The page; it loads nothing from anywhere."""
    text = json.dumps(page_data(report), ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    # No string in the data can end the script element that it stands in.
    data = text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
    parts = {
        "TITLE": html.escape(f"{report.title} · {report.method}"),
        "VERSION": html.escape(__version__),
        "CSS": assets.text("uPlot.min.css") + _page("page.css"),
        "DATA": data,
        "UPLOT": assets.text("uPlot.iife.min.js"),
        "FACE": _page("face.js"),
        "SCRIPT": _page("page.js"),
    }
    shell = _page("page.html")
    pieces = shell.split("%%")  # text, NAME, text, NAME, …, so that contents are never searched
    return "".join(parts[p] if k % 2 else p for k, p in enumerate(pieces))


def _page(name: str) -> str:
    return (resources.files("physretarget.face") / "page" / name).read_text("utf-8")


def page_data(report: TakeReport) -> dict[str, Any]:
    """What the page's script reads; numbers rounded to what a screen can show."""
    for channel in report.channels:
        if channel.capture.shape != report.time.shape:
            raise InputError(
                f"channel {channel.name}: {channel.capture.shape} values for "
                f"{len(report.time)} frames."
            )
    return {
        "title": report.title,
        "method": report.method,
        "time": _rounded(report.time, 5),
        "figures": dict(report.figures),
        "comparison": [list(row) for row in report.comparison],
        "notes": list(report.notes),
        "channels": [_channel(channel) for channel in report.channels],
        "events": [_event(event) for event in report.events],
        "dense": {name: _rounded(values, 4) for name, values in report.dense.items()},
    }


def _channel(channel: ChannelReport) -> dict[str, Any]:
    curve = channel.result
    digits = _digits(channel.upper - channel.lower)
    return {
        "name": channel.name,
        "group": channel.group,
        "range": [channel.lower, channel.upper],
        "capture": _rounded(channel.capture, digits),
        "curve": _drawn(curve, digits),
        "types": [[key.in_type, key.out_type] for key in curve.keys],
        "spans": [_span(span) for span in channel.spans],
        "error": channel.error,
        "timing": _finite(channel.timing),
        "locked": list(channel.locked),
    }


def _event(event: Event) -> dict[str, Any]:
    return {
        "kind": event.kind,
        "a": round(event.start, 4),
        "b": round(event.end, 4),
        "peak": round(event.peak, 4),
        "channels": [] if event.kind == "hold" else list(event.channels),
    }


def _drawn(curve: Curve, digits: int) -> dict[str, Any]:
    """Keys and the two handles of every span, as the curve is evaluated, and how it steps."""
    handles = curve.controls[:, 1:3].reshape(-1, 4) if len(curve.keys) > 1 else np.empty((0, 4))
    steps = {"stepped": 1, "stepped_next": 2}
    return {
        "t": _rounded(curve.time, 5),
        "v": _rounded(curve.value, digits),
        "h": [_rounded(row, digits + 1) for row in handles],
        "s": [steps.get(key.out_type, 0) for key in curve.keys],
    }


def _span(span: SourceSpan) -> dict[str, Any]:
    told: dict[str, Any] = {
        "a": round(span.start, 5),
        "b": round(span.end, 5),
        "kind": span.kind,
        "low": span.low,
    }
    origin = span.origin
    if origin is not None:
        told["from"] = {
            "shot": origin.shot,
            "channel": origin.channel,
            "start": round(origin.start, 4),
            "end": round(origin.end, 4),
            "scale": round(origin.scale, 4),
            "amplitude": round(origin.amplitude, 6),
            "error": round(origin.error, 6),
            "margin": None if origin.margin is None else round(origin.margin, 6),
            "alike": origin.alike,
            "what": origin.what,
            "confidence": None if origin.confidence is None else round(origin.confidence, 4),
        }
        if origin.example is not None:
            extent = float(np.ptp(origin.example.value))
            told["from"]["curve"] = _drawn(origin.example, _digits(extent))
    return told


def _digits(extent: float) -> int:
    """Decimals that resolve a ten-thousandth of the range."""
    return int(np.clip(4 - np.floor(np.log10(extent)) if extent > 0 else 6, 2, 10))


def _rounded(values: Array, digits: int) -> list[float]:
    found: list[float] = (np.round(values, digits) + 0.0).tolist()
    return found


def _finite(value: float | None) -> float | None:
    return value if value is not None and np.isfinite(value) else None
