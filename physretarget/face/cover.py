"""The cheapest cover of dense channels by spans of the library, all channels at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from physretarget.face.cuts import cut_discounts
from physretarget.face.joint import joint_paths
from physretarget.face.place import Placed, Reached, cut_shares, lengths, near, trace
from physretarget.face.refine import Model, refine
from physretarget.face.screen import ScreenSettings, Windows, lay, window_costs
from physretarget.face.templates import Bank, Offer
from physretarget.options.facial import Method

Array = NDArray[np.float64]
_BLOCK = 3_000_000  # residuals held at once
_WIDE = 40_000_000  # frames of windows held at once: of a take in one stretch, and of one in many
_NARROW = 8_000_000


@dataclass(frozen=True, kw_only=True)
class CoverSettings:
    """Prices, in units of half a squared misfit over squared fidelity, at 30 frames a second.

    fidelity: misfit (of the channel's range) that counts as one unit. key_cost: price of a key.
    inner_key: the share of it that keys inside
    a phrase cost. prior: weight of how common a template is. longest: longest span in seconds.
    turns, rests: share of a key's price that a cut at a turning point, or where a rest begins or
    ends, is cheaper.
    lag: frames that a channel may lead or trail its group. temperature: of the confidence.
    held: windows (channels x frames x lengths) whose prices are in memory at once.
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
    held: int = 40_000_000


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
        return _placed(
            {j: int(self.best[channel, j, x]) for j, x in path}, path, self.spans, self.known
        )


def _placed(
    numbers: Mapping[int, int] | NDArray[np.int32],
    path: list[tuple[int, int]],
    spans: NDArray[np.intp],
    known: int,
) -> list[Placed]:
    chain = []
    for j, x in path:
        number = int(numbers[j])
        phrase = number >= known
        template = number - known if phrase else number
        chain.append(Placed(j - int(spans[x]), j, template, phrase))
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

    Long takes are priced a stretch at a time, so that memory does not grow with them: the chains
    are the cheapest of the whole take all the same, the confidence knows one margin ahead.
    together: channels that share one placement, but for small lags; such a take is one stretch.
    """
    pricing = Pricing.of(job, fps, bank, method, settings, screen)
    channels, frames = job.values.shape
    spans = pricing.spans
    taken = np.zeros((channels, frames), dtype=np.int16)
    number = np.zeros((channels, frames), dtype=np.int32)
    shares = np.zeros((channels, frames))
    best = ahead = None  # of the frames that a stretch shares with the one before it
    for stretch in pricing.stretches(whole=bool(together)):
        priced = pricing.part(stretch.low, stretch.high)
        reached = Reached.through(priced.cost, spans, best)
        cuts, sums = cut_shares(priced.cost, spans, settings.temperature, ahead)
        own, kept = stretch.inside, slice(stretch.first, stretch.last)
        taken[:, kept] = reached.taken[:, own]
        shares[:, kept] = cuts[:, own]
        chosen = reached.taken[:, own, None].astype(np.intp)
        number[:, kept] = np.take_along_axis(priced.best[:, own], chosen, axis=2)[:, :, 0]
        best, ahead = reached.best[:, stretch.shared], sums[:, stretch.shared]
        if not together:
            del priced  # before the next is made
    paths = trace(taken, spans)
    chains = [_placed(number[c], path, spans, len(bank.spans)) for c, path in enumerate(paths)]
    for members in together:
        rows = np.asarray(members, dtype=np.intp)
        joint = joint_paths(priced.cost[rows], spans, settings.lag)
        for row, path in zip(members, joint, strict=True):
            chains[row] = priced.placed(row, path)
    return Covered(chains, near(shares, 1))


@dataclass(frozen=True)
class Stretch:
    """Frames low to high (open) are priced; results are kept of first to last (open).

    shared: frames, counted from low, whose sums the next stretch begins with.
    """

    low: int
    first: int
    last: int
    high: int
    shared: slice

    @property
    def inside(self) -> slice:
        """first to last, counted from low."""
        return slice(self.first - self.low, self.last - self.low)


def stretches(frames: int, most: int, margin: int) -> list[Stretch]:
    """Even stretches whose priced frames are at most ``most``, or 4 margins where that is more.

    Around its own frames each has a margin, so that it sees what comes before and after.
    """
    if frames <= most:
        return [Stretch(0, 0, frames, frames, slice(0, 0))]
    room = max(2 * margin, most - 2 * margin)
    edges = np.linspace(0, frames, -(-frames // room) + 1).round().astype(int).tolist()
    found = []
    for first, last in pairwise(edges):
        low, high = max(0, first - margin), min(frames, last + margin)
        after = max(0, last - margin)  # where the next one's priced frames begin
        found.append(Stretch(low, first, last, high, slice(after - low, last - low)))
    return found


@dataclass(frozen=True, eq=False)
class Pricing:
    """What prices follow from; less (C, M): discounts of windows that end at a frame."""

    job: Job
    fps: float
    bank: Bank
    method: Method
    settings: CoverSettings
    screen: ScreenSettings
    spans: NDArray[np.intp]
    capture: Windows
    less: NDArray[np.float32]

    @classmethod
    def of(
        cls,
        job: Job,
        fps: float,
        bank: Bank,
        method: Method,
        settings: CoverSettings,
        screen: ScreenSettings,
    ) -> Pricing:
        """For a whole take."""
        spans = lengths(job.values.shape[1], fps, settings.longest)
        capture = Windows.of(job.values, job.smooth, job.weight)
        share = settings.key_cost
        less = cut_discounts(job.smooth, fps, settings.turns * share, settings.rests * share)
        return cls(job, fps, bank, method, settings, screen, spans, capture, less)

    def stretches(self, *, whole: bool = False) -> list[Stretch]:
        """The take in parts that fit in memory, or in one if its price is needed at once.

        Three times the longest window is enough for what lies farther away not to matter.
        """
        channels, frames = self.job.values.shape
        margin = 3 * int(self.spans[-1])
        most = frames if whole else self.settings.held // max(1, channels * len(self.spans))
        return stretches(frames, most, margin)

    def part(self, low: int, high: int) -> Priced:
        """Prices of all windows within frames low to high (open), as of a take of its own."""
        settings, spans, fps = self.settings, self.spans, self.fps
        capture = self.capture.part(low, high)
        cost = np.full((len(self.less), high - low, len(spans)), np.inf, dtype=np.float32)
        best = np.zeros(cost.shape, dtype=np.int32)
        coarse = set(_coarse(spans, fps)) if settings.phrases else set()
        most = _WIDE if high - low == self.capture.frames else _NARROW
        for index, n in enumerate(spans.tolist()):
            for offer in offers(self.bank, n, fps, settings, n in coarse):
                _bid(cost, best, index, offer, capture, unit_price(n, fps, settings), n,
                     self.method, self.screen, most)  # fmt: skip
        barred = self.job.barred[:, low:high]
        if barred.any():
            _bar(cost, spans, barred)
        less = self.less[:, low:high]
        cost -= less[:, :, None]
        if self.method == "hmm":
            model = Model.of(
                capture,
                lambda n: offers(self.bank, n, fps, settings, n in coarse),
                lambda n: unit_price(n, fps, settings),
                self.screen,
            )
            refine(cost, best, spans, less, model)
        return Priced(cost, best, spans, len(self.bank.spans))


def price(
    job: Job,
    fps: float,
    bank: Bank,
    method: Method,
    settings: CoverSettings,
    screen: ScreenSettings,
) -> Priced:
    """Lay every template over every window."""
    return Pricing.of(job, fps, bank, method, settings, screen).part(0, job.values.shape[1])


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
    most: int,
) -> None:
    """Keep, per channel and end frame, the cheaper of what is known and the best of the offer."""
    channels, frames = cost.shape[:2]
    starts = np.arange(frames - n)
    step = max(1, _BLOCK // (max(1, len(offer.numbers)) * frames))
    few = max(1, most // (n + 1))  # where few templates serve, windows are what takes room
    for first in range(0, channels, step):
        block = slice(first, first + step)
        rows = np.arange(channels)[block]
        count = len(rows)
        at = (rows[:, None] * frames + starts).ravel()
        pick, low = np.empty(len(at), dtype=np.intp), np.empty(len(at), dtype=np.float32)
        for top in range(0, len(at), few):
            some = slice(top, top + few)
            laid = lay(capture, at[some], n, offer.shapes, method, screen, offer.amplitudes)
            total = window_costs(laid, method, screen) * weight + offer.price
            pick[some] = np.argmin(total, axis=1)
            low[some] = np.take_along_axis(total, pick[some, None], 1)[:, 0]
        lowest = low.reshape(count, -1)
        better = lowest < cost[block, n:, index]
        cost[block, n:, index] = np.where(better, lowest, cost[block, n:, index])
        numbers = offer.numbers[pick].reshape(count, -1)
        best[block, n:, index] = np.where(better, numbers, best[block, n:, index])


def _bar(cost: NDArray[np.float32], spans: NDArray[np.intp], barred: NDArray[np.bool_]) -> None:
    before = np.cumsum(barred, axis=1)  # barred frames up to and including each
    for index, n in enumerate(spans):
        inside: NDArray[np.intp] = before[:, n - 1 : -1] - before[:, :-n]
        cost[:, n:, index] = np.where(inside > 0, np.inf, cost[:, n:, index])
