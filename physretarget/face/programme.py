"""Where keys belong, told by the capture alone: a typed semi-Markov dynamic programme.

A chain of spans (``spans.py``) covers the take. A span costs half its weighted squared misfit plus
the price of a key, both in nats; the cheapest chain is found exactly, over all channels at once. A
sample weighs by its variance, the device's own and a third of the squared slope: a frame that is
taken up to one frame early or late misreads a fast channel more. Slopes and anchors come from a
smooth curve: a filter's at first, the model's own in later rounds. Lastly each key is moved by a
few frames to where all spans together, joined, are likeliest.

Prices of windows are made in stretches of frames: memory does not grow with the take.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget.face.keyfit import Chain, curve_of, key_table
from physretarget.face.noise import noise_level, smoothed
from physretarget.face.spans import EASE, HOLD, KINDS, lengths, window_costs

Array = NDArray[np.float64]
Ints = NDArray[np.intp]
_Stretch = tuple[int, Array, NDArray[np.int8], Array]
JITTER = 1.0 / 3.0
"""Variance of a frame's time, frames squared: evenly spread over one frame early to one late."""

_CELLS = 3_000_000  # prices held at once
_ON, _LONG = 2.0, 1.0  # nats for going on with a hold that has lasted so many seconds


@dataclass(frozen=True, kw_only=True)
class ProgrammeSettings:
    """key_price: of an eased span, nats. level: deviation that is never worth explaining, in units
    of what a channel moves. firm: weight of the smooth curve at a span's ends, in samples. rounds:
    how often the model takes the smooth curve's place. longest: window, s (holds go on beyond).
    reach: frames that a key may be moved by at last; 0: it stays.
    """

    key_price: float = 7.0
    level: float = 0.01
    firm: float = 5.0
    rounds: int = 2
    longest: float = 10.0
    reach: int = 3


@dataclass(frozen=True, eq=False)
class Score:
    """One channel's chain and what was found on the way.

    model (M,): the chain's curve. weight (M,): inverse variance of every sample. level: standard
    deviation of the channel's steady noise. likely (M,): probability of a key at every frame.
    """

    chain: Chain
    model: Array
    weight: Array
    level: float
    likely: Array


def programme(
    values: Array,
    fps: float,
    settings: ProgrammeSettings | None = None,
    *,
    pinned: Sequence[Sequence[int]] | None = None,
    posterior: bool = True,
    cheaper: Array | None = None,
) -> list[Score]:
    """The likeliest keys of every channel.

    Args:
        values: (C, M) channels in units of what each moves.
        fps: frame rate.
        settings: prices.
        pinned: per channel frames that are keys whatever they cost.
        posterior: compute the probabilities too.
        cheaper: (C, M) nats by which a key at a frame costs less: what else is known of key times.
    """
    chosen = settings or ProgrammeSettings()
    frames = values.shape[1]
    forced = [sorted({0, frames - 1, *rows}) for rows in (pinned or [()] * len(values))]
    smooth = smoothed(values, fps)
    level = np.maximum(noise_level(values, smooth, fps), chosen.level)
    for number in range(chosen.rounds + 1):
        weight = 1.0 / (level[:, None] ** 2 + JITTER * np.gradient(smooth, axis=1) ** 2)
        search = _Search(values, weight, smooth, fps, chosen, _reaches(forced, frames), cheaper)
        chains = search.chains()
        if number == chosen.rounds and chosen.reach:
            chains = [
                polish(v, w, s, c, set(f), chosen.reach)
                for v, w, s, c, f in zip(values, weight, level, chains, forced, strict=True)
            ]
        smooth = np.stack([_model(*row) for row in zip(chains, values, weight, strict=True)])
    likely = search.posterior() if posterior else np.zeros_like(values)
    return [Score(*row) for row in zip(chains, smooth, weight, level.tolist(), likely, strict=True)]


def _model(chain: Chain, values: Array, weight: Array) -> Array:
    return curve_of(key_table(chain, values, weight, lines=True), len(values))


