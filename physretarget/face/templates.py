"""What can be borrowed from a library, boiled down to shapes of unit width.

Animators repeat themselves: thousands of segments share a few shapes. Alike shapes are one
template here, with all the places they come from; each place keeps its duration, so that a match
names the one that needed the least stretching.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from physretarget.face.curve import solve_time
from physretarget.face.library import Library, Segment

Array = NDArray[np.float64]
_POINTS = 17
_ALIKE = 0.02  # of the rise: shapes no further apart than this anywhere are one template
_LEAST_HANDLE = 0.05  # of the span: shorter tangents leave the slope at the key undefined


@dataclass(frozen=True, eq=False)
class Template:
    """Keys of unit width and amplitude with the segments of the library that have them.

    table (K, 6) as Curve.table; durations (S,) s ascending beside segments (S, 3): example,
    first and last key; amplitudes (S,) of each as a fraction of its own curve's range.
    """

    table: Array
    segments: NDArray[np.intp]
    durations: Array
    amplitudes: Array

    @property
    def keys(self) -> int:
        """How many keys."""
        return len(self.table)

    def nearest(self, seconds: float) -> int:
        """Position in segments of the one whose duration needs the least stretching."""
        return int(np.argmin(np.abs(np.log(self.durations / seconds))))


@dataclass(frozen=True, eq=False)
class Bank:
    """Templates of two keys (spans) and of more (phrases); middle: stretch only phrases' middle."""

    spans: tuple[Template, ...]
    phrases: tuple[Template, ...]
    middle: bool = False
    _shapes: dict[int, NDArray[np.float32]] = field(default_factory=dict, repr=False)
    _known: dict[tuple[bool, float], NDArray[np.bool_]] = field(default_factory=dict, repr=False)

    def span_shapes(self, intervals: int) -> NDArray[np.float32]:
        """(S, intervals + 1) samples of every span; kept, since every take asks for them."""
        if intervals not in self._shapes:
            tables = [t.table for t in self.spans]
            self._shapes[intervals] = sample(tables, intervals + 1).astype(np.float32)
        return self._shapes[intervals]

    def phrase_table(self, number: int, seconds: float) -> Array:
        """(K, 6) a phrase's keys on unit width, as they are when it lasts so long."""
        template = self.phrases[number]
        if not self.middle:
            return template.table
        return middle_stretched(
            template.table, seconds / template.durations[template.nearest(seconds)]
        )

    def phrase_shapes(self, intervals: int, seconds: float) -> NDArray[np.float32]:
        """(S, intervals + 1) samples of every phrase, interpolated between 65 points."""
        if self.middle:
            tables = [self.phrase_table(k, seconds) for k in range(len(self.phrases))]
            return sample(tables, intervals + 1).astype(np.float32)
        if -1 not in self._shapes:
            tables = [t.table for t in self.phrases]
            self._shapes[-1] = sample(tables, 65).astype(np.float32)
        place = np.linspace(0.0, 64.0, intervals + 1)
        left = np.minimum(place.astype(np.intp), 63)
        share = (place - left).astype(np.float32)
        known = self._shapes[-1]
        shapes: NDArray[np.float32] = known[:, left] * (1 - share) + known[:, left + 1] * share
        return shapes

    def available(self, phrases: bool, seconds: float) -> NDArray[np.bool_]:
        """Which spans (or phrases) have a segment within a factor of two of this duration."""
        asked = (phrases, round(seconds, 6))
        if asked not in self._known:
            near = [
                bool(((t.durations >= seconds / 2) & (t.durations <= seconds * 2)).any())
                for t in (self.phrases if phrases else self.spans)
            ]
            self._known[asked] = np.array(near, dtype=bool)
        return self._known[asked]


@dataclass(frozen=True, eq=False)
class Offer:
    """Templates that are tried on windows of one length: numbers (spans before phrases), prices."""

    numbers: NDArray[np.intp]
    shapes: NDArray[np.float32]
    price: NDArray[np.float32]
    amplitudes: tuple[NDArray[np.float32], NDArray[np.float32]] | None = None


