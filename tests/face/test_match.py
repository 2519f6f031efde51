from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from physretarget.errors import InputError, UsageError
from physretarget.face.curve import Curve, Key
from physretarget.face.library import Library
from physretarget.face.match import MatchSettings, match
from physretarget.face.measure import key_f1, pseudo_capture
from physretarget.face.rig import Rig, RigChannel
from physretarget.face.shot import Shot, Take
from physretarget.options.facial import METHODS


def eased(times, values):
    keys = []
    for k, (t, v) in enumerate(zip(times, values, strict=True)):
        into = (t - times[k - 1]) / 3 if k else 0.0
        out = (times[k + 1] - t) / 3 if k < len(times) - 1 else 0.0
        keys.append(Key(t, v, (-into, 0.0), (out, 0.0)))
    return Curve(tuple(keys))


SHOT = Shot("nod", {"head": eased([0, 0.3, 0.7, 1.2, 1.5, 2.2], [0, 1, 0.2, 0.9, 0.4, 0])})
LIBRARY = Library.of([SHOT])
UNSEEN = eased([0, 0.4, 0.8, 1.3, 2.0, 2.4], [0.1, 0.8, 0.3, 0.9, 0.0, 0.5])


def take_of(*columns, fps=30.0, names=None):
    values = np.stack(columns, axis=1)
    names = names or tuple(f"BrowC{i}" for i in range(values.shape[1]))
    return Take("take", np.arange(len(values)) / fps, names, values)


def unseen(seed=0, fps=30.0, noise=0.01):
    return pseudo_capture(UNSEEN, fps, np.random.default_rng(seed), noise=noise, jitter=0.3)[1]


@pytest.mark.parametrize("placement", ["optimal", "greedy"])
@pytest.mark.parametrize("method", METHODS)
def test_every_matcher_finds_an_unseen_curve(method, placement):
    take = take_of(unseen())
    settings = MatchSettings(method=method, placement=placement)
    result = match(take, LIBRARY, Rig.of(take), settings)
    curve = result.channels["BrowC0"].curve
    clean = UNSEEN.evaluate(take.time)
    assert np.sqrt(np.mean((curve.evaluate(take.time) - clean) ** 2)) < 0.02
    if placement == "optimal":
        assert key_f1(curve.time * 30, UNSEEN.time * 30, 1.0)[0] > 0.8
    for left, right in pairwise(result.channels["BrowC0"].pieces):
        assert left.end == pytest.approx(right.start)


def slope_jumps(curve, unit, fps):
    return [
        abs(k.out_tangent[1] / k.out_tangent[0] - k.in_tangent[1] / k.in_tangent[0]) / fps / unit
        for k in curve.keys[1:-1]
        if not k.broken
    ]


def test_joins_are_c1_and_inside_the_range():
    rng = np.random.default_rng(4)
    rough = np.clip(np.cumsum(rng.normal(0, 0.15, 150)), 0, 1)
    take = take_of(rough, unseen()[:1].repeat(150))
    rig = Rig("r", (RigChannel("a", "brows", 0.0, 1.0, {"BrowC0": 1.0}),))
    result = match(take, LIBRARY, rig, MatchSettings(fidelity=0.05))
    curve = result.channels["a"].curve
    assert len(curve.keys) > 6
    assert max(slope_jumps(curve, 1.0, 30)) < 1e-6
    dense = curve.sample(600)
    assert dense.min() >= 0.0
    assert dense.max() <= 1.0
    for k in curve.keys[1:-1]:  # the same by finite differences, as a player sees it
        step = 1e-6
        left = (curve.evaluate(k.time) - curve.evaluate(k.time - step)) / step
        right = (curve.evaluate(k.time + step) - curve.evaluate(k.time)) / step
        assert abs(left - right) / 30 < 2e-3


def test_sources_are_named():
    take = take_of(unseen())
    channel = match(take, LIBRARY, Rig.of(take)).channels["BrowC0"]
    assert len(channel.piece_of) == len(channel.curve.keys)
    for piece in channel.pieces:
        assert (piece.shot, piece.channel) == ("nod", "head")
        assert 0 <= piece.source_start < piece.source_end <= 2.2
        assert piece.stretch > 0
        assert 0 <= piece.margin <= 1
    assert channel.error < 0.03


def test_sliders_do_what_they_say():
    take = take_of(np.clip(unseen() + 0.1 * np.sin(np.arange(73)), 0, 2))
    rig = Rig.of(take)

    def keys(**kw):
        return match(take, LIBRARY, rig, MatchSettings(**kw)).keys

    assert keys(key_cost=2) > keys(key_cost=50)
    assert keys(fidelity=0.01) > keys(fidelity=0.1)


def test_locked_keys_stay():
    take = take_of(unseen())
    lock = Key(1.0, 0.77, (-0.1, 0.05), (0.2, -0.3), broken=True)
    result = match(take, LIBRARY, Rig.of(take), locked={"BrowC0": [lock]})
    assert lock in result.channels["BrowC0"].curve.keys
    assert float(result.channels["BrowC0"].curve.evaluate(1.0)) == pytest.approx(0.77)
    with pytest.raises(InputError, match="matched are BrowC0"):
        match(take, LIBRARY, Rig.of(take), locked={"Brow": [lock]})
    with pytest.raises(InputError, match="outside the take"):
        match(take, LIBRARY, Rig.of(take), locked={"BrowC0": [replace(lock, time=9.0)]})