def _reaches(forced: list[list[int]], frames: int) -> Ints:
    """(C, M) how far a window may reach from every frame: to the next frame that must be a key."""
    reach = np.empty((len(forced), frames), dtype=np.intp)
    for row, stops in zip(reach, forced, strict=True):
        stop = np.array(stops, dtype=np.intp)
        following = np.searchsorted(stop, np.arange(frames), side="right")
        row[:] = stop[np.minimum(following, len(stop) - 1)] - np.arange(frames)
    return reach


@dataclass(frozen=True, eq=False)
class _Search:
    """The chains through one set of prices."""

    values: Array
    weight: Array
    anchor: Array
    fps: float
    settings: ProgrammeSettings
    reach: Ints
    cheaper: Array | None = None

    @property
    def tried(self) -> Ints:
        """Window lengths."""
        return lengths(self.values.shape[1], self.fps, self.settings.longest)

    def prices(self, backward: bool = False) -> Iterator[_Stretch]:
        """Stretches of starts: the first, (C, B, L) lowest prices, their kinds, prices of holds.

        Infinite where a window leaves the take, crosses a frame that must be a key, or would leave
        a single frame before it.
        """
        channels, frames = self.values.shape
        tried = self.tried
        dear = self.settings.key_price + np.array([k.dear for k in KINDS])
        size = max(16, _CELLS // (channels * len(tried)))
        firsts = list(range(0, frames - 1, size))
        for first in reversed(firsts) if backward else firsts:
            last = min(frames, first + size + int(tried[-1]))
            part = slice(first, last)
            starts = min(size, frames - 1 - first)
            best = np.full((channels, starts, len(tried)), np.inf)
            holds = np.full_like(best, np.inf)
            kinds = np.zeros(best.shape, dtype=np.int8)
            costs = window_costs(
                self.values[:, part], self.weight[:, part], self.anchor[:, part],
                self.settings.firm, tried, starts,
            )  # fmt: skip
            for x, (n, cost) in enumerate(costs):
                cost += dear[:, None, None]
                room = cost.shape[2]
                if self.cheaper is not None:
                    cost -= self.cheaper[None, :, first + n : first + n + room]
                kinds[:, :room, x] = cost.argmin(axis=0)
                best[:, :room, x] = cost.min(axis=0)
                holds[:, :room, x] = cost[HOLD]
            reach = self.reach[:, first : first + starts, None]
            barred = (tried > reach) | ((reach - tried == 1) & (reach > 2))
            best[barred], holds[barred] = np.inf, np.inf
            yield first, best, kinds, holds

    def chains(self) -> list[Chain]:
        """The cheapest chain of every channel, holds joined.

        A long hold may be followed by another at almost no price: rests last as long as they last.
        """
        channels, frames = self.values.shape
        tried = self.tried
        top = int(tried[-1])
        best = np.full((channels, frames + top), np.inf)
        held = np.full((channels, frames + top), np.inf)  # the last window was a long hold
        best[:, 0] = 0.0
        came = np.zeros((channels, frames + top, 3), dtype=np.int32)  # length, kind, state before
        stay = np.zeros((channels, frames + top, 2), dtype=np.int32)  # length, state before
        long = int(np.searchsorted(tried, min(top, round(_LONG * self.fps))))
        again = self.settings.key_price + KINDS[HOLD].dear - _ON
        for first, price, kinds, holds in self.prices():
            for i in range(price.shape[1]):
                at = first + i
                before, rest = best[:, at], held[:, at] - again
                some = (before[:, None] + price[:, i], rest[:, None] + holds[:, i])
                on = some[1] < some[0]
                total = np.where(on, some[1], some[0])
                ends = at + tried
                better = total < best[:, ends]
                c, x = np.nonzero(better)
                best[c, ends[x]] = total[c, x]
                came[c, ends[x], 0] = tried[x]
                came[c, ends[x], 1] = np.where(on[c, x], HOLD, kinds[c, i, x])
                came[c, ends[x], 2] = on[c, x]
                rested = rest < before
                total = np.where(rested, rest, before)[:, None] + holds[:, i, long:]
                c, x = np.nonzero(total < held[:, ends[long:]])
                held[c, ends[long + x]] = total[c, x]
                stay[c, ends[long + x], 0] = tried[long + x]
                stay[c, ends[long + x], 1] = rested[c]
        return [_walk(came[c], stay[c], frames - 1) for c in range(channels)]

    def posterior(self) -> Array:
        """(C, M) probability of a key at every frame, over all chains: forward and backward sums.

        The rests that go on beyond the longest window count as chains of holds, each at its price.
        """
        channels, frames = self.values.shape
        tried = self.tried
        top = int(tried[-1])
        forward = np.full((channels, frames + top), -np.inf)
        forward[:, 0] = 0.0
        for first, price, _, _ in self.prices():
            for i in range(price.shape[1]):
                ends = first + i + tried
                forward[:, ends] = np.logaddexp(
                    forward[:, ends], forward[:, first + i, None] - price[:, i]
                )
        back = np.full((channels, frames + top), -np.inf)
        back[:, frames - 1] = 0.0
        for first, price, _, _ in self.prices(backward=True):
            for i in range(price.shape[1] - 1, -1, -1):
                back[:, first + i] = _log_sum(back[:, first + i + tried] - price[:, i])
        whole = forward[:, frames - 1, None]
        likely: Array = np.exp(np.clip(forward[:, :frames] + back[:, :frames] - whole, -700, 0))
        return likely


def _log_sum(rows: Array) -> Array:
    most = rows.max(axis=1)
    safe = np.where(np.isfinite(most), most, 0.0)
    with np.errstate(divide="ignore"):
        total: Array = safe + np.log(np.exp(rows - safe[:, None]).sum(axis=1))
    return total


def _walk(came: NDArray[np.int32], stay: NDArray[np.int32], last: int) -> Chain:
    """From the last frame back to the first; neighbouring holds become one."""
    frames = [last]
    kinds: list[int] = []
    at, resting = last, False
    while at > 0:
        if resting:
            n, kind, resting = int(stay[at, 0]), HOLD, bool(stay[at, 1])
        else:
            n, kind, resting = int(came[at, 0]), int(came[at, 1]), bool(came[at, 2])
        at -= n
        if kind == HOLD and kinds and kinds[-1] == HOLD:
            frames[-1] = at
        else:
            frames.append(at)
            kinds.append(kind)
    return Chain(np.array(frames[::-1], dtype=np.intp), np.array(kinds[::-1], dtype=np.intp))


def polish(
    values: Array, weight: Array, level: float, chain: Chain, fixed: set[int], reach: int
) -> Chain:
    """Each key moved by up to ``reach`` frames to where it and its neighbours' spans are likeliest.

    Two sweeps. The likelihood takes every candidate's own slopes for the samples' variances, so
    that a place is not preferred for the weights that the present place has made.
    """
    frames, kinds = chain.frames.copy(), chain.kinds
    last = len(frames) - 1
    for _ in range(2):
        moved = False
        for k in range(1, last):
            if int(frames[k]) in fixed:
                continue
            a, b = max(0, k - 2), min(last, k + 2)
            low = frames[a]
            part = slice(int(low), int(frames[b]) + 1)
            found = [(np.inf, 0)]
            for step in range(-reach, reach + 1):
                place = frames[k] + step
                if place - frames[k - 1] < 2 or frames[k + 1] - place < 2:
                    continue
                some = frames[a : b + 1] - low
                some[k - a] = place - low
                local = Chain(some, kinds[a:b])
                found.append((unlikely(values[part], weight[part], level, local), step))
            best = min(found, key=lambda f: (round(f[0], 9), abs(f[1])))
            frames[k] += best[1]
            moved |= best[1] != 0
        if not moved:
            break
    return Chain(frames, kinds)


def unlikely(values: Array, weight: Array, level: float, chain: Chain) -> float:
    """Minus the logarithm of a chain's likelihood on a stretch of values, nats."""
    model = _model(chain, values, weight)
    slope = np.gradient(model) if len(model) > 2 else np.zeros(len(model))
    variance = level**2 + JITTER * slope**2
    return 0.5 * float(np.sum((values - model) ** 2 / variance + np.log(variance)))


def whole_rest(frames: int) -> Chain:
    """A channel that never moves: one hold, however long."""
    return Chain(np.array([0, frames - 1], dtype=np.intp), np.array([HOLD], dtype=np.intp))


def plain_ease(frames: int) -> Chain:
    """The simplest chain: one ease."""
    return Chain(np.array([0, frames - 1], dtype=np.intp), np.array([EASE], dtype=np.intp))
