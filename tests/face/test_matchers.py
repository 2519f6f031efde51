from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from physretarget.errors import UsageError
from physretarget.face import hmm, sax
from physretarget.face.distance import distance_profile

seeds = st.integers(0, 2**32 - 1)


@settings(max_examples=50, deadline=None)
@given(seeds, st.integers(1, 60), st.integers(1, 30), st.floats(-1e3, 1e3))
def test_distance_equals_brute_force(seed, m, n, offset):
    rng = np.random.default_rng(seed)
    p, q = rng.normal(size=m) + offset, rng.normal(size=n)
    expected = [
        sum(((q[i] - q[0]) - (p[r + i] - p[r])) ** 2 for i in range(n)) for r in range(m - n + 1)
    ]
    assert distance_profile(p, q) == pytest.approx(expected, rel=1e-6, abs=1e-6)


def test_distance_by_fft_equals_the_direct_one():
    rng = np.random.default_rng(3)
    p, q = np.cumsum(rng.normal(size=4000)), np.cumsum(rng.normal(size=90))
    direct = [np.sum((q - q[0] - (p[r : r + 90] - p[r])) ** 2) for r in range(0, 3911, 97)]
    assert distance_profile(p, q)[::97] == pytest.approx(direct, rel=1e-6)


def test_identical_match_is_found():
    p = np.sin(np.arange(100) / 5.0)
    profile = distance_profile(p, p[40:60] + 3.0)
    assert int(np.argmin(profile)) == 40
    assert profile[40] == pytest.approx(0, abs=1e-9)


def test_breakpoints_are_lins_table():
    # Lin et al. 2003, Table 3.
    assert sax.breakpoints(4) == pytest.approx([-0.67, 0, 0.67], abs=5e-3)
    assert sax.breakpoints(10)[:3] == pytest.approx([-1.28, -0.84, -0.52], abs=5e-3)
    assert sax.cell_distances(4)[0].tolist() == pytest.approx([0, 0, 0.674, 1.349], abs=1e-3)
    with pytest.raises(UsageError, match="3 to 10"):
        sax.breakpoints(11)


@settings(max_examples=60, deadline=None)
@given(seeds, st.integers(2, 50), st.integers(1, 12), st.integers(3, 10))
def test_mindist_is_a_lower_bound(seed, n, word, alphabet):
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(2, 4, n)).cumsum(axis=-1)
    bound = sax.mindist(sax.words(a, word, alphabet), sax.words(b, word, alphabet), n, alphabet)
    za, zb = sax.z_normalise(a), sax.z_normalise(b)
    true = np.linalg.norm(za[:, None] - zb[None], axis=-1)
    if word <= n:
        assert (bound <= true + 1e-9).all()


def test_sax_words_against_a_plain_loop():
    rng = np.random.default_rng(5)
    rows = rng.normal(size=(6, 24)).cumsum(axis=1)
    for row, got in zip(rows, sax.words(rows, 6, 5), strict=True):
        z = (row - row.mean()) / row.std()
        means = [z[4 * i : 4 * i + 4].mean() for i in range(6)]
        assert got.tolist() == [sum(m > c for c in sax.breakpoints(5)) for m in means]
    assert set(sax.words(np.full((1, 12), 7.3), 4, 5)[0].tolist()) == {2}


def brute_viterbi(cost, beta, lam, free_end):
    n, m = cost.shape
    best, found = np.inf, None
    for path in itertools.combinations_with_replacement(range(m), n):
        if path[0] != 0 or (not free_end and path[-1] != m - 1):
            continue
        total = sum(cost[i, k] for i, k in enumerate(path))
        total += sum(beta * abs(b - a - lam) for a, b in itertools.pairwise(path))
        if total < best:
            best, found = total, path
    return best, found


@settings(max_examples=60, deadline=None)
@given(seeds, st.integers(1, 5), st.integers(1, 7), st.floats(0, 3), st.booleans())
def test_viterbi_equals_enumeration(seed, n, m, beta, free_end):
    if n == 1 and m > 1:
        free_end = True
    cost = np.random.default_rng(seed).uniform(size=(3, n, m))
    lam = (m - 1) / max(n - 1, 1)
    total, path = hmm.viterbi(cost, beta, free_end=free_end)
    for b in range(3):
        expected, _ = brute_viterbi(cost[b], beta, lam, free_end)
        assert total[b] == pytest.approx(expected)
        own = sum(cost[b, i, k] for i, k in enumerate(path[b]))
        own += sum(beta * abs(y - x - lam) for x, y in itertools.pairwise(path[b]))
        assert own == pytest.approx(expected)
        assert (np.diff(path[b]) >= 0).all()


def test_viterbi_finds_a_time_warp():
    u = np.linspace(0, 1, 16)
    example = np.sin(2 * np.pi * u)
    t = np.linspace(0, 1, 40)
    capture = np.sin(2 * np.pi * t**1.3)
    cost = hmm.emission(hmm.features(example, 0.7), hmm.features(capture, 0.7))
    _, path = hmm.viterbi(cost[None], 0.01, free_end=False)
    assert np.abs(path[0] / 39 - u ** (1 / 1.3)).max() < 0.06