def middle_stretched(table: Array, ratio: float) -> Array:
    """Keys (K, 6) of unit width played ``ratio`` times as long with first and last quarter as fast.

    Keogh's scaling matches a left and a right part and stretches the middle between them, which
    breaks the slope where they meet. Here the pace changes smoothly, so that the curve stays C1.
    Below a ratio of 0.77 the middle would run backward: then, and above 2, all is stretched alike.
    """
    if not 0.77 <= ratio <= 2.0:
        return table
    more = 2.0 * (ratio - 1.0)
    inside = np.clip(table[:, 0] - 0.25, 0.0, 0.5)
    wave = 4.0 * np.pi * inside
    result = table.copy()
    result[:, 0] = (table[:, 0] + more * (inside - np.sin(wave) / (4.0 * np.pi))) / ratio
    pace = (1.0 + more * (1.0 - np.cos(wave))) / ratio
    result[:, 2] *= pace
    result[:, 4] *= pace
    return result


def sample(tables: list[Array], count: int) -> Array:
    """(S, count) values of unit-width key tables at evenly spaced times, ends included."""
    x = np.linspace(0.0, 1.0, count)
    rows = np.empty((len(tables), count))
    for size in {len(t) for t in tables}:
        which = [s for s, t in enumerate(tables) if len(t) == size]
        block = np.stack([tables[s] for s in which])
        rows[which] = _sample_equal(block, x)
    return rows


def _sample_equal(tables: Array, x: Array) -> Array:
    """Tables (S, K, 6) with equally many keys at times (n,)."""
    times = tables[:, :, 0]
    span = np.clip((times[:, None, 1:-1] <= x[None, :, None]).sum(axis=-1), 0, None)
    rows = np.arange(len(tables))[:, None]
    left, right = tables[rows, span], tables[rows, span + 1]
    width = right[..., 0] - left[..., 0]
    x1 = np.clip(left[..., 4] / width, 0.0, 1.0)
    x2 = np.clip(1.0 + right[..., 2] / width, 0.0, 1.0)
    u = solve_time(np.clip((x - left[..., 0]) / width, 0.0, 1.0), x1, x2)
    v = 1.0 - u
    start, end = left[..., 1], right[..., 1]
    out, back = start + left[..., 5], end + right[..., 3]
    result: Array = v**3 * start + 3 * v * v * u * out + 3 * v * u * u * back + u**3 * end
    return result


_Entry = tuple[Segment, Array, float, float]  # with unit table, seconds, amplitude


def make_bank(
    library: Library,
    usable: Callable[[str], bool] = lambda channel: True,
    *,
    phrases: bool = True,
    middle: bool = False,
    most_spans: int = 96,
    most_phrases: int = 400,
) -> Bank:
    """Templates of every segment whose library channel is usable, the commonest first."""
    by_keys: dict[int, list[Segment]] = {}
    if phrases:
        for segment in library.segments:
            if usable(library.examples[segment.example].channel):
                by_keys.setdefault(segment.keys, []).append(segment)
    else:
        by_keys[2] = [
            Segment(index, k, k + 1)
            for index, example in enumerate(library.examples)
            if usable(example.channel)
            for k in range(len(example.curve.keys) - 1)
        ]
    found = {size: _entries(library, members) for size, members in by_keys.items()}
    long = [e for size, entries in found.items() if size > 2 for e in entries]
    return Bank(_cluster(found.get(2, []), most_spans), _cluster(long, most_phrases), middle)


def _entries(library: Library, members: list[Segment]) -> list[_Entry]:
    """Unit tables of segments with equally many keys; stepped and level ones are left out."""
    kept, tables = [], []
    for segment in members:
        example = library.examples[segment.example]
        keys = example.curve.keys[segment.first : segment.last]
        if not any(k.out_type in ("stepped", "stepped_next") for k in keys):
            kept.append(segment)
            tables.append(example.curve.table[segment.first : segment.last + 1])
    if not kept:
        return []
    raw = np.stack(tables)
    shapes, amplitude, sound = _unit(raw)
    seconds = raw[:, -1, 0] - raw[:, 0, 0]
    return [
        (
            kept[k],
            shapes[k],
            float(seconds[k]),
            float(amplitude[k]) / library.examples[kept[k].example].range,
        )
        for k in np.flatnonzero(sound)
    ]


