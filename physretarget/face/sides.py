"""Left and right keyed together, wherever the capture moves them alike.

An animator sets the keys of both lids, both brows, both eyes in one go. The programme keys every
channel by itself, and noise puts the two keys of one moment a few frames apart. Here each pair of
channels that are named for two sides and move alike about a key gets it on one frame: the one that
is likeliest for both. A key that only one side has is given to the other or taken away, whichever
makes both together likelier at the price of a key.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from physretarget.face.keyfit import Chain
from physretarget.face.programme import Score, unlikely
from physretarget.face.spans import HOLD, likeliest_kinds

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
ALIKE = 0.9
"""Correlation of the two sides within a quarter of a second, above which they move alike."""
NEAR = 0.1
"""Seconds that the two keys of one moment may be apart before they are put on one frame."""
_ABOUT = 0.25  # s on either side that likeness is judged by
_SIDES = (
    (re.compile("left", re.IGNORECASE), "right"),
    (re.compile(r"(?<![A-Za-z])l(?![A-Za-z])", re.IGNORECASE), "r"),
    (re.compile(r"(?<=[a-z])L(?=[A-Z_.]|$)"), "R"),
)


def partners(names: Sequence[str]) -> Iterator[tuple[int, list[int]]]:
    """Left channels and the right ones that may be their partners, by number.

    Eyes that look aside turn in and out together, so ``eyeLookInLeft`` may belong to
    ``eyeLookOutRight``, too.

    Args:
        names: of channels.

    Yields:
        Number of a left channel, numbers of right ones.
    """
    number = {name.lower(): k for k, name in enumerate(names)}
    for k, name in enumerate(names):
        others = {pattern.sub(right, name).lower() for pattern, right in _SIDES} - {name.lower()}
        for other in list(others):
            for one, two in (("lookin", "lookout"), ("lookout", "lookin")):
                if one in other:
                    others.add(other.replace(one, two))
        found = [number[other] for other in sorted(others) if other in number]
        if found:
            yield k, found


def alike(left: Array, right: Array, level: tuple[float, float], fps: float) -> Flags:
    """(M,) whether two channels without noise move, and move alike, about each frame."""
    width = 2 * max(1, round(_ABOUT * fps)) + 1

    def mean(x: Array) -> Array:
        found: Array = uniform_filter1d(x, width, mode="nearest")
        return found

    a, b = mean(left), mean(right)
    spread = [np.maximum(mean(x * x) - m * m, 0.0) for x, m in ((left, a), (right, b))]
    shared = mean(left * right) - a * b
    moving = (spread[0] > level[0] ** 2) & (spread[1] > level[1] ** 2)
    flags: Flags = moving & (shared >= ALIKE * np.sqrt(spread[0] * spread[1]))
    return flags


def together(
    names: Sequence[str],
    scores: Sequence[Score],
    values: Array,
    smooth: Array,
    fps: float,
    price: float,
    pinned: Sequence[Sequence[int]],
) -> list[Score]:
    """The scores of all channels, with the keys of two sides on one frame.

    Args:
        names: of the channels, C.
        scores: one per channel.
        values: (C, M) in units of what each moves.
        smooth: (C, M) the same without noise.
        fps: frame rate.
        price: of a key, nats.
        pinned: per channel the frames of keys that stay.

    Returns:
        One score per channel; channels without a partner are untouched.
    """
    found = list(scores)
    taken: set[int] = set()
    for left, rights in partners(names):
        pairs = []
        for right in rights:
            if not {left, right} & taken:
                level = scores[left].level, scores[right].level
                flags = alike(smooth[left], smooth[right], level, fps)
                pairs.append((int(flags.sum()), right, flags))
        count, right, flags = max(pairs, default=(0, 0, np.empty(0, np.bool_)), key=lambda p: p[0])
        if not count:
            continue
        taken |= {left, right}
        sides = (
            _Side(values[left], found[left], set(pinned[left])),
            _Side(values[right], found[right], set(pinned[right])),
        )
        chains = _Pair(sides, flags, fps, price).chains()
        for row, chain in zip((left, right), chains, strict=True):
            found[row] = replace(found[row], chain=chain)
    return found


@dataclass(frozen=True, eq=False)
class _Side:
    values: Array
    score: Score
    pinned: set[int]

    def cost(self, frames: list[int], first: int, last: int) -> float:
        """How unlikely the stretch between two of its keys is, in nats."""
        inside = np.array([f for f in frames if first <= f <= last], dtype=np.intp)
        part = slice(first, last + 1)
        values, weight = self.values[part], self.score.weight[part]
        chain = Chain(inside - first, likeliest_kinds(inside - first, values, weight))
        return unlikely(values, weight, self.score.level, chain)


@dataclass(frozen=True, eq=False)
class _Pair:
    sides: tuple[_Side, _Side]
    flags: Flags
    fps: float
    price: float

    def chains(self) -> list[Chain]:
        """Both chains, their keys on one frame wherever the two move alike."""
        frames = [side.score.chain.frames.tolist() for side in self.sides]
        before = [list(f) for f in frames]
        reach = max(2, round(NEAR * self.fps))
        for a, b in _matched(frames[0], frames[1], reach):
            if a != b and self.flags[a] and self.flags[b]:
                self._join(frames, a, b)
        for own in (0, 1):
            for frame in list(frames[own]):
                if self.flags[frame] and all(abs(f - frame) > reach for f in frames[1 - own]):
                    self._share(frames, own, frame)
        chains = []
        for side, now, was in zip(self.sides, frames, before, strict=True):
            if now == was:
                chains.append(side.score.chain)
                continue
            places = np.array(now, dtype=np.intp)
            kinds = likeliest_kinds(places, side.values, side.score.weight)
            chains.append(_rests_joined(Chain(places, kinds), side.pinned))
        return chains

    def _join(self, frames: list[list[int]], a: int, b: int) -> None:
        """The two keys of one moment on the frame that is likeliest for both."""
        fixed = [p for p, side in zip((a, b), self.sides, strict=True) if p in side.pinned]
        last = len(self.flags) - 1
        ends = [p for p in (a, b) if p in (0, last)]
        if len(fixed) == 2 or ends:
            return
        options = []
        for place in fixed or range(min(a, b) - 1, max(a, b) + 2):
            total = 0.0
            for own, (side, at) in enumerate(zip(self.sides, (a, b), strict=True)):
                low, high = _about(frames[own], at)
                near = [f for f in frames[own] if f != at]
                if any(abs(f - place) < 2 for f in near):
                    total = np.inf
                    break
                total += side.cost(sorted([*near, place]), low, high)
            options.append((total, place))
        total, place = min(options)
        if np.isfinite(total):
            for own, at in enumerate((a, b)):
                frames[own][frames[own].index(at)] = place

    def _share(self, frames: list[list[int]], own: int, frame: int) -> None:
        """A key that one side has alone: for both, or for none."""
        other = 1 - own
        if frame in (0, len(self.flags) - 1) or any(abs(f - frame) < 2 for f in frames[other]):
            return
        low, high = _about(frames[other], frame)
        with_it = sorted([*frames[other], frame])
        give = self.price + self.sides[other].cost(with_it, low, high)
        give -= self.sides[other].cost(frames[other], low, high)
        take = np.inf
        if frame not in self.sides[own].pinned:
            low, high = _about(frames[own], frame)
            without = [f for f in frames[own] if f != frame]
            take = self.sides[own].cost(without, low, high) - self.price
            take -= self.sides[own].cost(frames[own], low, high)
        if give <= take:
            frames[other][:] = with_it
        else:
            frames[own].remove(frame)


def _about(frames: list[int], place: int) -> tuple[int, int]:
    """Two keys before and two after a place, or the take's ends."""
    at = int(np.searchsorted(frames, place))
    beyond = at + 1 if at < len(frames) and frames[at] == place else at
    return frames[max(0, at - 2)], frames[min(len(frames) - 1, beyond + 1)]


def _matched(left: list[int], right: list[int], reach: int) -> list[tuple[int, int]]:
    """Keys that are each other's nearest, no further apart than ``reach``."""
    a, b = np.array(left), np.array(right)
    apart = np.abs(a[:, None] - b[None])
    there, back = apart.argmin(axis=1), apart.argmin(axis=0)
    return [
        (left[i], right[j])
        for i, j in enumerate(there.tolist())
        if back[j] == i and apart[i, j] <= reach
    ]


def _rests_joined(chain: Chain, pinned: set[int]) -> Chain:
    """Neighbouring holds become one: a rest has two keys."""
    kinds = chain.kinds
    inner = [
        k
        for k in range(1, len(kinds))
        if kinds[k - 1] == HOLD and kinds[k] == HOLD and int(chain.frames[k]) not in pinned
    ]
    return Chain(np.delete(chain.frames, inner), np.delete(kinds, inner))