def test_sub_range():
    take = take_of(unseen())
    result = match(take, LIBRARY, Rig.of(take), span=(0.5, 1.5))
    curve = result.channels["BrowC0"].curve
    assert curve.start == pytest.approx(0.5)
    assert curve.end == pytest.approx(1.5)
    with pytest.raises(InputError, match="fewer than two"):
        match(take, LIBRARY, Rig.of(take), span=(50, 60))


@pytest.mark.parametrize("placement", ["optimal", "greedy"])
@pytest.mark.parametrize("frames", [2, 3, 4, 7])
def test_takes_shorter_than_any_segment(frames, placement):
    take = take_of(unseen()[:frames])
    result = match(take, LIBRARY, Rig.of(take), MatchSettings(placement=placement))
    curve = result.channels["BrowC0"].curve
    assert curve.start == 0
    assert curve.end == pytest.approx((frames - 1) / 30)


@pytest.mark.parametrize("method", METHODS)
def test_constant_channels_become_two_keys(method):
    take = take_of(np.full(60, 0.3), np.zeros(60))
    result = match(take, LIBRARY, Rig.of(take), MatchSettings(method=method))
    for name, level in (("BrowC0", 0.3), ("BrowC1", 0.0)):
        curve = result.channels[name].curve
        assert len(curve.keys) == 2
        assert curve.sample(60) == pytest.approx(np.full(59 * 2 + 1, level), abs=1e-9)


def test_same_input_same_output():
    take = take_of(unseen(), unseen(3))
    one, two = (match(take, LIBRARY, Rig.of(take)) for _ in range(2))
    assert one.shot().curves == two.shot().curves


def test_channels_do_not_disturb_each_other():
    take = take_of(unseen(), unseen(3))
    both = match(take, LIBRARY, Rig.of(take)).shot().curves
    alone = take_of(unseen(3), names=("BrowC1",))
    assert match(alone, LIBRARY, Rig.of(alone)).shot().curves["BrowC1"] == both["BrowC1"]


def test_bad_input_is_said():
    with pytest.raises(InputError, match="not finite"):
        take_of(np.array([0.0, np.nan, 1.0]))
    with pytest.raises(InputError, match="two frames"):
        take_of(np.array([0.0]))
    with pytest.raises(UsageError, match="distance, sax, hmm"):
        MatchSettings(method="dtw")  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="above 0"):
        MatchSettings(fidelity=0.0)
    take = take_of(unseen())
    with pytest.raises(InputError, match="no segment"):
        match(take, Library(()), Rig.of(take))
    rig = Rig("r", (RigChannel("a", "brows", 0.0, 1.0, {"Missing": 1.0}),))
    with pytest.raises(InputError, match=r"Missing.*BrowC0"):
        match(take, LIBRARY, rig)


def test_lips_are_left_to_the_capture():
    take = take_of(unseen(), unseen(2), names=("BrowInnerUp", "MouthSmileLeft"))
    assert set(match(take, LIBRARY, Rig.of(take)).channels) == {"BrowInnerUp"}
    lips = match(take, LIBRARY, Rig.of(take), MatchSettings(lips=True))
    assert set(lips.channels) == {"BrowInnerUp", "MouthSmileLeft"}


def test_empty_rig_gives_nothing():
    take = take_of(unseen(), names=("MouthLeft",))
    result = match(take, LIBRARY, Rig.of(take))
    assert result.channels == {}
    assert result.keys == 0
    assert "lips are left to the capture" in result.notes[-1]


@pytest.mark.data
def test_real_take_with_a_real_library(data):
    from physretarget.face.formats import read_take

    paths = sorted((data / "keys" / "noto").glob("*.json"))[:12]
    library = Library.build(paths)
    take = read_take(data / "face" / "neurosync_slate167.csv", fps=30).between(0, 4)
    rig = Rig.of(take)
    result = match(take, library, rig)
    assert result.reduction >= 0.85
    for channel in rig.matched():
        got = result.channels[channel.name]
        assert max(slope_jumps(got.curve, channel.range, 30), default=0.0) < 1e-6
        dense = got.curve.sample(240)
        assert dense.min() >= channel.lower
        assert dense.max() <= channel.upper
        assert got.error < 0.1


def test_greedy_pieces_do_not_overlap():
    rng = np.random.default_rng(3)
    rough = np.cumsum(rng.normal(0, 0.1, (200, 6)), axis=0)
    take = take_of(*rough.T)
    result = match(take, LIBRARY, Rig.of(take), MatchSettings(placement="greedy", fidelity=0.08))
    for channel in result.channels.values():
        assert channel.pieces[0].start == 0
        assert channel.pieces[-1].end == pytest.approx(take.time[-1])
        for left, right in pairwise(channel.pieces):
            assert left.end == pytest.approx(right.start)
        assert min(p.end - p.start for p in channel.pieces) >= 1.5 / take.fps
