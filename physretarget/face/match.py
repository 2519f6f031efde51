"""A take in, an animator's curves out, and for every key where it comes from."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from physretarget.errors import InputError, UsageError
from physretarget.face.cover import CoverSettings, Job, cover
from physretarget.face.curve import Curve, Key
from physretarget.face.explain import Piece, explain, runners_up
from physretarget.face.greedy import greedy_cover
from physretarget.face.join import assemble
from physretarget.face.library import Library
from physretarget.face.noise import measure_noise, reliability, smoothed
from physretarget.face.place import Placed
from physretarget.face.rig import Rig, RigChannel
from physretarget.face.screen import ScreenSettings
from physretarget.face.shot import Shot, Take
from physretarget.face.templates import Bank, make_bank
from physretarget.face.warp import fit, within_range
from physretarget.options.facial import MatchOptions

Array = NDArray[np.float64]
Banks = dict[tuple[str, ...], Bank]
STRETCHES = ("uniform", "middle")


@dataclass(frozen=True, kw_only=True)
class MatchSettings(MatchOptions):
    """The animator's two sliders and what else can be chosen.

    fidelity: misfit, as a fraction of what the channel moves, that is worth one unit of price: low
    replicates the capture, high deviates (the paper's threshold). key_cost: price of one key: low
    is dense, high sparse. placement: ``optimal``, the paper's ``greedy``, or ``joint``:
    optimal for each rig group together, its channels keyed at one time but for small lags.
    phrases: the optimal one may take segments of more than two keys as well, at twice the time.
    stretch: of phrases in time, ``uniform`` or, after Keogh, of their ``middle`` alone.
    trust: weigh frames by the jitter measured from the capture. turns, rests: how much cheaper, in
    prices of a key, cuts at turning points and at the ends of rests are.
    lips: match them too. least_confidence: pieces below it are flagged as doubtful.
    """

    phrases: bool = False
    stretch: str = "uniform"
    trust: bool = True
    turns: float = 0.25
    rests: float = 0.0
    least_confidence: float = 0.3
    screen: ScreenSettings = field(default_factory=ScreenSettings)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.stretch not in STRETCHES:
            raise UsageError(f"stretch is {self.stretch!r}; it is one of {', '.join(STRETCHES)}.")


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
    """Every matched channel, the capture it was matched to and the settings."""

    take: Take
    channels: Mapping[str, ChannelResult]
    settings: MatchSettings
    notes: tuple[str, ...] = ()

    def shot(self) -> Shot:
        """The curves alone, ready for a writer."""
        curves = {name: c.curve for name, c in self.channels.items()}
        return Shot(self.take.name, curves, self.take.fps, self.take.sha256, self.notes)

    @property
    def keys(self) -> int:
        """How many keys all channels have together."""
        return sum(len(c.curve.keys) for c in self.channels.values())

    @property
    def reduction(self) -> float:
        """Share of the capture's frames that are keys no more."""
        dense = len(self.take.time) * max(1, len(self.channels))
        return 1.0 - self.keys / dense


@dataclass(frozen=True, eq=False)
class _Group:
    """Channels that share a bank, in units of what each moves."""

    channels: list[RigChannel]
    dense: Job
    unit: Array
    base: Array
    locked: list[dict[int, Key]] = field(default_factory=list)


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
        banks: templates kept between calls with the same library.
        progress: told each group's name.

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
    kept = {} if banks is None else banks
    results: dict[str, ChannelResult] = {}
    borrowing: dict[tuple[str, ...], list[RigChannel]] = {}
    for channel in matched:
        borrowing.setdefault(tuple(rig.library.get(channel.group, ())), []).append(channel)
    for members in borrowing.values():  # groups that borrow from the same are matched at once
        progress(", ".join(dict.fromkeys(c.group for c in members)))
        phrases = chosen.phrases or chosen.placement == "greedy"
        bank = _bank(library, rig, members[0].group, phrases, chosen.stretch == "middle", kept)
        results |= _group(driven, members, bank, library, chosen, locked or {})
    ordered = {c.name: results[c.name] for c in matched}
    notes = driven.notes
    if not matched:
        notes += ("Nothing was matched: lips are left to the capture unless asked for.",)
    return Result(driven, ordered, chosen, notes)


def _bank(
    library: Library, rig: Rig, group: str, phrases: bool, middle: bool, banks: Banks
) -> Bank:
    patterns = tuple(rig.library.get(group, ()))
    wanted = (*patterns, str(phrases), str(middle))
    if wanted not in banks:
        banks[wanted] = make_bank(
            library, lambda name: rig.borrows(group, name), phrases=phrases, middle=middle
        )
    bank = banks[wanted]
    if not bank.spans:
        asked = f" for group {group} ({', '.join(patterns)})" if patterns else ""
        raise InputError(f"the library holds no segment that moves{asked}.")
    return bank


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
    take: Take, channels: list[RigChannel], locked: Mapping[str, Sequence[Key]], fidelity: float
) -> _Group:
    values = np.stack([take.channel(c.name) for c in channels])
    moved = np.ptp(values, axis=1)
    ranges = np.array([c.range for c in channels])
    unit = np.clip(moved, 0.05 * ranges, ranges)  # a channel at rest is not blown up to its noise
    base = values.min(axis=1)
    relative = (values - base[:, None]) / unit[:, None]
    smooth = smoothed(relative, take.fps)
    weight = np.stack(
        [
            reliability(s, measure_noise(v, s, take.fps), fidelity)
            for v, s in zip(relative, smooth, strict=True)
        ]
    )
    barred = np.zeros(values.shape, dtype=bool)
    pinned: list[dict[int, Key]] = []
    for row, channel in enumerate(channels):
        frames: dict[int, Key] = {}
        for key in locked.get(channel.name, ()):
            frame = round((key.time - take.time[0]) * take.fps)
            frame = min(max(frame, 0), values.shape[1] - 1)
            frames[frame] = key
            smooth[row, frame] = (key.value - base[row]) / unit[row]
            barred[row, frame] = True
        pinned.append(frames)
    return _Group(channels, Job(relative, smooth, weight, barred), unit, base, pinned)


