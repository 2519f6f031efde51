"""A take in, an animator's curves out, and for every span where it comes from."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from physretarget.errors import InputError
from physretarget.face.bound import bounded
from physretarget.face.curve import Curve, Key
from physretarget.face.keyfit import Chain, key_table
from physretarget.face.library import Library
from physretarget.face.noise import noise_level, smoothed
from physretarget.face.programme import ProgrammeSettings, Score, programme, whole_rest
from physretarget.face.rig import Rig, RigChannel
from physretarget.face.ruhland import (
    EXACT,
    Claim,
    Entry,
    PaperSettings,
    claims,
    dictionary,
    warp,
)
from physretarget.face.shot import Shot, Take
from physretarget.face.sources import Piece, Shapes, named, span_sources
from physretarget.face.spans import HOLD, KINDS
from physretarget.face.style import Clues, Style, keyed_by, learn
from physretarget.face.warp import within_range
from physretarget.options.facial import MatchOptions

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
DOUBT = 0.5
"""A span is doubtful if a key within a thirtieth of a second of an end is less likely than this."""


@dataclass(frozen=True, kw_only=True)
class MatchSettings(MatchOptions):
    """What the options leave out. doubt: see DOUBT. learned: let the library teach where keys go;
    without, the programme alone decides (the control).
    """

    doubt: float = DOUBT
    learned: bool = True


@dataclass(frozen=True)
class ChannelResult:
    """One matched channel.

    curve in the rig's units and the take's time; pieces in order; piece_of: per key the piece that
    ends there (the first key: that begins there); error: root mean square deviation from the
    capture as a fraction of unit; unit: what the channel moves; locked: numbers of the keys that
    were kept as they are.
    """

    curve: Curve
    pieces: tuple[Piece, ...]
    piece_of: tuple[int, ...]
    error: float
    unit: float
    locked: tuple[int, ...] = ()


@dataclass(frozen=True)
class Result:
    """Every matched channel, the capture it was matched to and the settings.

    dense: channels that are left to the capture, one key a frame.
    """

    take: Take
    channels: Mapping[str, ChannelResult]
    settings: MatchSettings
    notes: tuple[str, ...] = ()
    dense: Mapping[str, Curve] = field(default_factory=dict)

    def shot(self) -> Shot:
        """All curves, ready for a writer."""
        curves = {name: c.curve for name, c in self.channels.items()} | dict(self.dense)
        return Shot(self.take.name, curves, self.take.fps, self.take.sha256, self.notes)

    @property
    def keys(self) -> int:
        """How many keys all matched channels have together."""
        return sum(len(c.curve.keys) for c in self.channels.values())

    @property
    def reduction(self) -> float:
        """Share of the capture's frames that are keys no more."""
        dense = len(self.take.time) * max(1, len(self.channels))
        return 1.0 - self.keys / dense


@dataclass(frozen=True, eq=False)
class Banks:
    """What is made of a library once and kept between calls: shapes, dictionaries, styles."""

    shapes: dict[tuple[str, ...], Shapes] = field(default_factory=dict)
    entries: dict[tuple[object, ...], list[Entry]] = field(default_factory=dict)
    styles: dict[tuple[float, ProgrammeSettings], Style | None] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _Job:
    """Channels (C, M) in units of what each moves; locked keys by frame, in the same units."""

    take: Take
    channels: Sequence[RigChannel]
    values: Array
    smooth: Array
    level: Array
    unit: Array
    base: Array
    locked: list[dict[int, Key]]

    def part(self, rows: list[int]) -> _Job:
        """Some of the channels."""
        return replace(
            self,
            channels=[self.channels[r] for r in rows],
            locked=[self.locked[r] for r in rows],
            **{n: getattr(self, n)[rows] for n in ("values", "smooth", "level", "unit", "base")},
        )


