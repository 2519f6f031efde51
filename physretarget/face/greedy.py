"""The paper's placement: longest first, each where it fits best, and gaps closed by one span."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from physretarget.face.cover import Covered, CoverSettings, Job, cover, unit_price
from physretarget.face.place import Placed, lengths
from physretarget.face.screen import (
    ScreenSettings,
    Windows,
    aligned_costs,
    lay,
    slack_of,
    window_costs,
)
from physretarget.face.templates import Bank
from physretarget.options.facial import Method


def greedy_cover(
    job: Job,
    fps: float,
    bank: Bank,
    method: Method,
    settings: CoverSettings,
    screen: ScreenSettings,
    together: Sequence[Sequence[int]] = (),
) -> Covered:
    """Phrases of four keys and more claim frames where their error is below the fidelity.

    What nobody claims is a gap: covered by fitted spans and marked so. It knows no alternatives,
    so its confidence is not known, and it does not place channels together.
    """
    channels, frames = job.values.shape
    claimed = job.barred.copy()
    captures = [
        Windows.of(job.values[c, None], job.smooth[c, None], job.weight[c, None])
        for c in range(channels)
    ]
    found: list[list[Placed]] = [[] for _ in range(channels)]
    tried = lengths(frames, fps, settings.longest)
    longest_first = [int(n) for n in tried[::-3] if n >= 6]
    big = np.array([k for k, t in enumerate(bank.phrases) if t.keys >= 4], dtype=np.intp)
    tightest = np.array([np.diff(bank.phrases[k].table[:, 0]).min() for k in big])
    known = np.array([], dtype=np.intp)
    for n in longest_first:
        if len(big):
            # Keys closer than two frames could not be told apart in the capture.
            known = big[bank.available(True, n / fps)[big] & (tightest * n >= 2.0)]
        if len(known):
            shapes = bank.phrase_shapes(n, n / fps)[known]
            most = np.array([bank.phrases[k].amplitudes.max() for k in known], dtype=np.float32)
            keys = np.array([bank.phrases[k].keys for k in known], dtype=np.float32)
            price = np.float32(settings.key_cost * settings.inner_key) * (keys - 2)
            bounds = (np.zeros_like(most), most * np.float32(screen.amplitude[1]))
            for c in range(channels):
                _claim(
                    found[c],
                    claimed[c],
                    job.barred[c],
                    captures[c],
                    n,
                    known,
                    shapes,
                    bounds,
                    price / unit_price(n, fps, settings),
                    method,
                    settings.fidelity,
                    screen,
                )
    chains = [_fill(found[c], job, c, fps, bank, method, settings, screen) for c in range(channels)]
    return Covered(chains, np.full(job.values.shape, np.nan))


def _claim(
    found: list[Placed],
    claimed: NDArray[np.bool_],
    barred: NDArray[np.bool_],
    capture: Windows,
    n: int,
    known: NDArray[np.intp],
    shapes: NDArray[np.float32],
    bounds: tuple[NDArray[np.float32], NDArray[np.float32]],
    price: NDArray[np.float32],
    method: Method,
    fidelity: float,
    screen: ScreenSettings,
) -> None:
    while True:
        # Neighbours may share their end frame, so only inner frames must be free.
        busy = np.concatenate([[0], np.cumsum(claimed)])
        inside = claimed & ~barred
        ends = inside[: len(inside) - n] | inside[n:] | _leaves_one_frame(inside, n)
        starts = np.flatnonzero((busy[n:-1] - busy[1:-n] == 0) & ~ends)
        if not len(starts):
            return
        laid = lay(capture, starts, n, shapes, method, screen, bounds)
        cost = window_costs(laid, method, screen)
        if method == "hmm":
            room = slack_of(capture, screen).windows(n)[:, 0, starts].astype(np.float32)
            limit = np.full(cost.shape, fidelity**2, dtype=np.float32)
            cost = aligned_costs(laid, cost, room, limit, screen)
        # Of those that fit, fewer keys are worth some misfit, at the optimal placement's price.
        score = np.where(cost <= fidelity**2, cost + price, np.inf)
        best = int(np.argmin(score))
        row, column = divmod(best, score.shape[1])
        if not np.isfinite(score[row, column]):
            return
        first = int(starts[row])
        found.append(Placed(first, first + n, int(known[column]), phrase=True))
        claimed[first + 1 : first + n] = True


def _leaves_one_frame(inside: NDArray[np.bool_], n: int) -> NDArray[np.bool_]:
    """Per start, whether a window of n + 1 frames would leave a gap that no span fits in."""
    taken = np.pad(inside, 2, constant_values=True)  # as if claimed before and after the take
    before = taken[:-4] & ~taken[1:-3]
    after = taken[4:] & ~taken[3:-1]
    gaps: NDArray[np.bool_] = before[: len(inside) - n] | after[n:]
    return gaps


def _fill(
    found: list[Placed],
    job: Job,
    channel: int,
    fps: float,
    bank: Bank,
    method: Method,
    settings: CoverSettings,
    screen: ScreenSettings,
) -> list[Placed]:
    chain: list[Placed] = []
    edge = 0
    for piece in [*sorted(found, key=lambda p: p.first), None]:
        until = job.values.shape[1] - 1 if piece is None else piece.first
        if until > edge:
            part = job.part(channel, slice(edge, until + 1))
            if until - edge < 2:
                chain.append(Placed(edge, until, 0, fitted=True))
            else:
                gap = cover(part, fps, bank, method, settings, screen).chains[0]
                chain += [
                    Placed(p.first + edge, p.last + edge, p.template, p.phrase, True) for p in gap
                ]
        if piece is not None:
            chain.append(piece)
            edge = piece.last
    return chain
