"""Where this animator would set a key: learned from past shots, on top of the programme.

The programme (``programme.py``) knows no animator. What past shots add is small and of three kinds:
how much each of its clues is worth in this hand (the chance of a key at several widths, the kinds
of the neighbouring spans, curvature, distance from the ends), how often keys are shared with other
channels of the same moment, and how dense keys are. Every file of the library becomes a
pseudo-capture, the programme is run on it, and a logistic regression learns at which frames the
animator's keys were. A library earns this only if files left out of the learning are keyed better
with it than without; otherwise the programme alone decides.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from physretarget.face.curve import Curve
from physretarget.face.keyfit import Chain
from physretarget.face.library import Example, Library
from physretarget.face.measure import key_f1, pseudo_take
from physretarget.face.noise import smoothed
from physretarget.face.programme import ProgrammeSettings, Score, programme
from physretarget.face.spans import KINDS, likeliest_kinds

Array = NDArray[np.float64]
Ints = NDArray[np.intp]
_BEYOND = 12  # frames on either side that a frame's clues are read from
_CELLS = 40_000  # frames times channels that are learned from at most
_RIDGE = 3.0
_SHARE = 0.5  # of a neighbour's keys that are taken for shared, before the weights are learned
_LEAST_KEYS, _LEAST_FILES = 60, 3
_KEYED, _LASTS = 4, 0.5  # keys and seconds of a curve that is learned from; others are neighbours


@dataclass(frozen=True, eq=False)
class Clues:
    """What is known of every frame of a take: one Score per channel, values (C, M), frame rate."""

    scores: Sequence[Score]
    values: Array
    fps: float

    @property
    def frames(self) -> int:
        """Of the take."""
        return int(self.values.shape[1])

    @cached_property
    def smooth(self) -> Array:
        """(C, M) values without noise."""
        return smoothed(self.values, self.fps)

    @cached_property
    def likely(self) -> Array:
        """(C, M) the programme's chances of a key; the ends are keys."""
        found = np.clip(np.stack([s.likely for s in self.scores]), 0.0, 1.0)
        found[:, [0, -1]] = 1.0
        return found

    @cached_property
    def nearest(self) -> tuple[Ints, Ints]:
        """(C, M) number of the programme's key that is nearest, and by how much a frame is late."""
        frames = np.arange(self.frames)
        number = np.empty(self.values.shape, dtype=np.intp)
        late = np.empty(self.values.shape, dtype=np.intp)
        for row, score in enumerate(self.scores):
            keys = score.chain.frames
            after = np.clip(np.searchsorted(keys, frames), 1, len(keys) - 1)
            closer = frames - keys[after - 1] <= keys[after] - frames
            number[row] = np.where(closer, after - 1, after)
            late[row] = frames - keys[number[row]]
        return number, late

    def table(self, first: int, last: int) -> Array:
        """(C, last - first, F) clues of frames first to last-1."""
        a, b = max(0, first - _BEYOND), min(self.frames, last + _BEYOND)
        likely = self.likely[:, a:b]
        columns = [*_chances(likely), *self._keys(a, b), *self._shape(a, b), *self._ends(a, b)]
        columns += _shared(likely)
        return np.stack(columns, axis=-1)[:, first - a : last - a]

    def _keys(self, a: int, b: int) -> Iterator[Array]:
        """Distance to the programme's key, the kinds and lengths of the spans beside it."""
        number, late = (x[:, a:b] for x in self.nearest)
        for step in range(-3, 4):
            yield (late == step).astype(np.float64)
        yield np.minimum(np.abs(late), 15).astype(np.float64)
        close = np.abs(late) <= 1
        for side in (0, 1):
            kind, length = np.empty_like(late), np.zeros(late.shape)
            for row, score in enumerate(self.scores):
                kinds = np.concatenate([[len(KINDS)], score.chain.kinds, [len(KINDS)]])
                spans = np.concatenate([[0], np.diff(score.chain.frames), [0]])
                kind[row] = kinds[number[row] + side]
                length[row] = spans[number[row] + side]
            for number_of_kind in range(len(KINDS) + 1):
                yield (kind == number_of_kind) * close * 1.0
            yield np.log(length / self.fps + 0.03) * close

    def _shape(self, a: int, b: int) -> Iterator[Array]:
        """Slope and curvature, beside the noise and beside a second."""
        level = np.array([[s.level] for s in self.scores])
        slope = np.gradient(self.smooth[:, a:b], axis=1)
        bend = np.gradient(slope, axis=1)
        yield np.log1p(np.abs(bend) / level)
        yield np.log1p(np.abs(slope) / level)
        yield np.log1p(np.abs(bend) * self.fps**2)
        yield np.log1p(np.abs(slope) * self.fps)
        yield np.broadcast_to(np.log(level), slope.shape)

    def _ends(self, a: int, b: int) -> Iterator[Array]:
        shape = (len(self.values), b - a)
        frame = np.arange(a, b)
        for away in (frame, self.frames - 1 - frame):
            for seconds in (0.1, 0.5):
                yield np.broadcast_to(np.exp(-away / (seconds * self.fps)), shape)
            yield np.broadcast_to((away == 0) * 1.0, shape)


