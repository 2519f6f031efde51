"""Long takes are priced a stretch at a time: what comes out is what the whole at once gives."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np
import pytest

from physretarget.face import match as match_module
from physretarget.face.cover import CoverSettings, Job, cover, stretches
from physretarget.face.curve import Curve, Key
from physretarget.face.library import Library
from physretarget.face.match import MatchSettings, match
from physretarget.face.noise import smoothed
from physretarget.face.rig import Rig
from physretarget.face.screen import ScreenSettings
from physretarget.face.shot import Shot, Take
from physretarget.face.templates import make_bank
from physretarget.options.facial import METHODS

FPS = 10.0
LIBRARY = Library.of(
    [
        Shot(
            "nods",
            {
                "a": Curve.through(np.arange(9) * 0.7, [0, 1, 0.2, 0.9, 0.9, 0, 0.5, 0.1, 1]),
                "b": Curve.through(np.arange(6) * 0.3, [0, 1, 0, 0.4, 0.1, 0.8], "flat"),
            },
        )
    ]
)
BANK = make_bank(LIBRARY, lambda name: True)


def job(frames, channels=2):
    rng = np.random.default_rng(frames)
    time = np.arange(frames) / FPS
    rows = []
    for _ in range(channels):
        keys = np.cumsum(rng.uniform(0.3, 1.2, int(time[-1]) * 2 + 4)) - 1.0
        clean = Curve.through(keys, rng.uniform(0, 1, len(keys)), "flat").evaluate(time)
        rows.append(clean + rng.normal(0, 0.01, frames))
    values = np.stack(rows)
    values[0, frames // 3 : frames // 2] = values[0, frames // 3]  # a long rest
    barred = np.zeros(values.shape, dtype=bool)
    barred[1, frames // 2] = True
    return Job(values, smoothed(values, FPS), np.ones_like(values), barred)


def chosen(of, method, most):
    settings = CoverSettings(fidelity=0.02, longest=2.0, held=most)
    return cover(of, FPS, BANK, method, settings, ScreenSettings())


@pytest.mark.parametrize("method", METHODS)
def test_stretches_give_the_placement_of_the_whole(method):
    take = job(900)
    whole, parts = chosen(take, method, 10**9), chosen(take, method, 1)
    assert parts.chains == whole.chains
    np.testing.assert_allclose(parts.confidence, whole.confidence, atol=5e-3)
    assert max(p.first for p in parts.chains[1] if p.first <= 450) == 450  # the barred frame


@pytest.mark.parametrize("frames", [2, 79, 80, 81, 200, 1001])
def test_stretches_cover_every_frame_once(frames):
    found = stretches(frames, 80, 20)
    assert [s.first for s in found] == [0, *(s.last for s in found[:-1])]
    assert found[-1].last == frames
    assert len(found) == 1 or max(s.high - s.low for s in found) <= 80
    for one, other in pairwise(found):
        assert one.low + one.shared.start == other.low  # taken up where it was left
        assert one.low + one.shared.stop == other.first
        assert other.first - other.low >= min(20, other.first)


def take_of(frames):
    return Take("t", np.arange(frames) / FPS, ("BrowA", "BrowB"), job(frames).values.T.copy())


def test_joins_locked_keys_and_ranges_across_stretches(monkeypatch):
    take, rig = take_of(1000), Rig.of(take_of(10))
    lock = {"BrowA": [Key(50.0, 0.5, (-0.1, 0.0), (0.1, 0.0))]}
    settings = MatchSettings(fidelity=0.02)
    whole = match(take, LIBRARY, rig, settings, span=(10.0, 90.0), locked=lock)
    monkeypatch.setattr(match_module, "CoverSettings", partial(CoverSettings, held=1))
    parts = match(take, LIBRARY, rig, settings, span=(10.0, 90.0), locked=lock)
    for name, channel in parts.channels.items():
        other = whole.channels[name]
        assert channel.curve == other.curve
        assert (channel.curve.start, channel.curve.end) == (10.0, 90.0)
        for one, two in zip(channel.pieces, other.pieces, strict=True):
            assert one.confidence == pytest.approx(two.confidence, abs=5e-3)
            assert replace(one, confidence=0.0) == replace(two, confidence=0.0)
    assert lock["BrowA"][0] in parts.channels["BrowA"].curve.keys


def peak(frames, most):
    of = job(frames)
    tracemalloc.start()
    chosen(of, "distance", most)
    most_held = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return most_held


def test_memory_of_prices_does_not_grow_with_the_take():
    spans, channels = 15, 2
    most = channels * spans * 400
    short, long = peak(400, most), peak(4000, most)
    tables = 8 * channels * spans * 3600  # what the prices of the further frames would take
    assert long - short < 0.7 * tables
    assert peak(4000, 10**9) - short > tables
