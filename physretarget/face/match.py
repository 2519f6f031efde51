"""A take in, an animator's curves out, and for every span where it comes from."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from physretarget.errors import InputError
from physretarget.face.borrowed import as_the_paper
from physretarget.face.bound import bounded
from physretarget.face.curve import Curve, Key
from physretarget.face.job import Banks, Draft, Job, check_locked, prepare
from physretarget.face.keyed import by_programme
from physretarget.face.library import Library
from physretarget.face.result import DOUBT, ChannelResult, MatchSettings, Result
from physretarget.face.rig import Rig
from physretarget.face.shot import Take
from physretarget.face.sources import Piece
from physretarget.face.warp import within_range

__all__ = ["DOUBT", "Banks", "ChannelResult", "MatchSettings", "Result", "match"]

Array = NDArray[np.float64]


def match(
    capture: Take,
    library: Library,
    rig: Rig,
    settings: MatchSettings | None = None,
    *,
    span: tuple[float, float] | None = None,
    locked: Mapping[str, Sequence[Key]] | None = None,
    banks: Banks | None = None,
    progress: Callable[[str], None] = lambda channel: None,
) -> Result:
    """Match every channel of a rig against a library.

    Args:
        capture: dense take on the capture's channels.
        library: past shots.
        rig: which capture channels drive which rig channels.
        settings: sliders and method.
        span: match only between these times (s); curves then end on the capture there.
        locked: per rig channel, keys that stay exactly as they are.
        banks: what was made of the same library in an earlier call.
        progress: told what is being done.

    Returns:
        Curves, sources and doubts of every channel.

    Raises:
        InputError: channels that the capture lacks, locked keys outside the take or of unknown
            channels, or a library without a curve that moves.
    """
    chosen = settings or MatchSettings()
    driven = rig.drive(capture)
    if span is not None:
        driven = driven.between(*span)
    matched = rig.matched(lips=chosen.lips)
    check_locked(locked or {}, matched, driven)
    notes = driven.notes
    if not matched:
        notes += ("Nothing was matched: lips are left to the capture unless asked for.",)
    dense = {
        c.name: Curve.through(driven.time, driven.channel(c.name), "linear")
        for c in rig.channels
        if c not in matched
    }
    if not matched:
        return Result(driven, {}, chosen, notes, dense)
    bare = _without_shots(library, rig, list(dict.fromkeys(c.group for c in matched)))
    notes += tuple(
        f"Group {group}: the library has no shot for it; its keys come from the capture alone."
        for group in bare
    )
    job = prepare(driven, matched, locked or {})
    kept = banks or Banks()
    borrowing = [
        row
        for row, c in enumerate(matched)
        if chosen.preset == "ruhland2017" and c.group not in bare
    ]
    drafts: dict[int, Draft] = {}
    for make, rows in (
        (as_the_paper, borrowing),
        (by_programme, [r for r in range(len(matched)) if r not in borrowing]),
    ):
        made = make(job.part(rows), library, rig, chosen, kept, progress) if rows else []
        drafts |= dict(zip(rows, made, strict=True))
    results = {c.name: _finish(job, row, drafts[row], chosen) for row, c in enumerate(matched)}
    return Result(driven, results, chosen, notes, dense)


def _without_shots(library: Library, rig: Rig, groups: Sequence[str]) -> list[str]:
    """Groups that may borrow from no curve of the library."""
    if not library.examples:
        raise InputError("the library holds no segment that moves.")
    return [g for g in groups if not any(rig.borrows(g, e.channel) for e in library.examples)]


def _finish(job: Job, row: int, draft: Draft, settings: MatchSettings) -> ChannelResult:
    """Within the range and the bound, then in the rig's units and the take's time."""
    channel, unit, base = job.channels[row], float(job.unit[row]), float(job.base[row])
    values, smooth = job.values[row], job.smooth[row]
    lower, upper = (channel.lower - base) / unit, (channel.upper - base) / unit
    broken, held = draft.broken, draft.held
    table = draft.table
    if not draft.finished:
        table = within_range(table, ~broken, held, lower, upper)
    if settings.max_error is not None:
        table, broken, held = bounded(table, broken, held, values, smooth, settings.max_error)
        table = within_range(table, ~broken, held, lower, upper)
        table, broken, held = bounded(table, broken, held, values, smooth, settings.max_error)
    frames = np.arange(len(values), dtype=np.float64)
    off = Curve.from_table(table).evaluate(frames) - values
    pieces = tuple(_measured(p, off, job.take) for p in draft.pieces)
    scaled = table * np.array([1.0 / job.take.fps, unit] * 3)
    scaled[:, 0] += job.take.time[0]
    scaled[:, 1] += base
    kinds = [("fixed", "fixed", bool(b)) for b in broken]
    curve = Curve.from_table(scaled, kinds)  # type: ignore[arg-type]
    keys = list(curve.keys)
    for k in np.flatnonzero(held).tolist():
        own = job.locked[row][round(float(table[k, 0]))]
        keys[k] = own.scaled_to(1.0 / job.take.fps, unit).moved(job.take.time[0], base)
    piece_of = _piece_of([k.time for k in keys], pieces)
    rms = float(np.sqrt(np.mean(off**2)))
    return ChannelResult(
        replace(curve, keys=tuple(keys)), pieces, piece_of, rms, unit,
        tuple(np.flatnonzero(held).tolist()),
    )  # fmt: skip


def _measured(piece: Piece, off: Array, take: Take) -> Piece:
    first = math.floor((piece.start - take.time[0]) * take.fps + 0.5)
    last = math.floor((piece.end - take.time[0]) * take.fps + 0.5)
    part = off[max(first, 0) : last + 1]
    return replace(piece, error=float(np.sqrt(np.mean(part**2))) if len(part) else 0.0)


def _piece_of(times: list[float], pieces: tuple[Piece, ...]) -> tuple[int, ...]:
    ends = np.array([p.end for p in pieces])
    found = np.searchsorted(ends, np.array(times) - 1e-9)
    return tuple(np.minimum(found, len(pieces) - 1).tolist())
