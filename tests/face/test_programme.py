"""The programme: its prices against plain least squares, its chains against enumeration."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from physretarget.face.curve import Curve
from physretarget.face.keyfit import Chain, curve_of, key_table
from physretarget.face.measure import key_f1, pseudo_capture
from physretarget.face.programme import ProgrammeSettings, programme
from physretarget.face.spans import HOLD, KINDS, lengths, window_costs


def test_window_costs_are_those_of_plain_least_squares():
    rng = np.random.default_rng(0)
    values, weight = rng.normal(size=(2, 40)), rng.uniform(0.5, 3.0, (2, 40))
    anchor, firm = rng.normal(size=(2, 40)), 4.0
    for n, cost in window_costs(values, weight, anchor, firm, np.array([2, 3, 17, 39]), 40):
        for channel in range(2):
            for start in range(0, 40 - n, 7):
                part = slice(start, start + n + 1)
                w = weight[channel, part].copy()
                w[[0, -1]] *= 0.5
                u = np.linspace(0, 1, n + 1)
                for number, kind in enumerate(KINDS):
                    basis = [np.ones(n + 1)]
                    if kind.start is not None:
                        a, b = kind.start, kind.end
                        basis.append(a * u + (3 - 2 * a - b) * u**2 + (a + b - 2) * u**3)
                    rows = np.stack(basis, axis=1)
                    ends = weight[channel, [start, start + n]] * firm
                    full = np.vstack([rows, rows[[0, -1]]])
                    target = np.concatenate(
                        [values[channel, part], anchor[channel, [start, start + n]]]
                    )
                    root = np.sqrt(np.concatenate([w, ends]))
                    solved, *_ = np.linalg.lstsq(full * root[:, None], target * root)
                    rest = (target - full @ solved) * root
                    assert cost[number, channel, start] == pytest.approx(
                        0.5 * float(rest @ rest), rel=1e-6, abs=1e-9
                    )


def test_chain_and_posterior_equal_enumeration():
    """Every way to cover ten frames, priced window by window."""
    rng = np.random.default_rng(3)
    values = np.cumsum(rng.normal(0, 0.2, (1, 10)), axis=1)
    chosen = ProgrammeSettings(rounds=0, reach=0, key_price=0.5, level=0.3)
    score = programme(values, 30.0, chosen)[0]
    from physretarget.face import programme as room
    from physretarget.face.noise import smoothed

    search = room._Search(
        values, score.weight[None], smoothed(values, 30.0), 30.0, chosen,
        room._reaches([[0, 9]], 10),
    )  # fmt: skip
    tried = lengths(10, 30.0, 10.0).tolist()
    [(_, price, _, _)] = list(search.prices())
    chains = {}
    for count in range(9):
        for inner in combinations(range(1, 9), count):
            keys = (0, *inner, 9)
            steps = np.diff(keys)
            if all(s in tried for s in steps):
                parts = zip(keys[:-1], steps, strict=True)
                chains[keys] = sum(price[0, k, tried.index(s)] for k, s in parts)
    best = min(chains, key=lambda k: chains[k])
    whole = np.exp(-np.array(list(chains.values())))
    chance = np.zeros(10)
    for keys, mass in zip(chains, whole / whole.sum(), strict=True):
        chance[list(keys)] += mass
    assert score.likely == pytest.approx(chance, abs=1e-9)
    kinds = score.chain.kinds
    joined = {*score.chain.frames.tolist()}
    assert joined <= set(best)
    assert len(best) - len(joined) <= int((kinds == HOLD).sum())  # neighbouring holds are one


def test_stretches_of_prices_give_the_chain_of_the_whole(monkeypatch):
    from physretarget.face import programme as room

    rng = np.random.default_rng(1)
    times = np.cumsum(rng.uniform(0.2, 1.2, 40))
    curve = Curve.through(times, rng.uniform(0, 1, 40), "flat")
    values = pseudo_capture(curve, 30.0, rng)[1][None]
    whole = programme(values, 30.0)[0]
    monkeypatch.setattr(room, "_CELLS", 4000)
    parts = programme(values, 30.0)[0]
    assert parts.chain.frames.tolist() == whole.chain.frames.tolist()
    assert parts.likely == pytest.approx(whole.likely, abs=1e-9)


def test_flat_keys_are_found():
    found = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        gaps = rng.integers(6, 24, 7)
        frames = np.concatenate([[0], np.cumsum(gaps)])
        curve = Curve.through(frames / 30.0, rng.uniform(0, 1, 8), "flat")
        values = pseudo_capture(curve, 30.0, rng)[1]
        unit = np.ptp(values)
        chain = programme((values - values.min())[None] / unit, 30.0)[0].chain
        found.append(key_f1(chain.frames.astype(float), frames.astype(float), 1.0)[0])
    assert np.mean(found) > 0.88


def test_a_long_rest_is_one_hold():
    rng = np.random.default_rng(0)
    rest = np.concatenate([np.zeros(900), np.ones(800)]) + rng.normal(0, 0.01, 1700)
    chain = programme(rest[None], 30.0)[0].chain
    assert len(chain.frames) <= 4
    assert (chain.kinds == HOLD).sum() == 2


def test_key_table_gives_back_an_exact_curve():
    """Eases, a hold and a free swing: sampled, then solved for."""
    frames = np.array([0, 12, 20, 41, 60])
    curve = Curve.through(frames / 1.0, [0.0, 1.0, 1.0, 0.3, 0.9], "auto")
    values = curve.evaluate(np.arange(61.0))
    chain = Chain(frames, np.array([0, HOLD, 0, 0]))
    table = key_table(chain, values, np.ones(61))
    assert table[:, 1] == pytest.approx(curve.value, abs=1e-7)
    assert curve_of(table, 61) == pytest.approx(values, abs=1e-7)