@dataclass(frozen=True, eq=False)
class _Draft:
    """A channel's keys (K, 6) in frames and units, where they may break, which are locked."""

    table: Array
    broken: Flags
    held: Flags
    pieces: tuple[Piece, ...]
    finished: bool = False  # a past curve as it was: nothing is cut off


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
            channels, or a library without a usable segment.
    """
    chosen = settings or MatchSettings()
    driven = rig.drive(capture)
    if span is not None:
        driven = driven.between(*span)
    matched = rig.matched(lips=chosen.lips)
    _check_locked(locked or {}, matched, driven)
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
    for group in dict.fromkeys(c.group for c in matched):
        _check_library(library, rig, group)
    job = _prepare(driven, matched, locked or {})
    kept = banks or Banks()
    make = _as_the_paper if chosen.preset == "ruhland2017" else _by_programme
    drafts = make(job, library, rig, chosen, kept, progress)
    results = {
        channel.name: _finish(job, row, draft, chosen)
        for row, (channel, draft) in enumerate(zip(matched, drafts, strict=True))
    }
    return Result(driven, results, chosen, notes, dense)


def _check_library(library: Library, rig: Rig, group: str) -> None:
    if not any(rig.borrows(group, e.channel) for e in library.examples):
        patterns = rig.library.get(group, ())
        asked = f" for group {group} ({', '.join(patterns)})" if patterns else ""
        raise InputError(f"the library holds no segment that moves{asked}.")


def _check_locked(
    locked: Mapping[str, Sequence[Key]], channels: Sequence[RigChannel], take: Take
) -> None:
    names = [c.name for c in channels]
    for name, keys in locked.items():
        if name not in names:
            raise InputError(f"locked keys of {name}; matched are {', '.join(names)}.")
        for key in keys:
            if not take.time[0] - 1e-6 <= key.time <= take.time[-1] + 1e-6:
                raise InputError(
                    f"the locked key of {name} at {key.time:g} s lies outside the take "
                    f"({take.time[0]:g}–{take.time[-1]:g} s)."
                )


def _prepare(
    take: Take, channels: Sequence[RigChannel], locked: Mapping[str, Sequence[Key]]
) -> _Job:
    values = np.stack([take.channel(c.name) for c in channels])
    moved = np.ptp(values, axis=1)
    ranges = np.array([c.range for c in channels])
    unit = np.clip(moved, 0.05 * ranges, ranges)  # a channel at rest is not blown up to its noise
    base = values.min(axis=1)
    relative = (values - base[:, None]) / unit[:, None]
    smooth = smoothed(relative, take.fps)
    pinned: list[dict[int, Key]] = []
    for row, channel in enumerate(channels):
        frames: dict[int, Key] = {}
        for key in locked.get(channel.name, ()):
            frame = round((key.time - take.time[0]) * take.fps)
            scaled = key.moved(-take.time[0], -base[row]).scaled_to(take.fps, 1.0 / unit[row])
            frames[min(max(frame, 0), values.shape[1] - 1)] = scaled
        pinned.append(frames)
    level = noise_level(relative, smooth, take.fps)
    return _Job(take, channels, relative, smooth, level, unit, base, pinned)


def _by_programme(
    job: _Job,
    library: Library,
    rig: Rig,
    settings: MatchSettings,
    banks: Banks,
    progress: Callable[[str], None],
) -> list[_Draft]:
    """The default: keys where the take's own likelihood and prices put them."""
    wanted = ProgrammeSettings(key_price=settings.key_cost, level=settings.fidelity)
    pinned = [list(frames) for frames in job.locked]
    scores = _scores(job, library, settings, wanted, pinned, banks, progress)
    drafts = []
    for row, (channel, score) in enumerate(zip(job.channels, scores, strict=True)):
        whole = _from_itself(job, row, library, rig, banks)
        if whole:
            drafts.append(_draft_of_claims(job, row, whole, library))
            continue
        still = np.ptp(job.values[row]) < 1e-9 and not job.locked[row]
        chain = whole_rest(len(job.take.time)) if still else score.chain
        patterns = tuple(rig.library.get(channel.group, ()))
        if patterns not in banks.shapes:
            banks.shapes[patterns] = Shapes.of(
                library,
                lambda name, g=channel.group: rig.borrows(g, name),  # type: ignore[misc]
            )
        drafts.append(
            _draft_of_chain(job, row, chain, score, library, banks.shapes[patterns], settings)
        )
    return drafts


def _scores(
    job: _Job,
    library: Library,
    settings: MatchSettings,
    wanted: ProgrammeSettings,
    pinned: list[list[int]],
    banks: Banks,
    progress: Callable[[str], None],
) -> list[Score]:
    """The programme's, and the style's where the library has one; channels at rest stay at rest."""
    style = None
    fps = round(job.take.fps, 3)
    if settings.learned:
        if (fps, wanted) not in banks.styles:
            banks.styles[fps, wanted] = learn(library, fps, wanted, progress=progress)
        style = banks.styles[fps, wanted]
    progress(f"{len(job.channels)} channels")
    scores = programme(job.values, job.take.fps, wanted, pinned=pinned)
    if style is None:
        return scores
    keyed = keyed_by(style, Clues(scores, job.values, job.take.fps), pinned)
    rests = [(s.chain.kinds == HOLD).all() for s in scores]
    return [a if rest else b for a, b, rest in zip(scores, keyed, rests, strict=True)]


