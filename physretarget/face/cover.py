"""The cheapest cover of dense channels by spans of the library, all channels at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget.face.place import Placed, lengths, shortest_path
from physretarget.face.screen import Method, ScreenSettings, Windows, fit_windows
from physretarget.face.templates import Bank

Array = NDArray[np.float64]
_BLOCK = 3_000_000  # residuals held at once


@dataclass(frozen=True, kw_only=True)
class CoverSettings:
    """Prices, in units of half a squared misfit over squared fidelity, at 30 frames a second.

    fidelity: misfit (of the channel's range) that counts as one unit. key_cost: price of a key.
    inner_key: the share of it that keys inside
    a phrase cost. prior: weight of how common a template is. longest: longest span in seconds.
    """

    fidelity: float = 0.01
    key_cost: float = 12.0
    inner_key: float = 0.7
    prior: float = 1.0
    longest: float = 4.0
    phrases: bool = False


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

    def windows(self, rows: slice) -> Windows:
        """Some channels end to end, in single precision."""
        return Windows.of(self.values[rows], self.smooth[rows], self.weight[rows])

    def part(self, channel: int, frames: slice) -> Job:
        """Some frames of one channel."""
        one = slice(channel, channel + 1)
        return Job(
            self.values[one, frames],
            self.smooth[one, frames],
            self.weight[one, frames],
            self.barred[one, frames],
        )


def cover(
    job: Job,
    fps: float,
    bank: Bank,
    method: Method,
    settings: CoverSettings,
    screen: ScreenSettings,
) -> list[list[Placed]]:
    """Segments for every channel; none runs across a barred frame."""
    channels, frames = job.values.shape
    spans = lengths(frames, fps, settings.longest)
    cost = np.full((channels, frames, len(spans)), np.inf, dtype=np.float32)
    best = np.zeros((channels, frames, len(spans)), dtype=np.int32)
    coarse = set(_coarse(spans, fps)) if settings.phrases else set()
    for index, n in enumerate(spans):
        offers = [_spans_offer(bank, int(n), fps, settings)]
        if int(n) in coarse:
            offers.append(_phrases_offer(bank, int(n), fps, settings))
        weight = np.float32((n + 1) * (30.0 / fps) / (2.0 * settings.fidelity**2))
        for offer in offers:
            if offer is not None:
                _bid(cost, best, index, offer, job, weight, int(n), method, screen)
    if job.barred.any():
        _bar(cost, spans, job.barred)
    known = len(bank.spans)
    return [
        [_placed(j - int(spans[x]), j, int(best[c, j, x]), known) for j, x in path]
        for c, path in enumerate(shortest_path(cost, spans))
    ]


def _placed(first: int, last: int, number: int, spans: int) -> Placed:
    phrase = number >= spans
    return Placed(first, last, number - spans if phrase else number, phrase)


@dataclass(frozen=True, eq=False)
class Offer:
    """Templates that are tried on windows of one length: numbers (spans before phrases), prices."""

    numbers: NDArray[np.intp]
    shapes: NDArray[np.float32]
    price: NDArray[np.float32]
    amplitudes: tuple[NDArray[np.float32], NDArray[np.float32]] | None = None


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
        bank.phrase_shapes(n)[numbers],
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
    job: Job,
    weight: np.float32,
    n: int,
    method: Method,
    screen: ScreenSettings,
) -> None:
    """Keep, per channel and end frame, the cheaper of what is known and the best of the offer."""
    channels, frames = job.values.shape
    starts = np.arange(frames - n)
    step = max(1, _BLOCK // (max(1, len(offer.numbers)) * frames))
    for first in range(0, channels, step):
        block = slice(first, first + step)
        count = len(job.values[block])
        fit = fit_windows(
            job.windows(block),
            (np.arange(count)[:, None] * frames + starts).ravel(),
            n,
            offer.shapes,
            method,
            screen,
            offer.amplitudes,
        )
        total = fit.cost * weight + offer.price
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
