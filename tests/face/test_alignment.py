"""The hidden Markov model over many windows at once, its bounds, and the search that uses them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from physretarget.face import hmm
from physretarget.face.alignment import Pairs, Slack, aligned, lower_bound
from physretarget.face.cover import CoverSettings, Job, offers, price, unit_price
from physretarget.face.curve import Curve
from physretarget.face.library import Library
from physretarget.face.noise import smoothed
from physretarget.face.place import cheapest_through, shortest_path
from physretarget.face.screen import ScreenSettings, Windows, aligned_costs, lay, window_costs
from physretarget.face.shot import Shot
from physretarget.face.templates import make_bank

seeds = st.integers(0, 2**32 - 1)


def problem(seed, m, rows=4, columns=3):
    rng = np.random.default_rng(seed)
    single = np.float32
    features = [
        (
            rng.normal(size=(rows, m)).cumsum(axis=1).astype(single),
            rng.normal(size=(columns, m)).cumsum(axis=1).astype(single),
            rng.uniform(0.5, 1.5, (rows, 1)).astype(single),
        )
        for _ in range(2)
    ]
    weight = rng.uniform(0.2, 1.0, (rows, m)).astype(single)
    return features, weight


@settings(max_examples=40, deadline=None)
@given(seeds, st.integers(3, 14), st.floats(0, 3))
def test_many_alignments_are_each_the_viterbi_one(seed, m, haste):
    features, weight = problem(seed, m)
    rows, columns = np.indices((4, 3)).reshape(2, -1)
    found = aligned(Pairs(features, weight, rows, columns), haste, np.full(12, np.inf, np.float32))
    for k in range(12):
        cost = sum(
            (target[rows[k]][None, :] - (gain[rows[k]] * shapes[columns[k]])[:, None]) ** 2
            for target, shapes, gain in features
        )
        cost = (cost * weight[rows[k]][:, None]).astype(float)
        total, _ = hmm.viterbi(cost[None], haste, free_end=False)
        assert found[k] * m == pytest.approx(total[0], rel=1e-4, abs=1e-5)


@settings(max_examples=40, deadline=None)
@given(seeds, st.integers(3, 12), st.floats(0, 2), st.integers(1, 3))
def test_the_bound_is_below_and_the_even_alignment_above(seed, m, haste, reach):
    features, weight = problem(seed, m, rows=1)
    slack = Slack.of([f[0] for f in features], weight, reach).windows(m - 1)[:, 0, 0]
    rows, columns = np.zeros(3, dtype=np.intp), np.arange(3)
    exact = aligned(Pairs(features, weight, rows, columns), haste, np.full(3, np.inf, np.float32))
    even = sum(
        (weight * (target - gain * shapes) ** 2).mean(axis=1) for target, shapes, gain in features
    )
    room = np.repeat(slack[:, None], 3, axis=1).astype(np.float32)
    assert (lower_bound(even, room, haste, m) <= exact * (1 + 1e-5) + 1e-6).all()
    assert (exact <= even * (1 + 1e-5)).all()


def take(seed=3, channels=3, frames=45):
    rng = np.random.default_rng(seed)
    t = np.arange(frames) / 30
    rows = []
    for _ in range(channels):
        keys = np.concatenate([[0.0], np.sort(rng.uniform(0.1, 1.4, 4)), [1.5]])
        keys += np.arange(6) * 1e-3
        rows.append(Curve.through(keys, rng.uniform(0, 1, 6), "flat").evaluate(t))
    clean = np.stack(rows)
    clean = (clean - clean.min(1, keepdims=True)) / np.ptp(clean, axis=1)[:, None]
    values = clean + rng.normal(0, 0.01, clean.shape)
    return Job(values, smoothed(values, 30), np.ones_like(values), np.zeros(values.shape, bool))


@pytest.fixture(scope="module")
def bank():
    rng = np.random.default_rng(1)
    shots = [
        Shot(
            f"s{n}",
            {"c": Curve.through(np.cumsum(rng.uniform(0.1, 0.8, 8)), rng.uniform(0, 1, 8), kind)},
        )
        for n, kind in enumerate(["flat", "auto", "flat", "auto", "linear"])
    ]
    return make_bank(Library.of(shots), phrases=False, most_spans=10)


def aligned_in_full(job, bank, cover, screen):
    """Every template over every window, whatever it costs: prices (C, M, L)."""
    even = price(job, 30, bank, "hmm", cover, replace(screen, beam=-np.inf))
    capture = Windows.of(job.values, job.smooth, job.weight)
    channels, frames = job.values.shape
    cost = even.cost.copy()
    for index, n in enumerate(even.spans.tolist()):
        starts = np.arange(frames - n)
        for c in range(channels):
            (offer,) = offers(bank, n, 30, cover, False)
            laid = lay(capture, starts + c * frames, n, offer.shapes, "hmm", screen)
            plain = window_costs(laid, "hmm", screen)
            everything = np.full(plain.shape, np.inf, np.float32)
            no_bound = np.full((2, len(starts)), 1e3, np.float32)
            full = aligned_costs(laid, plain, no_bound, everything, screen)
            unit = unit_price(n, 30, cover)
            less = (plain * unit + offer.price).min(axis=1) - even.cost[c, n:, index]
            cost[c, n:, index] = (full * unit + offer.price).min(axis=1) - less
    return cost, even


@pytest.mark.parametrize("wide", [False, True])
@pytest.mark.parametrize("haste", [2e-4, 2e-3])
def test_bounds_give_the_placement_of_aligning_everything(bank, haste, wide):
    job, cover = take(), CoverSettings()
    screen = ScreenSettings(haste=haste, beam=None, wide=wide)
    wanted, even = aligned_in_full(job, bank, cover, screen)
    found = price(job, 30, bank, "hmm", cover, screen)
    best = cheapest_through(wanted, found.spans).min(axis=(1, 2))
    assert cheapest_through(found.cost, found.spans).min(axis=(1, 2)) == pytest.approx(
        best, rel=1e-4
    )
    assert shortest_path(found.cost, found.spans) == shortest_path(wanted, found.spans)
    assert (best < cheapest_through(even.cost, found.spans).min(axis=(1, 2)) - 0.1).any()


def test_the_beam_seldom_misses_anything(bank):
    job, cover = take(seed=5, channels=12), CoverSettings()
    full = price(job, 30, bank, "hmm", cover, ScreenSettings(beam=None))
    beam = price(job, 30, bank, "hmm", cover, ScreenSettings())
    one, other = shortest_path(full.cost, full.spans), shortest_path(beam.cost, beam.spans)
    assert sum(a == b for a, b in zip(one, other, strict=True)) >= 11