def _group(
    take: Take,
    channels: list[RigChannel],
    bank: Bank,
    library: Library,
    settings: MatchSettings,
    locked: Mapping[str, Sequence[Key]],
) -> dict[str, ChannelResult]:
    job = _prepare(take, channels, locked, settings.fidelity)
    if not settings.trust:
        job.dense.weight[:] = 1.0
    prices = CoverSettings(
        fidelity=settings.fidelity,
        key_cost=settings.key_cost,
        phrases=settings.phrases,
        turns=settings.turns,
        rests=settings.rests,
    )
    place = greedy_cover if settings.placement == "greedy" else cover
    together = _rows_by_group(job) if settings.placement == "joint" else []
    covered = place(job.dense, take.fps, bank, settings.method, prices, settings.screen, together)
    placed = covered.chains
    last = len(take.time) - 1
    for row in np.flatnonzero(np.ptp(job.dense.values, axis=1) < 1e-9).tolist():
        if not job.locked[row]:  # a channel at rest is one hold, however long
            placed[row] = [Placed(0, last, 0)]
    others = runners_up(placed, job.dense, take.fps, bank, settings.method, prices, settings.screen)
    by_row: list[dict[int, tuple[int, float]]] = [{} for _ in channels]
    for (row, first), other in others.items():
        by_row[row][first] = other
    return {
        channel.name: _channel(
            take, job, row, placed[row], bank, library, settings, by_row[row],
            covered.confidence[row],
        )
        for row, channel in enumerate(channels)
    }  # fmt: skip


def _rows_by_group(job: _Group) -> list[list[int]]:
    """Rows of channels that share a rig group and move at all."""
    groups: dict[str, list[int]] = {}
    for row, channel in enumerate(job.channels):
        if np.ptp(job.dense.values[row]) >= 1e-9 and not job.locked[row]:
            groups.setdefault(channel.group, []).append(row)
    return [rows for rows in groups.values() if len(rows) > 1]


def _channel(
    take: Take,
    job: _Group,
    row: int,
    placed: list[Placed],
    bank: Bank,
    library: Library,
    settings: MatchSettings,
    others: dict[int, tuple[int, float]],
    confidence: Array,
) -> ChannelResult:
    channel, unit, base = job.channels[row], job.unit[row], job.base[row]
    pinned = {
        frame: replace(
            key.moved(-take.time[0], -base).scaled_to(take.fps, 1.0 / unit), time=float(frame)
        )
        for frame, key in job.locked[row].items()
    }
    draft, piece_of = assemble(
        placed, bank, take.fps, job.dense.smooth[row], pinned, settings.method
    )
    table = fit(draft, job.dense.values[row], settings.fidelity, job.dense.weight[row])
    lower, upper = (channel.lower - base) / unit, (channel.upper - base) / unit
    table = within_range(table, draft.join & ~draft.held, draft.held, lower, upper)
    pieces = explain(
        placed,
        table,
        bank,
        library,
        job.dense.values[row],
        take.fps,
        take.time[0],
        others,
        confidence,
        settings.least_confidence,
    )
    unitless = Curve.from_table(table)
    error = unitless.evaluate(np.arange(len(take.time), dtype=np.float64)) - job.dense.values[row]
    scaled = table * np.array([1.0 / take.fps, unit] * 3)
    scaled[:, 0] += take.time[0]
    scaled[:, 1] += base
    kinds = [("fixed", "fixed", not joined) for joined in draft.join]
    curve = Curve.from_table(scaled, kinds)  # type: ignore[arg-type]
    keys = list(curve.keys)
    for k in np.flatnonzero(draft.held):
        keys[k] = job.locked[row][round(float(table[k, 0]))]
    curve = replace(curve, keys=tuple(keys))
    kept = tuple(np.flatnonzero(draft.held).tolist())
    rms = float(np.sqrt(np.mean(error**2)))
    return ChannelResult(curve, pieces, piece_of, rms, float(unit), kept)
