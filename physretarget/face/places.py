"""The best free place of a segment on a channel, by one of the paper's three measures.

One threshold serves all: the misfit in the channel's values, as a fraction of its range. The
hidden Markov model's constants are lost from the paper's text; ours are a reconstruction.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physretarget.face import hmm, sax
from physretarget.face.curve import Curve
from physretarget.face.distance import distance_profile
from physretarget.face.segments import EXACT, Claim, Entry, PaperSettings

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
FACTORS = (0.5, 2.0)
"""Least and largest stretch in time, and ratio of amplitudes that SAX, blind to them, accepts."""
_TRIED = 6  # places of a segment that Viterbi looks at: the likeliest at even pace
_NODES = 48  # points of a chain, at most


def open_windows(free: Flags, n: int) -> Flags:
    """(M - n,) whether a window of n + 1 frames takes nothing of another claim but its end."""
    busy = np.concatenate([[0], np.cumsum(~free)])
    inner = busy[n:-1] - busy[1:-n] == 0
    both: Flags = inner & free[: len(free) - n] & free[n:]
    return both


def by_distance(
    values: Array, entry: Entry, free: Flags, unit: float, spread: float, settings: PaperSettings
) -> Claim | None:
    """The place of least misfit, as the segment is or with its middle stretched."""
    plain = plain_place(values, entry, free, unit)
    if plain is not None and plain.error < EXACT:
        return plain
    other = _stretched(values, entry, free, unit)
    options = [c for c in (plain, other) if c is not None]
    return min(options, key=lambda c: c.error) if options else None


def plain_place(values: Array, entry: Entry, free: Flags, unit: float) -> Claim | None:
    """The place of least misfit of a segment as it is."""
    n = entry.last
    if n >= len(values):
        return None
    allowed = open_windows(free, n)
    if not allowed.any():
        return None
    distance = np.where(allowed, distance_profile(values, entry.samples), np.inf)
    first = int(distance.argmin())
    return claim_of(entry, values, first, n, entry.table, _rms(distance[first], n, unit))


def _rms(square: float, n: int, unit: float) -> float:
    return float(np.sqrt(square / (n + 1))) / unit


def claim_of(entry: Entry, values: Array, first: int, n: int, table: Array, error: float) -> Claim:
    """The segment's keys laid over n frames from ``first``, on the capture's level."""
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
    open_ = open_windows(free, quarter)
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
    if second - first == apart or not open_windows(free, n)[first]:
        return None
    table = stretch(entry.table, entry.last, n)
    whole = Curve.from_table(table).evaluate(np.arange(n + 1, dtype=np.float64))
    level = values[first : first + n + 1] - values[first] - (whole - whole[0])
    return claim_of(entry, values, first, n, table, _rms(float(level @ level), n, unit))


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


def by_words(
    values: Array, entry: Entry, free: Flags, unit: float, spread: float, settings: PaperSettings
) -> Claim | None:
    """The nearest word by MINDIST; of places that words do not tell apart, the nearest in value."""
    n = entry.last
    if n >= len(values):
        return None
    allowed = open_windows(free, n)
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
    return claim_of(entry, values, first, n, table, error)


def by_alignment(
    values: Array, entry: Entry, free: Flags, unit: float, spread: float, settings: PaperSettings
) -> Claim | None:
    """Full Viterbi from the likeliest places at even pace: monotone, first point on first frame."""
    plain = plain_place(values, entry, free, unit)
    if plain is not None and plain.error < EXACT:
        return plain
    starts = _likely_starts(values, entry, free)
    best: tuple[float, Claim] | None = None
    for first, reach in starts:
        found = _aligned(values, entry, first, reach, unit, spread, settings)
        if found is None or (best is not None and found[0] >= best[0]):
            continue
        if open_windows(free, found[1].last - found[1].first)[found[1].first]:
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
        distance = np.where(open_windows(free, n), distance_profile(values, shape), np.inf) / (
            n + 1
        )
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
    return float(total[0]) / nodes, claim_of(entry, values, first, n, table, error)


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
