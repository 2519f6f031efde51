"""The cheapest cover of dense channels by spans of the library, all channels at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget.face.cuts import cut_discounts
from physretarget.face.joint import joint_paths
from physretarget.face.place import Placed, cut_confidence, lengths, shortest_path
from physretarget.face.refine import Model, refine
from physretarget.face.screen import Method, ScreenSettings, Windows, lay, window_costs
from physretarget.face.templates import Bank, Offer

Array = NDArray[np.float64]
_BLOCK = 3_000_000  # residuals held at once


@dataclass(frozen=True, kw_only=True)
class CoverSettings:
    """Prices, in units of half a squared misfit over squared fidelity, at 30 frames a second.

    fidelity: misfit (of the channel's range) that counts as one unit. key_cost: price of a key.
    inner_key: the share of it that keys inside
    a phrase cost. prior: weight of how common a template is. longest: longest span in seconds.
    turns, rests: share of a key's price that a cut at a turning point, or where a rest begins or
    ends, is cheaper.
    lag: frames that a channel may lead or trail its group. temperature: of the confidence.
    """

    fidelity: float = 0.01
    key_cost: float = 12.0
    inner_key: float = 0.7
    prior: float = 1.0
    longest: float = 4.0
    phrases: bool = False
    turns: float = 0.25
    rests: float = 0.0
    lag: int = 2
    temperature: float = 3.0


@dataclass(frozen=True, eq=False)
class Job:
    """Channels (C, M) in units of what each moves.

    values: the capture. smooth: without noise. weight: how much each frame counts.
    barred: frames that nothing may run across.
    """

    values: Array
    smooth: Array
    weight: Array
    barred: NDArray[np.bool_]

    def part(self, channel: int, frames: slice) -> Job:
        """Some frames of one channel."""
        one = slice(channel, channel + 1)
        return Job(
            self.values[one, frames],
            self.smooth[one, frames],
            self.weight[one, frames],
            self.barred[one, frames],
        )


@dataclass(frozen=True, eq=False)
class Priced:
    """Every window of every channel with its cheapest template.

    cost (C, M, L): price of the window that ends at a frame with length spans[l]; best likewise:
    the template's number, spans before phrases; known: how many spans there are.
    """

    cost: NDArray[np.float32]
    best: NDArray[np.int32]
    spans: NDArray[np.intp]
    known: int

    def placed(self, channel: int, path: list[tuple[int, int]]) -> list[Placed]:
        """The templates along a path of (end frame, number of the length)."""
        chain = []
        for j, x in path:
            number = int(self.best[channel, j, x])
            phrase = number >= self.known
            template = number - self.known if phrase else number
            chain.append(Placed(j - int(self.spans[x]), j, template, phrase))
        return chain


@dataclass(frozen=True, eq=False)
class Covered:
    """Per channel its chain of templates; confidence (C, M) that a cut lies within a frame."""

    chains: list[list[Placed]]
    confidence: Array


def cover(
    job: Job,
    fps: float,
    bank: Bank,
    method: Method,
    settings: CoverSettings,
    screen: ScreenSettings,
    together: Sequence[Sequence[int]] = (),
) -> Covered:
    """The cheapest chains; none runs across a barred frame.

    together: channels that share one placement, but for small lags.
    """
    priced = price(job, fps, bank, method, settings, screen)
    paths = shortest_path(priced.cost, priced.spans)
    for members in together:
        rows = np.asarray(members, dtype=np.intp)
        joint = joint_paths(priced.cost[rows], priced.spans, settings.lag)
        for row, path in zip(members, joint, strict=True):
            paths[row] = path
    sure = cut_confidence(priced.cost, priced.spans, settings.temperature)
    return Covered([priced.placed(c, path) for c, path in enumerate(paths)], sure)


def price(
    job: Job,
    fps: float,
    bank: Bank,
    method: Method,
    settings: CoverSettings,
    screen: ScreenSettings,
) -> Priced:
    """Lay every template over every window."""
    channels, frames = job.values.shape
    spans = lengths(frames, fps, settings.longest)
    cost = np.full((channels, frames, len(spans)), np.inf, dtype=np.float32)
    best = np.zeros((channels, frames, len(spans)), dtype=np.int32)
    coarse = set(_coarse(spans, fps)) if settings.phrases else set()
    capture = Windows.of(job.values, job.smooth, job.weight)
    for index, n in enumerate(spans):
        for offer in offers(bank, int(n), fps, settings, int(n) in coarse):
            _bid(cost, best, index, offer, capture, unit_price(n, fps, settings), int(n), method,
                 screen)  # fmt: skip
    if job.barred.any():
        _bar(cost, spans, job.barred)
    share = settings.key_cost
    less = cut_discounts(job.smooth, fps, settings.turns * share, settings.rests * share)
    cost -= less[:, :, None]
    if method == "hmm":
        model = Model.of(
            capture,
            lambda n: offers(bank, n, fps, settings, n in coarse),
            lambda n: unit_price(n, fps, settings),
            screen,
        )
        refine(cost, best, spans, less, model)
    return Priced(cost, best, spans, len(bank.spans))


def offers(bank: Bank, n: int, fps: float, settings: CoverSettings, phrases: bool) -> list[Offer]:
    """What a bank has for windows of n + 1 frames."""
    found = [_spans_offer(bank, n, fps, settings)]
    if phrases:
        found.append(_phrases_offer(bank, n, fps, settings))
    return [offer for offer in found if offer is not None]


def unit_price(n: int, fps: float, settings: CoverSettings) -> np.float32:
    """What a squared unit per frame costs in windows of n + 1 frames."""
    return np.float32((n + 1) * (30.0 / fps) / (2.0 * settings.fidelity**2))


def _spans_offer(bank: Bank, n: int, fps: float, settings: CoverSettings) -> Offer | None:
    if not bank.spans:
        return None
    known = bank.available(False, n / fps)
    chosen = np.flatnonzero(known) if known.any() else np.arange(len(bank.spans))
    counts = np.array([len(bank.spans[k].segments) for k in chosen], dtype=np.float64)
    price = settings.key_cost - settings.prior * np.log(counts / counts.sum())
    if not known.any():
        price = price + settings.key_cost  # stretched beyond a factor of two: a last resort
    return Offer(chosen, bank.span_shapes(n)[chosen], price.astype(np.float32))


def _phrases_offer(bank: Bank, n: int, fps: float, settings: CoverSettings) -> Offer | None:
    known = np.flatnonzero(bank.available(True, n / fps)).tolist()
    # Keys closer than two frames could not be told apart in the capture.
    chosen = [k for k in known if np.diff(bank.phrases[k].table[:, 0]).min() * n >= 2.0]
    if not len(chosen):
        return None
    keys = np.array([bank.phrases[k].keys for k in chosen])
    counts = np.array([len(bank.phrases[k].segments) for k in chosen], dtype=np.float64)
    price = settings.key_cost * (1.0 + settings.inner_key * (keys - 2))
    price = price - settings.prior * np.log(counts / counts.sum())
    numbers = np.asarray(chosen, dtype=np.intp)
    most = np.array([bank.phrases[k].amplitudes.max() for k in chosen], dtype=np.float32)
    return Offer(
        numbers + len(bank.spans),
        bank.phrase_shapes(n, n / fps)[numbers],
        price.astype(np.float32),
        (np.zeros_like(most), most * np.float32(5.0)),
    )


def _coarse(spans: NDArray[np.intp], fps: float) -> list[int]:
    """Every length up to 12 frames, then by 8 %: phrases stretch, so neighbours say the same."""
    kept: list[int] = []
    for n in spans.tolist():
        if n >= 5 and (not kept or n <= 12 or n >= 1.08 * kept[-1]):
            kept.append(n)
    return kept


def _bid(
    cost: NDArray[np.float32],
    best: NDArray[np.int32],
    index: int,
    offer: Offer,
    capture: Windows,
    weight: np.float32,
    n: int,
    method: Method,
    screen: ScreenSettings,
) -> None:
    """Keep, per channel and end frame, the cheaper of what is known and the best of the offer."""
    channels, frames = cost.shape[:2]
    starts = np.arange(frames - n)
    step = max(1, _BLOCK // (max(1, len(offer.numbers)) * frames))
    for first in range(0, channels, step):
        block = slice(first, first + step)
        rows = np.arange(channels)[block]
        count = len(rows)
        at = (rows[:, None] * frames + starts).ravel()
        laid = lay(capture, at, n, offer.shapes, method, screen, offer.amplitudes)
        total = window_costs(laid, method, screen) * weight + offer.price
        pick = np.argmin(total, axis=1)
        low = np.take_along_axis(total, pick[:, None], 1).reshape(count, -1)
        better = low < cost[block, n:, index]
        cost[block, n:, index] = np.where(better, low, cost[block, n:, index])
        numbers = offer.numbers[pick].reshape(count, -1)
        best[block, n:, index] = np.where(better, numbers, best[block, n:, index])


def _bar(cost: NDArray[np.float32], spans: NDArray[np.intp], barred: NDArray[np.bool_]) -> None:
    before = np.cumsum(barred, axis=1)  # barred frames up to and including each
    for index, n in enumerate(spans):
        inside: NDArray[np.intp] = before[:, n - 1 : -1] - before[:, :-n]
        cost[:, n:, index] = np.where(inside > 0, np.inf, cost[:, n:, index])