def _chances(likely: Array) -> Iterator[Array]:
    """The chance of a key at a frame and in windows about it."""
    one = np.minimum(_window(likely, 1), 1.5)
    for chance in (
        likely, one, np.minimum(_window(likely, 2), 2.0), np.minimum(_window(likely, 4), 3.0),
        _shift(likely, 1), _shift(likely, -1), _shift(one, 3), _shift(one, -3),
    ):  # fmt: skip
        yield np.log(chance + 1e-3)
    yield likely
    yield one


def _shared(likely: Array) -> Iterator[Array]:
    """The chance that a neighbouring channel has a key here that is shared: a noisy or."""
    for chance in (likely, _window(likely, 1)):
        missed = np.log1p(-_SHARE * np.clip(chance, 0.0, 0.98))
        yield 1.0 - np.exp(missed.sum(axis=0, keepdims=True) - missed)


def _shift(rows: Array, late: int) -> Array:
    moved = np.zeros_like(rows)
    if late > 0:
        moved[:, late:] = rows[:, :-late]
    else:
        moved[:, :late] = rows[:, -late:]
    return moved


def _window(rows: Array, half: int) -> Array:
    total = rows.copy()
    for late in range(1, half + 1):
        total += _shift(rows, late) + _shift(rows, -late)
    return total


