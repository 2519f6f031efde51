"""Joint placement, confidence of cuts, cuts at turning points, and stretching of the middle."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from physretarget.errors import UsageError
from physretarget.face.curve import Curve
from physretarget.face.cuts import cut_discounts, rest_frames, turning_frames
from physretarget.face.joint import joint_paths, lagging
from physretarget.face.library import Library
from physretarget.face.match import MatchSettings, match
from physretarget.face.place import cut_shares, near, shortest_path
from physretarget.face.rig import Rig
from physretarget.face.shot import Shot, Take
from physretarget.face.templates import middle_stretched


def chains(frames, spans):
    for count in range(1, frames):
        for chain in itertools.product(range(len(spans)), repeat=count):
            ends = np.cumsum(spans[list(chain)])
            if ends[-1] == frames - 1:
                yield [(int(e), x) for e, x in zip(ends, chain, strict=True)]


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(3, 8), st.floats(0.2, 5))
def test_confidence_equals_enumeration(seed, frames, temperature):
    rng = np.random.default_rng(seed)
    spans = np.array(sorted({1, 2, frames - 1}))
    cost = rng.uniform(0, 4, size=(1, frames, len(spans))).astype(np.float32)
    weight = np.zeros(frames)
    total = 0.0
    for chain in chains(frames, spans):
        mass = np.exp(-sum(cost[0, j, x] for j, x in chain) / temperature)
        total += mass
        weight[[0, *(j for j, _ in chain)]] += mass
    shares = cut_shares(cost, spans, temperature)[0]
    found = shares[0]
    assert found == pytest.approx(weight / total, rel=1e-4)
    about = near(shares, 1)[0]
    assert (about >= found - 1e-9).all()
    assert (about <= 1).all()


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 1))
def test_lags_equal_enumeration(seed, lag):
    rng = np.random.default_rng(seed)
    spans, frames = np.arange(1, 9), 10
    cost = rng.uniform(size=(frames, len(spans))).astype(np.float32)
    cuts = [0, 3, 6, 9]
    path = lagging(cost, spans, cuts, lag)
    best = np.inf
    for a, b in itertools.product(range(3 - lag, 4 + lag), range(6 - lag, 7 + lag)):
        if 0 < a < b < 9:
            steps = [(a, a), (b, b - a), (9, 9 - b)]
            best = min(best, sum(cost[j, n - 1] for j, n in steps))
    assert sum(cost[j, x] for j, x in path) == pytest.approx(best, rel=1e-5)
    assert [j for j, _ in path][-1] == 9


def test_joint_paths_share_their_cuts_up_to_the_lag():
    rng = np.random.default_rng(0)
    spans = np.arange(2, 12)
    cost = rng.uniform(size=(3, 40, 10)).astype(np.float32)
    shared = [j for j, _ in shortest_path(cost.sum(axis=0, keepdims=True), spans)[0]]
    for path in joint_paths(cost, spans, 2):
        assert len(path) == len(shared)
        assert max(abs(j - k) for (j, _), k in zip(path, shared, strict=True)) <= 2


def test_cuts_are_preferred_where_a_channel_turns_or_rests():
    values = np.interp(np.arange(60), [0, 10, 20, 40, 59], [0, 1, 0.2, 0.2, 0.9])
    assert turning_frames(values).tolist() == [10, 20]
    rests = rest_frames(values, 30.0)
    assert np.abs(rests - [20, 40]).max() <= 1
    cost = np.zeros((1, 60, 2), dtype=np.float32)
    cost -= cut_discounts(values[None], 30.0, 3.0, 0.0)[:, :, None]
    assert np.flatnonzero(cost[0, :, 0]).tolist() == [10, 20]


@pytest.mark.parametrize("ratio", [0.8, 1.0, 1.3, 2.0])
def test_middle_stretching_keeps_the_ends_and_the_slopes(ratio):
    curve = Curve.through(
        [0, 0.1, 0.2, 0.5, 0.8, 0.9, 1.0], [0, 0.3, 1, 0.2, 0.7, 0.1, 0], "spline"
    )
    table = middle_stretched(curve.table, ratio)
    made = Curve.from_table(table)
    seconds = table[:, 0] * ratio
    assert seconds[:3] == pytest.approx([0, 0.1, 0.2])
    assert ratio - seconds[-3:] == pytest.approx([0.2, 0.1, 0.0])
    assert (np.diff(table[:, 0]) > 0).all()
    assert made.value.tolist() == curve.value.tolist()
    inner = slice(1, -1)
    before = table[inner, 3] / table[inner, 2]
    assert before == pytest.approx(table[inner, 5] / table[inner, 4])
    assert middle_stretched(curve.table, 3.0) is not None
    assert middle_stretched(curve.table, 3.0).tolist() == curve.table.tolist()


def test_joint_placement_keys_a_group_together():
    rng = np.random.default_rng(1)
    times = np.cumsum(rng.uniform(0.3, 0.6, 9))
    one, two = (Curve.through(times, rng.uniform(0, 1, 9), "flat") for _ in range(2))
    frames = np.arange(int(times[-1] * 30)) / 30
    take = Take(
        "t", frames, ("BrowA", "BrowB"), np.stack([c.evaluate(frames) for c in (one, two)], 1)
    )
    library = Library.of([Shot("s", {"a": one})])
    result = match(take, library, Rig.of(take), MatchSettings(placement="joint"))
    a, b = (result.channels[n].curve.time for n in ("BrowA", "BrowB"))
    assert len(a) == len(b)
    assert np.abs(a - b).max() <= 2 / 30 + 1e-9
    with pytest.raises(UsageError, match="uniform, middle"):
        MatchSettings(stretch="both")