def _unit(tables: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Tables (S, K, 6) to width 1, start (0, 0), height 1; amplitudes (S,); which are usable.

    Height: the rise of two keys, else largest minus smallest key value.
    """
    shapes = tables.copy()
    shapes[:, :, :2] -= tables[:, :1, :2]
    width = shapes[:, -1, 0]
    rise = shapes[:, -1, 1] if tables.shape[1] == 2 else np.ptp(shapes[:, :, 1], axis=1)
    sound = np.abs(rise) >= 1e-9 * np.maximum(1.0, np.abs(tables[:, :, 1]).max(axis=1))
    height = np.where(sound, rise, 1.0)
    shapes /= np.stack([width, height] * 3, axis=1)[:, None]
    shapes[:, 0, 2:4] = shapes[:, -1, 4:6] = 0.0
    for k in range(shapes.shape[1] - 1):
        _least_handles(shapes[:, k], shapes[:, k + 1])
    sound &= np.abs(shapes[:, :, [3, 5]]).max(axis=(1, 2)) <= 3.0
    return shapes, np.abs(rise), sound


def _least_handles(left: Array, right: Array) -> None:
    """Tangents within their span; those of no length drawn out a little toward the other's end."""
    width = right[:, 0] - left[:, 0]
    left[:, 4:6] *= np.minimum(1.0, width / np.maximum(left[:, 4], 1e-12))[:, None]
    right[:, 2:4] *= np.minimum(1.0, width / np.maximum(-right[:, 2], 1e-12))[:, None]
    least = _LEAST_HANDLE * width
    short = (left[:, 4] < least)[:, None]
    run = np.maximum(width + right[:, 2], least)
    rise = right[:, 1] + right[:, 3] - left[:, 1]
    left[:, 4:6] = np.where(short, np.stack([least, rise * least / run], 1), left[:, 4:6])
    short = (-right[:, 2] < least)[:, None]
    run = np.maximum(width - left[:, 4], least)
    rise = left[:, 1] + left[:, 5] - right[:, 1]
    right[:, 2:4] = np.where(short, np.stack([-least, rise * least / run], 1), right[:, 2:4])


def _cluster(entries: list[_Entry], most: int) -> tuple[Template, ...]:
    """Leader clustering, in order of appearance: deterministic and without a second pass."""
    groups: list[list[_Entry]] = []
    by_keys: dict[int, list[_Entry]] = {}
    for entry in entries:
        by_keys.setdefault(len(entry[1]), []).append(entry)
    for members in by_keys.values():
        # Key times count as much as values: alike shapes with other keys are other templates.
        values = sample([m[1] for m in members], _POINTS)
        described = np.concatenate([values, 2 * np.stack([m[1][:, 0] for m in members])], axis=1)
        leader = _leaders(described)
        own: dict[int, list[_Entry]] = {}
        for member, number in zip(members, leader.tolist(), strict=True):
            own.setdefault(number, []).append(member)
        groups += own.values()
    order = sorted(range(len(groups)), key=lambda g: (-len(groups[g]), g))[:most]
    return tuple(_template(groups[g]) for g in order)


def _leaders(rows: Array) -> NDArray[np.intp]:
    """Per row the number of its group: the nearest earlier leader within reach, or its own."""
    cells = np.round(rows / (0.5 * _ALIKE)).astype(np.int32)
    _, first, member = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    leaders = np.empty((0, rows.shape[1]))
    group = np.zeros(len(first), dtype=np.intp)
    for cell in np.argsort(first, kind="stable"):
        apart = np.abs(leaders - rows[first[cell]]).max(axis=1) if len(leaders) else np.ones(0)
        if len(apart) and apart.min() <= _ALIKE:
            group[cell] = int(np.argmin(apart))
        else:
            group[cell] = len(leaders)
            leaders = np.concatenate([leaders, rows[first[cell], None]])
    found: NDArray[np.intp] = group[member.ravel()]
    return found


def _template(members: list[_Entry]) -> Template:
    members = sorted(members, key=lambda m: (m[2], m[0].example, m[0].first))
    tables = np.stack([m[1] for m in members])
    apart = np.abs(tables - np.median(tables, axis=0)).sum(axis=(1, 2))
    return Template(
        members[int(np.argmin(apart))][1],  # one that an animator made, the least unusual
        np.array([(m[0].example, m[0].first, m[0].last) for m in members], dtype=np.intp),
        np.array([m[2] for m in members]),
        np.array([m[3] for m in members]),
    )
