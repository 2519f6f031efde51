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
from physretarget.face.library import Library

Array = NDArray[np.float64]
_POINTS = 17
_ALIKE = 0.04  # of the rise: shapes no further apart than this anywhere are one template
_LEAST_HANDLE = 0.05  # of the span: shorter tangents leave the slope at the key undefined


@dataclass(frozen=True, eq=False)
class Template:
    """Keys of unit width and amplitude with the segments (library indices) that have them.

    table (K, 6) as Curve.table; durations (S,) s ascending beside segments (S,);
    amplitude (S,) of each segment as a fraction of its own curve's range.
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
    """Templates of two keys (spans) and of more (phrases)."""

    spans: tuple[Template, ...]
    phrases: tuple[Template, ...]
    _shapes: dict[int, NDArray[np.float32]] = field(default_factory=dict, repr=False)

    def span_shapes(self, intervals: int) -> NDArray[np.float32]:
        """(S, intervals + 1) samples of every span; kept, since every take asks for them."""
        if intervals not in self._shapes:
            tables = [t.table for t in self.spans]
            self._shapes[intervals] = sample(tables, intervals + 1).astype(np.float32)
        return self._shapes[intervals]

    def phrase_shapes(self, intervals: int) -> NDArray[np.float32]:
        """(S, intervals + 1) samples of every phrase, interpolated between 65 points."""
        if -1 not in self._shapes:
            tables = [t.table for t in self.phrases]
            self._shapes[-1] = sample(tables, 65).astype(np.float32)
        place = np.linspace(0.0, 64.0, intervals + 1)
        left = np.minimum(place.astype(np.intp), 63)
        share = (place - left).astype(np.float32)
        known = self._shapes[-1]
        shapes: NDArray[np.float32] = known[:, left] * (1 - share) + known[:, left + 1] * share
        return shapes

    def available(self, templates: tuple[Template, ...], seconds: float) -> NDArray[np.bool_]:
        """Which templates have a segment within a factor of two of this duration."""
        return np.array(
            [
                bool(((t.durations >= seconds / 2) & (t.durations <= seconds * 2)).any())
                for t in templates
            ],
            dtype=bool,
        )


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


def make_bank(
    library: Library,
    usable: Callable[[str], bool] = lambda channel: True,
    *,
    most_spans: int = 48,
    most_phrases: int = 400,
) -> Bank:
    """Templates of every segment whose library channel is usable, the commonest first."""
    spans: list[tuple[int, Array, float, float]] = []
    phrases: list[tuple[int, Array, float, float]] = []
    for index, segment in enumerate(library.segments):
        example = library.examples[segment.example]
        if not usable(example.channel):
            continue
        keys = example.curve.keys[segment.first : segment.last + 1]
        if any(k.out_type in ("stepped", "stepped_next") for k in keys[:-1]):
            continue
        table = example.curve.table[segment.first : segment.last + 1]
        unit = _unit(table)
        if unit is None:
            continue
        shape, amplitude = unit
        duration = float(table[-1, 0] - table[0, 0])
        entry = (index, shape, duration, amplitude / example.range)
        (spans if len(keys) == 2 else phrases).append(entry)
    return Bank(_cluster(spans, most_spans), _cluster(phrases, most_phrases))


def _unit(table: Array) -> tuple[Array, float] | None:
    """Width 1, start (0, 0); two keys: rise 1; more: largest minus smallest key value 1."""
    width = table[-1, 0] - table[0, 0]
    shape = table - np.array([table[0, 0], table[0, 1], 0, 0, 0, 0])
    rise = float(shape[-1, 1] if len(table) == 2 else np.ptp(shape[:, 1]))
    if abs(rise) < 1e-9 * max(1.0, float(np.abs(table[:, 1]).max())):
        return None
    shape = shape / np.array([width, rise] * 3)
    shape[0, 2:4] = shape[-1, 4:6] = 0.0
    shape = _least_handles(shape)
    bent = np.abs(shape[:, [3, 5]]).max() > 3.0
    return None if bent else (shape, abs(rise))


def _least_handles(shape: Array) -> Array:
    """Tangents of no length drawn out a little along the chord of their span's controls."""
    result = shape.copy()
    for k in range(len(shape) - 1):
        a, b = result[k], result[k + 1]
        width = b[0] - a[0]
        a[4:6] *= min(1.0, width / max(a[4], 1e-12))
        b[2:4] *= min(1.0, width / max(-b[2], 1e-12))
        if a[4] < _LEAST_HANDLE * width:
            toward = np.array([width + b[2], b[1] + b[3] - a[1]])
            a[4:6] = toward * (_LEAST_HANDLE * width / max(toward[0], _LEAST_HANDLE * width))
        if -b[2] < _LEAST_HANDLE * width:
            toward = np.array([a[4] - width, a[1] + a[5] - b[1]])
            b[2:4] = toward * (_LEAST_HANDLE * width / max(-toward[0], _LEAST_HANDLE * width))
    return result


def _cluster(entries: list[tuple[int, Array, float, float]], most: int) -> tuple[Template, ...]:
    """Leader clustering, in order of appearance: deterministic and without a second pass."""
    groups: list[list[tuple[int, Array, float, float]]] = []
    leaders: dict[int, list[int]] = {}
    shapes: dict[int, Array] = {}
    by_keys: dict[int, list[tuple[int, Array, float, float]]] = {}
    for entry in entries:
        by_keys.setdefault(len(entry[1]), []).append(entry)
    for size, members in by_keys.items():
        # Key times count as much as values: alike shapes with other keys are other templates.
        values = sample([m[1] for m in members], _POINTS)
        described = np.concatenate([values, np.stack([2 * m[1][:, 0] for m in members])], axis=1)
        shapes[size] = np.empty((0, described.shape[1]))
        leaders[size] = []
        for member, row in zip(members, described, strict=True):
            apart = np.abs(shapes[size] - row).max(axis=1, initial=0.0)
            if len(apart) and apart.min() <= _ALIKE:
                groups[leaders[size][int(np.argmin(apart))]].append(member)
                continue
            leaders[size].append(len(groups))
            shapes[size] = np.concatenate([shapes[size], row[None]])
            groups.append([member])
    order = sorted(range(len(groups)), key=lambda g: (-len(groups[g]), g))[:most]
    return tuple(_template(groups[g]) for g in order)


def _template(members: list[tuple[int, Array, float, float]]) -> Template:
    members = sorted(members, key=lambda m: (m[2], m[0]))
    return Template(
        members[0][1],
        np.array([m[0] for m in members], dtype=np.intp),
        np.array([m[2] for m in members]),
        np.array([m[3] for m in members]),
    )
