"""Where every piece of a result comes from, and how sure its choice was."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget.face.curve import Curve
from physretarget.face.library import Library
from physretarget.face.place import Placed
from physretarget.face.screen import Method, ScreenSettings, Windows, fit_windows
from physretarget.face.templates import Bank

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Piece:
    """One segment of a result and its origin.

    start, end: seconds in the take. shot, channel, source_start, source_end: the segment in the
    library (s). stretch: duration here over duration there. amplitude: height here over there.
    error: root mean square misfit as a fraction of what the channel moves. margin: how much worse,
    relatively, the next different template fits; low_margin: too little to be sure.
    fitted: a gap that the paper's placement left open. alike: how many segments share the shape.
    """

    start: float
    end: float
    shot: str
    channel: str
    source_start: float
    source_end: float
    keys: int
    stretch: float
    amplitude: float
    error: float
    margin: float
    low_margin: bool
    fitted: bool
    alike: int


def explain(
    placed: list[Placed],
    table: Array,
    piece_of: tuple[int, ...],
    bank: Bank,
    library: Library,
    values: Array,
    smooth: Array,
    fps: float,
    start: float,
    method: Method,
    screen: ScreenSettings,
    low_margin: float,
) -> tuple[Piece, ...]:
    """One Piece for every placed template."""
    output = Curve.from_table(table).evaluate(np.arange(len(values), dtype=np.float64))
    squared = (output - values) ** 2
    pieces = []
    for piece in placed:
        template = (bank.phrases if piece.phrase else bank.spans)[piece.template]
        seconds = (piece.last - piece.first) / fps
        which = template.nearest(seconds)
        source = template.segments[which].tolist()
        example = library.examples[source[0]]
        first, last = example.curve.keys[source[1]], example.curve.keys[source[2]]
        margin = _margin(piece, bank, values, smooth, method, screen)
        height = float(np.ptp(output[piece.first : piece.last + 1]))
        there = float(template.amplitudes[which])
        error = float(np.sqrt(squared[piece.first : piece.last + 1].mean()))
        pieces.append(
            Piece(
                start + piece.first / fps,
                start + piece.last / fps,
                example.shot,
                example.channel,
                first.time,
                last.time,
                template.keys,
                seconds / float(template.durations[which]),
                height / there if there > 0 else 1.0,
                error,
                margin,
                bool(margin < low_margin),
                piece.fitted,
                len(template.segments),
            )
        )
    return tuple(pieces)


def _margin(
    piece: Placed, bank: Bank, values: Array, smooth: Array, method: Method, screen: ScreenSettings
) -> float:
    """Relative distance in error to the best other template of the same kind on the same frames."""
    n = piece.last - piece.first
    amplitudes = None
    if piece.phrase:
        most = np.array([t.amplitudes.max() for t in bank.phrases], dtype=np.float32)
        amplitudes = (np.zeros_like(most), most * np.float32(screen.amplitude[1]))
    shapes = bank.phrase_shapes(n) if piece.phrase else bank.span_shapes(n)
    if len(shapes) < 2:
        return 1.0
    capture = Windows.of(values[None], smooth[None], np.ones((1, len(values))))
    fit = fit_windows(
        capture,
        np.array([piece.first]),
        n,
        shapes,
        "distance",
        screen,
        amplitudes,
    )
    errors = np.sqrt(fit.squared[0].astype(np.float64))
    own = errors[piece.template]
    other = float(np.delete(errors, piece.template).min())
    return float(max(0.0, (other - own) / max(other, 1e-9)))
