"""The cheapest cover of dense channels by spans of the library, all channels at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget.face.place import Placed, lengths, shortest_path
from physretarget.face.screen import Method, ScreenSettings, fit_windows
from physretarget.face.templates import Bank

Array = NDArray[np.float64]
_BLOCK = 3_000_000  # residuals held at once


@dataclass(frozen=True, kw_only=True)
class CoverSettings:
    """Prices, in units of half a squared misfit over squared fidelity, at 30 frames a second.

    fidelity: misfit (of the channel's range) that counts as one unit. key_cost: price of a key.
    prior: weight of how common a template is. longest: longest span in seconds.
    """

    fidelity: float = 0.02
    key_cost: float = 6.0
    prior: float = 1.0
    longest: float = 4.0


def cover(
    values: Array,
    smooth: Array,
    fps: float,
    bank: Bank,
    method: Method,
    settings: CoverSettings,
    screen: ScreenSettings,
    barred: NDArray[np.bool_] | None = None,
) -> list[list[Placed]]:
    """Spans for every channel of values (C, M); no span runs across a barred (C, M) frame."""
    channels, frames = values.shape
    spans = lengths(frames, fps, settings.longest)
    cost = np.full((channels, frames, len(spans)), np.inf, dtype=np.float32)
    best = np.zeros((channels, frames, len(spans)), dtype=np.int16)
    tables = [t.table for t in bank.spans]
    counts = np.array([len(t.segments) for t in bank.spans], dtype=np.float64)
    rows = max(1, _BLOCK // max(1, len(tables)))
    step = max(1, rows // frames)
    for l, n in enumerate(spans):
        known = bank.available(bank.spans, n / fps) if tables else np.zeros(0, dtype=bool)
        chosen = np.flatnonzero(known) if known.any() else np.arange(len(tables))
        shapes = bank.span_shapes(int(n))[chosen]
        share = counts[chosen] / counts[chosen].sum()
        extra = settings.key_cost - settings.prior * np.log(share) * 1.0
        if not known.any():
            extra = extra + settings.key_cost  # stretched beyond a factor of two
        weight = (n + 1) * (30.0 / fps) / (2.0 * settings.fidelity**2)
        starts = np.arange(frames - n)
        for first in range(0, channels, step):
            block = slice(first, first + step)
            count = len(values[block])
            flat = values[block].astype(np.float32).ravel()
            even = smooth[block].astype(np.float32).ravel()
            where = (np.arange(count)[:, None] * frames + starts).ravel()
            fit = fit_windows(flat, even, where, int(n), shapes, method, screen)
            price = fit.score * np.float32(weight) + extra.astype(np.float32)
            pick = np.argmin(price, axis=1)
            cost[block, n:, l] = np.take_along_axis(price, pick[:, None], 1).reshape(count, -1)
            best[block, n:, l] = chosen[pick].reshape(count, -1)
    if barred is not None:
        _bar(cost, spans, barred)
    paths = shortest_path(cost, spans)
    return [
        [Placed(j - int(spans[l]), j, int(best[c, j, l])) for j, l in path]
        for c, path in enumerate(paths)
    ]


def _bar(cost: NDArray[np.float32], spans: NDArray[np.intp], barred: NDArray[np.bool_]) -> None:
    before = np.cumsum(barred, axis=1)  # barred frames up to and including each
    for l, n in enumerate(spans):
        inside = before[:, n - 1 : -1] - before[:, : -n]
        cost[:, n:, l] = np.where(inside > 0, np.inf, cost[:, n:, l])
