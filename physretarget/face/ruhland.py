"""Ruhland, Prasad and McDonnell (2017) as written: segments of past curves claim their places.

The dictionary is every curve, halved again and again; the longest segment looks for its place
first, as it is and, after Keogh, with its middle stretched between the places of its first and
last quarter; the best place below the threshold is claimed, and so on. Three measures decide which
place is best: distance, SAX, or a hidden Markov model solved by Viterbi. What nobody claims is
deleted and becomes one span.

One threshold serves all: the misfit in the channel's values, as a fraction of its range. The
hidden Markov model's constants are lost from the paper's text; ours are a reconstruction.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from physretarget.face import hmm, sax
from physretarget.face.curve import Curve
from physretarget.face.distance import distance_profile
from physretarget.face.library import Library, Segment, halves
from physretarget.options.facial import Method

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
FACTORS = (0.5, 2.0)
"""Least and largest stretch in time, and ratio of amplitudes that SAX, blind to them, accepts."""
EXACT = 1e-3
"""Misfit over range below which a segment is the capture itself: its keys then stay untouched."""
_TRIED = 6  # places of a segment that Viterbi looks at: the likeliest at even pace
_NODES = 48  # points of a chain, at most


@dataclass(frozen=True, kw_only=True)
class PaperSettings:
    """method and threshold (tau); word, alphabet: of SAX; pace: the hidden Markov model's price of
    one frame off the even pace, per standard deviation of the channel.
    """

    method: Method = "distance"
    threshold: float = 0.05
    word: int = 8
    alphabet: int = 8
    pace: float = 0.05


@dataclass(frozen=True, eq=False)
class Entry:
    """A segment ready to match: keys in frames from its first, samples, and equal segments."""

    segment: Segment
    table: Array
    samples: Array
    copies: list[Segment]

    @property
    def last(self) -> int:
        """Frames from first to last sample."""
        return len(self.samples) - 1


@dataclass(frozen=True, eq=False)
class Claim:
    """Keys laid over frames first to last: (K, 6) in frames and values, before the warp."""

    entry: Entry
    first: int
    last: int
    table: Array
    error: float
    stretch: float


def dictionary(
    library: Library, fps: float, usable: Callable[[str], bool], *, whole: bool = False
) -> list[Entry]:
    """Every halved segment and every whole curve, longest first, copies once.

    A curve that begins between two frames is sampled as the capture would have sampled it, too.
    whole: whole curves alone.
    """
    found: dict[bytes, tuple[float, int, Entry]] = {}
    for index, example in enumerate(library.examples):
        keys = example.curve.keys
        if not usable(example.channel) or len(keys) < 2:
            continue
        cuts = {(0, len(keys) - 1)}
        if not whole:
            cuts |= set(halves(len(keys), library.settings.min_keys))
        for a, b in sorted(cuts):
            part = Curve(keys[a : b + 1], example.curve.weighted)
            for late in sorted({0.0, round(-part.start * fps % 1.0, 4) % 1.0}):
                count = int(np.floor((part.end - part.start) * fps - late + 1e-4)) + 1
                if count < 3:
                    continue
                table = part.table * np.array([fps, 1.0] * 3)
                table[:, 0] -= part.start * fps + late
                level = np.array([0.0, part.value[0], 0.0, 0.0, 0.0, 0.0])
                mark = np.round(np.append((table - level).ravel(), late), 5).tobytes()
                if mark in found:
                    found[mark][2].copies.append(Segment(index, a, b))
                    continue
                samples = part.evaluate(part.start + (late + np.arange(count)) / fps)
                entry = Entry(Segment(index, a, b), table, samples, [])
                found[mark] = (part.start - part.end, len(found), entry)
    return [entry for _, _, entry in sorted(found.values(), key=lambda f: f[:2])]


def claims(
    values: Array,
    entries: Sequence[Entry],
    unit: float,
    settings: PaperSettings,
    taken: Sequence[int] = (),
) -> list[Claim]:
    """Greedy placement on one channel (M,), in order of time; claims share end frames at most.

    What the capture is to within ``EXACT`` comes first ("a distance of zero describes identical
    segments"), or a longer segment that fits by stretching would take its place.

    taken: frames of locked keys, which no segment covers.
    """
    free = np.ones(len(values), dtype=np.bool_)
    free[list(taken)] = False
    placed: list[Claim] = []

    def claim(found: Claim) -> None:
        placed.append(found)
        free[found.first + 1 : found.last] = False

    for exact in _identical(values, entries, free, unit):
        claim(exact)
    spread = max(float(values.std()), 1e-9)
    for entry in entries if settings.threshold > EXACT else ():
        while free[1:-1].any():
            found = _best(values, entry, free, unit, spread, settings)
            if found is None:
                break
            claim(found)
    return sorted(placed, key=lambda c: c.first)


def _identical(
    values: Array, entries: Sequence[Entry], free: Flags, unit: float
) -> Iterator[Claim]:
    """Places where a segment is the capture; of one length the closest first. Rests are not."""
    for _, group in groupby(entries, key=lambda e: e.last):
        members = [e for e in group if np.ptp(e.samples) > 10 * EXACT * unit]
        while True:
            options = [c for e in members if (c := _plain(values, e, free, unit)) is not None]
            best = min(options, key=lambda c: c.error, default=None)
            if best is None or best.error > EXACT:
                break
            yield best


def _best(
    values: Array, entry: Entry, free: Flags, unit: float, spread: float, settings: PaperSettings
) -> Claim | None:
    find = {"distance": _by_distance, "sax": _by_words, "hmm": _by_alignment}[settings.method]
    found = find(values, entry, free, unit, spread, settings)
    return found if found is not None and found.error <= settings.threshold else None


def _open(free: Flags, n: int) -> Flags:
    """(M - n,) whether a window of n + 1 frames takes nothing of another claim but its end."""
    busy = np.concatenate([[0], np.cumsum(~free)])
    inner = busy[n:-1] - busy[1:-n] == 0
    both: Flags = inner & free[: len(free) - n] & free[n:]
    return both


def _by_distance(
    values: Array, entry: Entry, free: Flags, unit: float, spread: float, settings: PaperSettings
) -> Claim | None:
    plain = _plain(values, entry, free, unit)
    if plain is not None and plain.error < EXACT:
        return plain
    other = _stretched(values, entry, free, unit)
    options = [c for c in (plain, other) if c is not None]
    return min(options, key=lambda c: c.error) if options else None


def _plain(values: Array, entry: Entry, free: Flags, unit: float) -> Claim | None:
    n = entry.last
    if n >= len(values):
        return None
    allowed = _open(free, n)
    if not allowed.any():
        return None
    distance = np.where(allowed, distance_profile(values, entry.samples), np.inf)
    first = int(distance.argmin())
    return _claim(entry, values, first, n, entry.table, _rms(distance[first], n, unit))


def _rms(square: float, n: int, unit: float) -> float:
    return float(np.sqrt(square / (n + 1))) / unit


def _claim(entry: Entry, values: Array, first: int, n: int, table: Array, error: float) -> Claim:
    moved = table.copy()
    moved[:, 0] += first
    moved[:, 1] += values[first] - entry.samples[0]
    return Claim(entry, first, first + n, moved, error, n / entry.last)


def _stretched(values: Array, entry: Entry, free: Flags, unit: float) -> Claim | None:
    """Keogh: each outer quarter takes its own best place, the middle is stretched between them."""
    quarter = entry.last // 4
    if quarter < 3:
        return None
    left, right = entry.samples[: quarter + 1], entry.samples[-quarter - 1 :]
    if len(values) <= quarter:
        return None
    open_ = _open(free, quarter)
    begin = np.where(open_, distance_profile(values, left), np.inf)
    first = int(begin.argmin())
    if not np.isfinite(begin[first]):
        return None
    end = np.where(open_, distance_profile(values, right), np.inf)
    apart = entry.last - quarter
    low = first + int(np.ceil(FACTORS[0] * entry.last)) - quarter
    high = first + int(FACTORS[1] * entry.last) - quarter
    end[: max(low, first + quarter)] = np.inf
    end[high + 1 :] = np.inf
    if not len(end) or not np.isfinite(end.min()):
        return None
    second = int(end.argmin())
    n = second - first + quarter
    if second - first == apart or not _open(free, n)[first]:
        return None
    table = stretch(entry.table, entry.last, n)
    whole = Curve.from_table(table).evaluate(np.arange(n + 1, dtype=np.float64))
    level = values[first : first + n + 1] - values[first] - (whole - whole[0])
    return _claim(entry, values, first, n, table, _rms(float(level @ level), n, unit))


def stretch(table: Array, length: int, wanted: int) -> Array:
    """Keys in frames with the middle half stretched so that ``length`` becomes ``wanted``.

    Time runs at its own rate in the outer quarters and changes smoothly between, so slopes have no
    jumps. Where the middle would have to run below a third of its rate, all is squeezed alike.
    """
    factor = wanted / length
    u = table[:, 0] / length
    change = 2.5 * (factor - 1.0)  # the bump below has the mean 0.4 over the whole length
    if change < -2.0 / 3.0:
        rate, warped = np.full(len(u), factor), u * factor
    else:
        rate = 1.0 + change * _bump(u)
        warped = u + change * _bump_sum(u)
    result = table.copy()
    result[:, 0] = warped * length
    result[:, 2] *= rate
    result[:, 4] *= rate
    return result


def _bump(u: Array) -> Array:
    """1 in the middle, 0 in the outer quarters, smooth steps of a tenth between."""

    def step(x: Array) -> Array:
        y = np.clip(x, 0.0, 1.0)
        smooth: Array = 3 * y * y - 2 * y**3
        return smooth

    return step((u - 0.25) / 0.1) - step((u - 0.65) / 0.1)


def _bump_sum(u: Array) -> Array:
    def area(x: Array) -> Array:
        y = np.clip(x, 0.0, 1.0)
        whole: Array = y**3 - 0.5 * y**4 + np.maximum(x - 1.0, 0.0)
        return 0.1 * whole

    return area((u - 0.25) / 0.1) - area((u - 0.65) / 0.1)


def _by_words(
    values: Array, entry: Entry, free: Flags, unit: float, spread: float, settings: PaperSettings
) -> Claim | None:
    """The nearest word by MINDIST; of places that words do not tell apart, the nearest in value."""
    n = entry.last
    if n >= len(values):
        return None
    allowed = _open(free, n)
    if not allowed.any():
        return None
    windows = np.lib.stride_tricks.sliding_window_view(values, n + 1)
    word = min(settings.word, n + 1)
    own = sax.words(entry.samples[None], word, settings.alphabet)
    theirs = sax.words(windows, word, settings.alphabet)
    gap = sax.mindist(theirs, own, n + 1, settings.alphabet)[:, 0]
    sizes, size = windows.std(axis=1), float(entry.samples.std())
    least = 1e-3 * unit
    alike = (sizes + least >= FACTORS[0] * size) & (sizes <= FACTORS[1] * size + least)
    bound = np.where(allowed & alike, gap / np.sqrt(n + 1) * sizes / unit, np.inf)
    if not np.isfinite(bound.min()):
        return None
    nearest = bound <= bound.min() + 1e-12
    distance = np.where(nearest, distance_profile(values, entry.samples), np.inf)
    first = int(distance.argmin())
    exact = _rms(distance[first], n, unit)
    # Words that agree leave amplitude open: the piece is as high as the capture is.
    gain = sizes[first] / size if size > least and exact >= EXACT else 1.0
    table = entry.table * np.array([1.0, gain] * 3)
    table[:, 1] += entry.samples[0] * (1.0 - gain)
    error = exact if exact < EXACT else float(bound[first])
    return _claim(entry, values, first, n, table, error)


def _by_alignment(
    values: Array, entry: Entry, free: Flags, unit: float, spread: float, settings: PaperSettings
) -> Claim | None:
    """Full Viterbi from the likeliest places at even pace: monotone, first point on first frame."""
    plain = _plain(values, entry, free, unit)
    if plain is not None and plain.error < EXACT:
        return plain
    starts = _likely_starts(values, entry, free)
    best: tuple[float, Claim] | None = None
    for first, reach in starts:
        found = _aligned(values, entry, first, reach, unit, spread, settings)
        if found is None or (best is not None and found[0] >= best[0]):
            continue
        if _open(free, found[1].last - found[1].first)[found[1].first]:
            best = found
    return best[1] if best is not None else None


def _likely_starts(values: Array, entry: Entry, free: Flags) -> list[tuple[int, int]]:
    """First frames, best first, and how many frames may be used from there."""
    scored: dict[int, float] = {}
    for factor in (0.5, 0.7, 1.0, 1.4, 2.0):
        n = round(entry.last * factor)
        if not 2 <= n < len(values):
            continue
        place = np.linspace(0, entry.last, n + 1)
        shape = np.interp(place, np.arange(entry.last + 1), entry.samples)
        distance = np.where(_open(free, n), distance_profile(values, shape), np.inf) / (n + 1)
        for first in np.argsort(distance, kind="stable")[:_TRIED].tolist():
            if np.isfinite(distance[first]):
                scored[first] = min(scored.get(first, np.inf), float(distance[first]))
    blocked = np.append(np.flatnonzero(~free), len(free))
    ordered = sorted(scored, key=lambda f: (scored[f], f))[:_TRIED]
    return [(f, int(blocked[np.searchsorted(blocked, f)])) for f in ordered]


def _aligned(
    values: Array,
    entry: Entry,
    first: int,
    reach: int,
    unit: float,
    spread: float,
    settings: PaperSettings,
) -> tuple[float, Claim] | None:
    longest = min(reach - first, int(FACTORS[1] * entry.last) + 1)
    least = int(np.ceil(FACTORS[0] * entry.last))
    if longest <= max(2, least):
        return None
    window = values[first : first + longest] - values[first]
    nodes = min(_NODES, entry.last + 1)
    place = np.linspace(0.0, entry.last, nodes)
    chain = hmm.features(entry.samples - entry.samples[0], spread)
    point = np.stack([np.interp(place, np.arange(entry.last + 1), f) for f in chain.T], axis=1)
    cost = hmm.emission(point, hmm.features(window, spread))
    pace = entry.last / (nodes - 1)
    cost[-1, : least + 1] = np.inf  # no shorter than half the example
    total, path = hmm.viterbi(cost[None], settings.pace / pace, pace)
    if not np.isfinite(total[0]):
        return None
    frames = path[0].astype(np.float64)
    n = int(frames[-1])
    aligned = np.interp(place, np.arange(entry.last + 1), entry.samples) - entry.samples[0]
    error = float(np.sqrt(np.mean((aligned - window[path[0]]) ** 2))) / unit
    table = _moved(entry.table, place, frames)
    return float(total[0]) / nodes, _claim(entry, values, first, n, table, error)


def _moved(table: Array, place: Array, frames: Array) -> Array:
    """Keys carried along an alignment, a frame apart at least; handles keep their share."""
    result = table.copy()
    inside = np.interp(table[:, 0], place, frames)
    inside[0] = table[0, 0]
    inside[-1] = max(frames[-1], inside[-1])
    apart = np.diff(table[:, 0])
    if (np.diff(inside) < np.minimum(1.0, apart)).any():
        inside = table[:, 0] * frames[-1] / place[-1]
    result[:, 0] = inside
    result[:-1, 4] *= np.diff(inside) / apart
    result[1:, 2] *= np.diff(inside) / apart
    return result


def warp(claim: Claim, values: Array, slope: Array, unit: float) -> Array:
    """The claim's keys with end values and end slopes of the capture (the paper's "Curve Warping").

    The cubic Hermite of the end errors is added to values and slopes. A segment that is the capture
    itself has none, and stays as its animator made it.

    Args:
        claim: keys in frames.
        values: (M,) capture without noise.
        slope: (M,) its slope per frame.
        unit: what the channel moves.
    """
    if claim.error < EXACT:
        return claim.table
    table = claim.table.copy()
    curve = Curve.from_table(table)
    ends = np.array([claim.first, claim.last], dtype=np.float64)
    width = ends[1] - ends[0]
    missing = values[[claim.first, claim.last]] - curve.evaluate(ends)
    out, into = table[0, 4:6], table[-1, 2:4]
    own = np.array([v[1] / v[0] if abs(v[0]) > 1e-9 else 0.0 for v in (out, into)])
    bend = (slope[[claim.first, claim.last]] - own) * width
    u = np.clip((table[:, 0] - ends[0]) / width, 0.0, 1.0)
    a, b = missing
    value = a * (1 - 3 * u**2 + 2 * u**3) + b * (3 * u**2 - 2 * u**3)
    value += bend[0] * (u - 2 * u**2 + u**3) + bend[1] * (u**3 - u**2)
    rate = (b - a) * (6 * u - 6 * u**2) + bend[0] * (1 - 4 * u + 3 * u**2)
    rate = (rate + bend[1] * (3 * u**2 - 2 * u)) / width
    table[:, 1] += value
    table[:, 3] += rate * table[:, 2]
    table[:, 5] += rate * table[:, 4]
    return table
