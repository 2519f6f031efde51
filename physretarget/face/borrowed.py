"""Keys that are borrowed: segments of past curves laid over a channel, and gaps between them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from physretarget.face.job import Banks, Draft, Job, corners
from physretarget.face.library import Library
from physretarget.face.result import MatchSettings
from physretarget.face.rig import Rig
from physretarget.face.ruhland import claims, warp
from physretarget.face.segments import EXACT, Claim, Entry, PaperSettings, dictionary
from physretarget.face.sources import Piece
from physretarget.face.spans import HOLD, KINDS

Array = NDArray[np.float64]
_ON_FRAME = 1e-6  # frames by which a key's time may be rounded


def as_the_paper(
    job: Job,
    library: Library,
    rig: Rig,
    settings: MatchSettings,
    banks: Banks,
    progress: Callable[[str], None],
) -> list[Draft]:
    """Longest segments first; what nobody claims is deleted."""
    wanted = PaperSettings(
        method=settings.method, threshold=settings.tau, word=settings.word,
        alphabet=settings.alphabet,
    )  # fmt: skip
    drafts = []
    for row, channel in enumerate(job.channels):
        progress(channel.name)
        # Offsets and heights are the library's: matching is in the rig's own units.
        found = claims(
            job.values[row] * job.unit[row],
            _entries(job, row, library, rig, banks),
            float(job.unit[row]),
            wanted,
            taken=list(job.locked[row]),
        )
        scaled = [_in_units(c, float(job.unit[row])) for c in found]
        drafts.append(draft_of_claims(job, row, scaled, library))
    return drafts


def from_itself(job: Job, row: int, library: Library, rig: Rig, banks: Banks) -> list[Claim]:
    """A curve of the library that the channel is, to within a thousandth of what it moves.

    Before and after it the channel may rest. A past shot that comes in as a capture so comes back
    as itself.
    """
    if np.ptp(job.values[row]) < 1e-9 or job.locked[row]:
        return []
    values, unit = job.values[row] * job.unit[row], float(job.unit[row])
    whole = [
        e
        for e in _entries(job, row, library, rig, banks, whole=True)
        if abs(float(np.ptp(e.samples)) - float(np.ptp(values))) <= 2 * EXACT * unit
    ]
    found = claims(values, whole, unit, PaperSettings(threshold=EXACT))
    free = np.ones(len(values), dtype=np.bool_)
    for claim in found:
        free[claim.first : claim.last] = False
    rests = np.abs(np.diff(job.values[row]))[free[:-1]].max(initial=0.0) < EXACT
    if not found or not rests:
        return []
    return [_in_units(claim, unit) for claim in found]


def _in_units(claim: Claim, unit: float) -> Claim:
    return replace(claim, table=claim.table * np.array([1.0, 1.0 / unit] * 3))


def _entries(
    job: Job, row: int, library: Library, rig: Rig, banks: Banks, *, whole: bool = False
) -> list[Entry]:
    group = job.channels[row].group
    wanted = (*rig.library.get(group, ()), job.take.fps, whole)
    if wanted not in banks.entries:
        banks.entries[wanted] = dictionary(
            library, job.take.fps, lambda name: rig.borrows(group, name), whole=whole
        )
    return banks.entries[wanted]


def draft_of_claims(job: Job, row: int, found: list[Claim], library: Library) -> Draft:
    """Claims, locked keys and the gaps between them, end to end."""
    smooth = job.smooth[row]
    slope, last = np.gradient(smooth), len(smooth) - 1
    blocks: list[tuple[Array, Claim | None, bool]] = []  # keys, of which claim, locked
    for one in found:
        blocks.append((warp(one, smooth, slope, 1.0), one, False))
    for frame, key in job.locked[row].items():
        pinned = np.array([[frame, key.value, *key.in_tangent, *key.out_tangent]])
        blocks.append((pinned, None, True))
    for frame in (0, last):
        if not any(abs(b[0][0, 0] - frame) < 1 or abs(b[0][-1, 0] - frame) < 1 for b in blocks):
            blocks.append((np.array([[frame, smooth[frame], 0, 0, 0, 0]]), None, False))
    blocks.sort(key=lambda b: (b[0][0, 0], b[0][-1, 0]))
    rows: list[Array] = []
    held: list[bool] = []
    pieces: list[Piece] = []
    end: int | None = None  # the frame that the claim before ends with
    for keys, claim, pin in blocks:
        keys = keys.copy()
        if claim is not None and claim.first == end:
            # Claims that share a frame may have keys between frames on its other side.
            rows = _cut_behind(rows, end, smooth, slope)
            held = [*held, False][: len(rows)]
            keys = _cut_before(keys, end, smooth, slope)
        end = None if claim is None else claim.last
        if rows:
            before = rows[-1]
            gap = keys[0, 0] - before[0]
            if gap > 0.5:
                moves = _bridge(before, keys[0], held[-1], pin, job.values[row], slope)
                pieces.append(_gap_piece(job, before[0], keys[0, 0], moves))
            else:  # neighbours share a key
                keys[0, 2:4] = before[2:4]
                rows.pop()
                held.pop()
        rows += list(keys)
        held += [pin] * len(keys)
        if claim is not None:
            pieces.append(_claim_piece(job, row, claim, keys, library))
    table = np.array(rows)
    locked = np.array(held, dtype=np.bool_)
    untouched = all(c.error < EXACT for c in found) and not any(p.fitted for p in pieces)
    done = bool(found) and untouched
    return Draft(table, corners(table) | locked, locked, tuple(pieces), done)


def _cut_behind(rows: list[Array], frame: int, smooth: Array, slope: Array) -> list[Array]:
    """Keys up to a frame, the last on it."""
    rows = [row for row in rows if row[0] <= frame + _ON_FRAME]
    if rows[-1][0] < frame - _ON_FRAME:
        rows.append(_key_at(frame, frame - float(rows[-1][0]), 0.0, smooth, slope))
    return rows


def _cut_before(keys: Array, frame: int, smooth: Array, slope: Array) -> Array:
    """Keys from a frame on, the first on it."""
    keys = keys[keys[:, 0] >= frame - _ON_FRAME]
    if not len(keys) or keys[0, 0] > frame + _ON_FRAME:
        run = float(keys[0, 0]) - frame if len(keys) else 0.0
        keys = np.vstack([_key_at(frame, 0.0, run, smooth, slope), keys])
    return keys


def _key_at(frame: int, before: float, after: float, smooth: Array, slope: Array) -> Array:
    """A key on the capture, its handles a third of the spans beside it."""
    steep = float(slope[frame])
    value = float(smooth[frame])
    return np.array([frame, value, -before / 3, -before / 3 * steep, after / 3, after / 3 * steep])


def _bridge(
    before: Array, after: Array, first: bool, second: bool, values: Array, slope: Array
) -> bool:
    """One span over a gap, its slopes the capture's; a locked key keeps its tangents.

    Returns whether anything moves there.
    """
    run = after[0] - before[0]
    ends = [min(max(round(float(k[0])), 0), len(slope) - 1) for k in (before, after)]
    moved = float(np.ptp(values[ends[0] : ends[1] + 1]))
    for key, frame, columns, pin, sign in (
        (before, ends[0], slice(4, 6), first, 1.0),
        (after, ends[1], slice(2, 4), second, -1.0),
    ):
        if pin:
            continue
        steep = float(slope[frame]) if moved > EXACT else 0.0
        key[columns] = sign * run / 3.0 * np.array([1.0, steep])
    return moved > EXACT


def _gap_piece(job: Job, first: float, last: float, moves: bool) -> Piece:
    start, step = float(job.take.time[0]), 1.0 / job.take.fps
    kind = "gap" if moves else KINDS[HOLD].name
    return Piece(start + float(first) * step, start + float(last) * step, kind, fitted=moves)


def _claim_piece(job: Job, row: int, claim: Claim, keys: Array, library: Library) -> Piece:
    same = [claim.entry.segment, *claim.entry.copies]
    name = job.channels[row].name
    segment = next((s for s in same if library.examples[s.example].channel == name), same[0])
    example = library.examples[segment.example]
    own = example.curve.keys[segment.first : segment.last + 1]
    there = float(np.ptp(claim.entry.samples))
    here = float(np.ptp(keys[:, 1])) * float(job.unit[row])
    start, step = float(job.take.time[0]), 1.0 / job.take.fps
    return Piece(
        start=start + float(keys[0, 0]) * step,
        end=start + float(keys[-1, 0]) * step,
        kind="segment",
        shot=example.shot,
        channel=example.channel,
        source_start=own[0].time,
        source_end=own[-1].time,
        keys=len(keys),
        stretch=claim.stretch,
        amplitude=here / there if there > 0 else 1.0,
        error=claim.error,
        alike=len(same),
    )
