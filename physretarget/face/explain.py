"""Where every piece of a result comes from, and how sure its choice was."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from physretarget.face.cover import CoverSettings, Job, unit_price
from physretarget.face.curve import Curve
from physretarget.face.library import Library
from physretarget.face.place import Placed
from physretarget.face.screen import (
    ScreenSettings,
    Windows,
    aligned_costs,
    lay,
    slack_of,
    window_costs,
)
from physretarget.face.templates import Bank, Template
from physretarget.options.facial import Method

Array = NDArray[np.float64]

_LONGEST = 20_000  # frames of a piece that runners-up are looked for


@dataclass(frozen=True)
class Piece:
    """One segment of a result and its origin.

    start, end: seconds in the take. shot, channel, source_start, source_end: the segment in the
    library (s). stretch: duration here over duration there. amplitude: height here over there.
    error: root mean square misfit as a fraction of what the channel moves. runner_up: a shot whose
    shape, another one, comes next; margin: by how much that is dearer, in prices of a key.
    confidence: share of all near-best placements that cut where this piece begins and ends, the
    lesser of both; None if the placement knows no others. doubtful: too little to rely on.
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
    runner_up: str
    margin: float
    confidence: float | None
    doubtful: bool
    fitted: bool
    alike: int


def runners_up(
    chains: list[list[Placed]],
    job: Job,
    fps: float,
    bank: Bank,
    method: Method,
    settings: CoverSettings,
    screen: ScreenSettings,
) -> dict[tuple[int, int], tuple[int, float]]:
    """Channel and first frame of every piece → next best template of its kind, how much dearer.

    Dearer in prices of a key, by the method's own measure. All pieces of one length at once.
    """
    alike: dict[tuple[bool, int], list[tuple[int, Placed]]] = {}
    for channel, chain in enumerate(chains):
        for piece in chain:
            alike.setdefault((piece.phrase, piece.last - piece.first), []).append((channel, piece))
    capture = Windows.of(job.values, job.smooth, job.weight)
    slack = slack_of(capture, screen) if method == "hmm" else None
    frames = job.values.shape[1]
    found: dict[tuple[int, int], tuple[int, float]] = {}
    for (phrase, n), members in alike.items():
        templates = bank.phrases if phrase else bank.spans
        if len(templates) < 2 or n > _LONGEST:
            continue  # a channel that rests for a long take: sampling all templates takes gigabytes
        amplitudes = None
        if phrase:
            most = np.array([t.amplitudes.max() for t in templates], dtype=np.float32)
            amplitudes = (np.zeros_like(most), most * np.float32(screen.amplitude[1]))
        shapes = bank.phrase_shapes(n, n / fps) if phrase else bank.span_shapes(n)
        starts = np.array([c * frames + p.first for c, p in members])
        laid = lay(capture, starts, n, shapes, method, screen, amplitudes)
        cost = window_costs(laid, method, screen)
        common = np.log([len(t.segments) for t in templates]) * settings.prior
        unit = float(unit_price(n, fps, settings))
        rows = np.arange(len(members))
        chosen = np.array([p.template for _, p in members])
        if slack is not None:
            limit = np.sort(cost - common / unit, axis=1)[:, 1:2] + common / unit
            limit[rows, chosen] = np.inf
            room = slack.windows(n)[:, [c for c, _ in members], [p.first for _, p in members]]
            cost = aligned_costs(
                laid, cost, room.astype(np.float32), limit.astype(np.float32), screen
            )
        price = cost * unit - common
        own = price[rows, chosen].copy()
        price[rows, chosen] = np.inf
        other = np.argmin(price, axis=1)
        dearer = np.maximum(price[rows, other] - own, 0.0) / settings.key_cost
        for row, (channel, piece) in enumerate(members):
            found[channel, piece.first] = int(other[row]), float(dearer[row])
    return found


def explain(
    chain: list[Placed],
    table: Array,
    bank: Bank,
    library: Library,
    values: Array,
    fps: float,
    start: float,
    others: dict[int, tuple[int, float]],
    confidence: Array,
    least: float,
) -> tuple[Piece, ...]:
    """One Piece for every placed template; others: first frame → runner-up; confidence (M,)."""
    output = Curve.from_table(table).evaluate(np.arange(len(values), dtype=np.float64))
    squared = (output - values) ** 2
    pieces = []
    for piece in chain:
        templates = bank.phrases if piece.phrase else bank.spans
        seconds = (piece.last - piece.first) / fps
        told = _origin(templates[piece.template], seconds, library)
        height = float(np.ptp(output[piece.first : piece.last + 1]))
        there = told.amplitude
        sure = float(min(confidence[piece.first], confidence[piece.last]))
        other, margin = others.get(piece.first, (-1, 0.0))
        name = _origin(templates[other], seconds, library).shot if other >= 0 else ""
        pieces.append(
            replace(
                told,
                start=start + piece.first / fps,
                end=start + piece.last / fps,
                amplitude=height / there if there > 0 else 1.0,
                error=float(np.sqrt(squared[piece.first : piece.last + 1].mean())),
                runner_up=name,
                margin=margin,
                confidence=sure if np.isfinite(sure) else None,
                doubtful=bool(sure < least),
                fitted=piece.fitted,
            )
        )
    return tuple(pieces)


def _origin(template: Template, seconds: float, library: Library) -> Piece:
    """The segment of a template that needs the least stretching; amplitude is its own."""
    which = template.nearest(seconds)
    index, left, right = template.segments[which].tolist()
    example = library.examples[index]
    first, last = example.curve.keys[left], example.curve.keys[right]
    return Piece(
        start=0.0,
        end=seconds,
        shot=example.shot,
        channel=example.channel,
        source_start=first.time,
        source_end=last.time,
        keys=template.keys,
        stretch=seconds / float(template.durations[which]),
        amplitude=float(template.amplitudes[which]),
        error=0.0,
        runner_up="",
        margin=0.0,
        confidence=None,
        doubtful=False,
        fitted=False,
        alike=len(template.segments),
    )
