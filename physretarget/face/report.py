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
from physretarget.files import write_file

Array = NDArray[np.float64]
SpanKind = Literal["matched", "fitted", "locked", "reduced"]
"""matched: borrowed from a shot; fitted: nothing in the library suited, so a span was fitted;
locked: the animator's own keys, kept; reduced: made by plain key reduction."""


@dataclass(frozen=True)
class Origin:
    """Where a span's shape comes from.

    start, end: seconds in the shot. scale: result length over example length. error: misfit as a
    fraction of the channel's range. margin: how much worse the runner-up was, same unit; None
    where there was none. runner_up: its shot and channel. example: the borrowed keys themselves.
    """

    shot: str
    channel: str
    start: float
    end: float
    scale: float
    error: float
    margin: float | None = None
    runner_up: str = ""
    example: Curve | None = None


@dataclass(frozen=True)
class SourceSpan:
    """Seconds [start, end] of the result; ``low`` flags a margin too small to trust."""

    start: float
    end: float
    kind: SpanKind
    origin: Origin | None = None
    low: bool = False


@dataclass(frozen=True, eq=False)
class ChannelReport:
    """One channel: capture (T,) on the take's times, the result, and its spans in order."""

    name: str
    group: str
    lower: float
    upper: float
    capture: Array
    result: Curve
    spans: tuple[SourceSpan, ...] = ()
    error: float | None = None
    timing: float | None = None


@dataclass(frozen=True, eq=False)
class TakeReport:
    """Everything on the page.

    figures: label → text at the top. comparison: rows of a table, first row its head. time (T,).
    """

    title: str
    method: str
    time: Array
    channels: tuple[ChannelReport, ...]
    figures: Mapping[str, str] = field(default_factory=dict)
    comparison: Sequence[Sequence[str]] = ()
    notes: Sequence[str] = ()


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
            "error": round(origin.error, 6),
            "margin": None if origin.margin is None else round(origin.margin, 6),
            "runner": origin.runner_up,
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
