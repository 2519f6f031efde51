"""Windows whose price the hidden Markov model's alignment can still lower, and no others.

The even alignment prices every window from above, by one matrix product. Windows on chains nearly
as cheap as the cheapest are then solved by Viterbi, with every template that could be the best one
there (bounds from below tell). Which windows: a beam over the even prices, as recognisers of speech
decode twice; or, without a beam, all that the bounds do not rule out, so that the placement is the
one that solving every window would give.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget.face.alignment import Slack, lower_bound
from physretarget.face.place import cheapest_through
from physretarget.face.screen import (
    ScreenSettings,
    Windows,
    aligned_costs,
    lay,
    slack_of,
    window_costs,
)
from physretarget.face.templates import Offer

Array32 = NDArray[np.float32]
_BLOCK = 1_000_000  # residuals held at once


@dataclass(frozen=True, eq=False)
class Model:
    """What a window's price follows from.

    offers: by length, the templates. unit: by length, the price of one squared unit per frame.
    """

    capture: Windows
    offers: Callable[[int], Sequence[Offer]]
    unit: Callable[[int], np.float32]
    screen: ScreenSettings
    slack: Slack

    @classmethod
    def of(
        cls,
        capture: Windows,
        offers: Callable[[int], Sequence[Offer]],
        unit: Callable[[int], np.float32],
        screen: ScreenSettings,
    ) -> Model:
        """With the slack of the capture."""
        return cls(capture, offers, unit, screen, slack_of(capture, screen))


def refine(
    cost: Array32,
    best: NDArray[np.int32],
    spans: NDArray[np.intp],
    less: Array32,
    model: Model,
) -> None:
    """Align, in place, what cheap chains could be made of.

    Args:
        cost: (C, M, L) prices by the even alignment, less the discounts.
        best: (C, M, L) numbers of the cheapest templates.
        spans: (L,) lengths.
        less: (C, M) discounts of windows that end at a frame.
        model: what prices follow from.
    """
    beam = model.screen.beam
    through = cheapest_through(cost, spans)
    top = through.min(axis=(1, 2), keepdims=True)
    if beam is None:
        wanted = cheapest_through(_bounds(cost, spans, less, model), spans) <= top
    else:
        wanted = through <= top + np.float32(beam)
    wanted &= np.isfinite(cost)
    for index in np.flatnonzero(wanted.any(axis=(0, 1))).tolist():
        if spans[index] < 2:
            continue
        channels, ends = np.nonzero(wanted[:, :, index])
        price, number = _solved(channels, ends, int(spans[index]), model)
        own = cost[channels, ends, index] + less[channels, ends]
        better = price < own
        place = channels[better], ends[better], index
        cost[place] += price[better] - own[better]
        best[place] = number[better]


def _bounds(cost: Array32, spans: NDArray[np.intp], less: Array32, model: Model) -> Array32:
    """(C, M, L) prices that no alignment can go below.

    Whichever template it is: the dearest misfit that the cheapest even price allows is that of the
    commonest template, and the bound falls by least for the smallest misfit.
    """
    low = cost.copy()
    for index, n in enumerate(spans.tolist()):
        offered = model.offers(n)
        if not offered or n < 2:
            continue
        least = np.float32(min(float(o.price.min()) for o in offered))
        own = cost[:, n:, index] + less[:, n:]
        even = np.maximum(own - least, 0.0) / model.unit(n)
        room = model.slack.windows(n).astype(np.float32)
        if any(o.amplitudes is not None for o in offered):
            room = room + _ramp(model.capture, n, len(room))
        even = np.where(np.isfinite(even), even, 0.0).astype(np.float32)
        bound = lower_bound(even, room, model.screen.haste, n + 1, wide=model.screen.wide)
        low[:, n:, index] -= (even - bound) * model.unit(n)
    return low


def _ramp(capture: Windows, n: int, reach: int) -> Array32:
    """(D, C, M - n) how much the ramp under a phrase moves in d = 1 … D frames."""
    smooth = capture.smooth.reshape(-1, capture.frames)
    rise = np.abs(smooth[:, n:] - smooth[:, :-n]) / np.float32(n)
    moved: Array32 = np.arange(1, reach + 1, dtype=np.float32)[:, None, None] * rise
    return moved


def _solved(
    channels: NDArray[np.intp], ends: NDArray[np.intp], n: int, model: Model
) -> tuple[Array32, NDArray[np.intp]]:
    """(P,) prices of windows of n + 1 frames under their best templates, and these."""
    room = model.slack.windows(n)[:, channels, ends - n].astype(np.float32)
    starts = channels * model.capture.frames + ends - n
    unit, screen = model.unit(n), model.screen
    price = np.full(len(starts), np.inf, dtype=np.float32)
    number = np.zeros(len(starts), dtype=np.intp)
    for offer in model.offers(n):
        step = max(1, _BLOCK // (len(offer.numbers) * (n + 1)))
        for first in range(0, len(starts), step):
            some = slice(first, first + step)
            laid = lay(
                model.capture, starts[some], n, offer.shapes, "hmm", screen, offer.amplitudes
            )
            even = window_costs(laid, "hmm", screen)
            known = (even * unit + offer.price).min(axis=1, keepdims=True)
            limit = np.broadcast_to((known - offer.price) / unit, even.shape)
            total = aligned_costs(laid, even, room[:, some], limit, screen) * unit + offer.price
            pick = np.argmin(total, axis=1)
            low = total[np.arange(len(pick)), pick]
            better = low < price[some]
            price[some] = np.where(better, low, price[some])
            number[some] = np.where(better, offer.numbers[pick], number[some])
    return price, number