def _from_itself(job: _Job, row: int, library: Library, rig: Rig, banks: Banks) -> list[Claim]:
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
    job: _Job, row: int, library: Library, rig: Rig, banks: Banks, *, whole: bool = False
) -> list[Entry]:
    group = job.channels[row].group
    wanted = (*rig.library.get(group, ()), job.take.fps, whole)
    if wanted not in banks.entries:
        banks.entries[wanted] = dictionary(
            library, job.take.fps, lambda name: rig.borrows(group, name), whole=whole
        )
    return banks.entries[wanted]


def _draft_of_chain(
    job: _Job,
    row: int,
    chain: Chain,
    score: Score,
    library: Library,
    shapes: Shapes,
    settings: MatchSettings,
) -> _Draft:
    values, frames = job.values[row], chain.frames
    number = {int(f): k for k, f in enumerate(frames)}
    pins = {number[f]: key for f, key in job.locked[row].items() if f in number}
    chain = _free_holds(chain, pins)
    table = key_table(chain, values, score.weight, pins)
    held = np.array([k in pins for k in range(len(frames))], dtype=np.bool_)
    origins = span_sources(chain, values, score.weight, shapes)
    wide = 2 * max(1, round(job.take.fps / 30.0)) + 1  # frames: a thirtieth of a second either way
    near = np.convolve(score.likely, np.ones(wide), mode="same")[: len(score.likely)]
    near[[0, -1]] = 1.0
    time = job.take.time
    pieces = []
    for k, (origin, margin) in enumerate(origins):
        first, last = int(frames[k]), int(frames[k + 1])
        kind = KINDS[chain.kinds[k]].name
        sure = float(min(1.0, near[first], near[last]))
        piece = Piece(float(time[first]), float(time[last]), kind, confidence=sure, margin=margin)
        told = {}
        if origin is not None:
            height = abs(float(table[k + 1, 1] - table[k, 1])) * float(job.unit[row])
            told = named(piece, origin, library, height)
        doubtful = kind != KINDS[HOLD].name and sure < settings.doubt
        pieces.append(replace(piece, doubtful=doubtful, **told))  # type: ignore[arg-type]
    return _Draft(table, _corners(table) | held, held, tuple(pieces))


def _free_holds(chain: Chain, pins: Mapping[int, Key]) -> Chain:
    """A hold between locked keys of different values is none."""
    kinds = chain.kinds.copy()
    for k in np.flatnonzero(kinds == HOLD).tolist():
        if k in pins or k + 1 in pins:
            kinds[k] = 0
    return Chain(chain.frames, kinds)


def _corners(table: Array) -> Flags:
    """(K,) whether the slopes on both sides of a key differ."""
    broken = np.zeros(len(table), dtype=np.bool_)
    inner = slice(1, -1)
    into = table[inner, 3] * table[inner, 4] - table[inner, 5] * table[inner, 2]
    size = np.abs(table[inner, 2] * table[inner, 4])
    broken[inner] = np.abs(into) > 1e-9 * np.maximum(size, 1e-12)
    return broken


def _as_the_paper(
    job: _Job,
    library: Library,
    rig: Rig,
    settings: MatchSettings,
    banks: Banks,
    progress: Callable[[str], None],
) -> list[_Draft]:
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
        drafts.append(_draft_of_claims(job, row, scaled, library))
    return drafts


def _draft_of_claims(job: _Job, row: int, found: list[Claim], library: Library) -> _Draft:
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
    for keys, claim, pin in blocks:
        keys = keys.copy()
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
    return _Draft(table, _corners(table) | locked, locked, tuple(pieces), done)


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


def _gap_piece(job: _Job, first: float, last: float, moves: bool) -> Piece:
    start, step = float(job.take.time[0]), 1.0 / job.take.fps
    kind = "gap" if moves else KINDS[HOLD].name
    return Piece(start + float(first) * step, start + float(last) * step, kind, fitted=moves)


def _claim_piece(job: _Job, row: int, claim: Claim, keys: Array, library: Library) -> Piece:
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


def _finish(job: _Job, row: int, draft: _Draft, settings: MatchSettings) -> ChannelResult:
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