@dataclass(frozen=True, eq=False)
class Style:
    """A logistic regression on clues.

    gain: by how much files left out were keyed better than by the programme alone, in F1.
    """

    mean: Array
    scale: Array
    weight: Array
    gain: float = 0.0

    @classmethod
    def fit(cls, tables: Sequence[tuple[Array, Array]], gain: float = 0.0) -> Style:
        """Ridge regression by Newton's method; tables of clues (N, F) and keys (N,), 0 or 1."""
        clues = np.concatenate([t for t, _ in tables])
        keyed = np.concatenate([k for _, k in tables])
        mean, scale = clues.mean(axis=0), clues.std(axis=0) + 1e-6
        table = np.concatenate([np.ones((len(clues), 1)), (clues - mean) / scale], axis=1)
        ridge = np.full(table.shape[1], _RIDGE)
        ridge[0] = 1e-3
        weight = np.zeros(table.shape[1])
        for _ in range(15):
            chance = 1.0 / (1.0 + np.exp(-table @ weight))
            slope = table.T @ (chance - keyed) + ridge * weight
            bend = (table * (chance * (1.0 - chance) + 1e-9)[:, None]).T @ table
            step = np.linalg.solve(bend + np.diag(ridge), slope)
            weight -= step
            if float(np.abs(step).max()) < 1e-4:
                break
        return cls(mean, scale, weight, gain)

    def chances(self, clues: Clues) -> Array:
        """(C, M) chance of a key at every frame, in stretches of frames."""
        found = np.empty(clues.values.shape)
        size = max(64, 1_000_000 // (50 * len(clues.values)))
        for first in range(0, clues.frames, size):
            last = min(clues.frames, first + size)
            table = (clues.table(first, last) - self.mean) / self.scale
            odds = self.weight[0] + table @ self.weight[1:]
            found[:, first:last] = 1.0 / (1.0 + np.exp(-odds))
        return found


def keyed_by(style: Style, clues: Clues, pinned: Sequence[Sequence[int]]) -> list[Score]:
    """The take's scores with keys where the style sets them."""
    found = []
    chances = style.chances(clues)
    for row, (score, chance) in enumerate(zip(clues.scores, chances, strict=True)):
        frames = choose(chance, pinned[row])
        kinds = likeliest_kinds(frames, clues.values[row], score.weight)
        found.append(Score(Chain(frames, kinds), score.model, score.weight, score.level, chance))
    return found


def choose(chance: Array, pinned: Sequence[int] = ()) -> Ints:
    """Frames of keys: the set that promises the highest F1 at a tolerance of one frame.

    The take's first and last frame and pinned ones are keys. Others are taken by the chance of a
    key within a frame, highest first, each window once; as many as make twice the expected hits
    over the number of keys set and expected the largest.
    """
    last = len(chance) - 1
    fixed = sorted({0, last, *pinned})
    sure = np.minimum(_window(chance[None], 1)[0, fixed], 1.0)
    left = chance.copy()
    free = np.ones(len(chance), dtype=np.bool_)
    for frame in fixed:
        free[max(0, frame - 1) : frame + 2] = False
        left[max(0, frame - 1) : frame + 2] = 0.0

    def promise(t: int) -> tuple[float, float]:
        mass = float(left[max(0, t - 1) : t + 2].sum())
        return mass, mass + _CENTRE * float(left[t])

    waiting = []
    for t in np.flatnonzero(free & (_window(chance[None], 1)[0] >= _FAINT)).tolist():
        waiting.append((-promise(t)[1], t))
    heapq.heapify(waiting)
    picks, masses = [], []
    while waiting:
        order, t = heapq.heappop(waiting)
        if not free[t]:
            continue
        mass, now = promise(t)
        if mass < _FAINT:
            continue
        if now < -order - 1e-12:
            heapq.heappush(waiting, (-now, t))
            continue
        picks.append(t)
        masses.append(min(1.0, mass))
        free[max(0, t - 1) : t + 2] = False
        left[max(0, t - 1) : t + 2] = 0.0
    hits = np.cumsum([float(sure.sum()), *masses])
    total = _EXPECTED * float(chance.sum())
    count = int((2.0 * hits / (len(fixed) + np.arange(len(hits)) + total)).argmax())
    return np.array(sorted(fixed + picks[:count]), dtype=np.intp)


_FAINT = 0.05  # windows less likely than this hold no key
_CENTRE = 0.7  # how much a window's middle frame counts over its sides
_EXPECTED = 0.9  # of the sum of chances is the number of keys: the regression's tails are long


@dataclass(frozen=True, eq=False)
class Lesson:
    """One pseudo-capture: clues, per channel the frames of the animator's keys, which are asked."""

    clues: Clues
    true: list[Array]
    asked: NDArray[np.bool_]
    file: int

    def rows(self) -> tuple[Array, Array]:
        """(N, F) clues and (N,) keys: one row per frame of every channel that is asked."""
        keyed = np.zeros(self.clues.values.shape)
        for row, frames in enumerate(self.true):
            near = np.round(frames).astype(int)
            keyed[row, near[(near >= 0) & (near < self.clues.frames)]] = 1.0
        table = self.clues.table(0, self.clues.frames)[self.asked]
        rows = table.reshape(-1, table.shape[-1])
        return rows, keyed[self.asked].ravel()

    def f1(self, style: Style | None) -> list[float]:
        """Per channel, at a tolerance of one frame; the programme's own keys without a style."""
        scores = self.clues.scores
        if style is not None:
            scores = keyed_by(style, self.clues, [()] * len(scores))
        return [
            key_f1(s.chain.frames.astype(np.float64), true, 1.0)[0]
            for s, true, asked in zip(scores, self.true, self.asked.tolist(), strict=True)
            if asked
        ]


def learn(
    library: Library,
    fps: float,
    settings: ProgrammeSettings | None = None,
    *,
    progress: Callable[[str], None] = lambda stage: None,
) -> Style | None:
    """The style of a library, or None where it has too few files or teaches nothing.

    Every third file judges what is learned from the others.

    Args:
        library: past shots.
        fps: frame rate of the captures to come.
        settings: of the programme.
        progress: told what is being done.
    """
    progress("learning from the library")
    lessons = list(_lessons(library, fps, settings or ProgrammeSettings()))
    names = sorted({lesson.file for lesson in lessons})
    if len(names) < _LEAST_FILES:
        return None
    if sum(len(true) for lesson in lessons for true in lesson.true) < _LEAST_KEYS:
        return None
    judges = set(names[::3])
    known = [lesson.rows() for lesson in lessons if lesson.file not in judges]
    style = Style.fit(known)
    gains: list[float] = []
    for lesson in lessons:
        if lesson.file in judges:
            pairs = zip(lesson.f1(style), lesson.f1(None), strict=True)
            gains += [a - b for a, b in pairs]
    gain = float(np.mean(gains))
    if gain <= 0.0:
        return None
    judged = [lesson.rows() for lesson in lessons if lesson.file in judges]
    return Style.fit(known + judged, gain)


def _lessons(library: Library, fps: float, settings: ProgrammeSettings) -> Iterator[Lesson]:
    """Pseudo-captures of the library's files, spread over it, up to what is worth the time."""
    groups = [g for g in drawn_together(library.examples) if any(map(_asked, g))]
    sizes = [_cells([e.curve for e in g], fps) for g in groups]
    order = np.argsort(np.random.default_rng(0).random(len(groups)), kind="stable").tolist()
    used = 0
    for seed in (0, 1):
        for number in order:
            if used + sizes[number] > _CELLS:
                continue
            used += sizes[number]
            curves = [e.curve for e in groups[number]]
            rng = np.random.default_rng([seed, number])
            _, noisy, start = pseudo_take(curves, fps, rng)
            base = noisy.min(axis=1, keepdims=True)
            values = (noisy - base) / np.ptp(noisy, axis=1, keepdims=True)
            scores = programme(values, fps, settings)
            true = [(c.time - start) * fps for c in curves]
            asked = np.array([_asked(e) for e in groups[number]], dtype=np.bool_)
            yield Lesson(Clues(scores, values, fps), true, asked, number)


def _cells(curves: list[Curve], fps: float) -> int:
    seconds = max(c.end for c in curves) - min(c.start for c in curves)
    return len(curves) * int(seconds * fps + 1)


def drawn_together(examples: Sequence[Example]) -> list[list[Example]]:
    """Per shot its curves without held (stepped) keys: what was drawn together."""
    found: dict[str, list[Example]] = {}
    for example in examples:
        if not any(k.out_type.startswith("stepped") for k in example.curve.keys[:-1]):
            found.setdefault(f"{example.sha256} {example.shot}", []).append(example)
    return list(found.values())


def _asked(example: Example) -> bool:
    """Whether a curve has keys enough to learn from."""
    curve = example.curve
    return len(curve.keys) >= _KEYED and curve.end - curve.start >= _LASTS
