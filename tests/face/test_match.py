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


PAPER = [MatchSettings(preset="ruhland2017", method=m) for m in METHODS]
WAYS = [MatchSettings(), *PAPER]


@pytest.mark.parametrize("settings", WAYS)
def test_every_way_follows_an_unseen_curve(settings):
    take = take_of(unseen())
    result = match(take, LIBRARY, Rig.of(take), settings)
    curve = result.channels["BrowC0"].curve
    clean = UNSEEN.evaluate(take.time)
    if settings.preset is None:
        assert np.sqrt(np.mean((curve.evaluate(take.time) - clean) ** 2)) < 0.02
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
    assert len(curve.keys) >= 5
    assert max(slope_jumps(curve, 1.0, 30)) < 1e-6
    dense = curve.sample(600)
    assert dense.min() >= 0.0
    assert dense.max() <= 1.0
    for k in [
        k for k in curve.keys[1:-1] if not k.broken
    ]:  # the same by finite differences, as a player sees it
        step = 1e-6
        left = (curve.evaluate(k.time) - curve.evaluate(k.time - step)) / step
        right = (curve.evaluate(k.time + step) - curve.evaluate(k.time)) / step
        assert abs(left - right) / 30 < 2e-3


@pytest.mark.parametrize("settings", WAYS)
def test_a_curve_of_the_library_comes_back_as_itself(settings):
    """Noise-free: every key with its tangents, from its own shot, and nothing else."""
    rng = np.random.default_rng(8)
    curves = {}
    for k in range(6):
        times = np.cumsum(rng.integers(6, 30, 9)) / 60.0
        curves[f"c{k}"] = Curve.through(times, rng.uniform(0, 1, 9))
    library = Library.of([SHOT, Shot("past", curves)])
    for name, curve in curves.items():
        values = curve.sample(30.0)
        take = take_of(values, names=(name,))
        found = match(take, library, Rig.of(take), settings).channels[name]
        assert found.curve.table[:, 2:] == pytest.approx(curve.table[:, 2:], abs=1e-9)
        assert found.curve.time == pytest.approx(curve.time - curve.start)
        assert found.curve.value == pytest.approx(curve.value)
        assert [(p.shot, p.channel) for p in found.pieces] == [("past", name)]


def test_a_curve_of_the_library_is_found_inside_a_longer_take():
    values = np.concatenate([np.zeros(40), SHOT.curves["head"].sample(30.0), np.zeros(25)])
    take = take_of(values)
    channel = match(take, LIBRARY, Rig.of(take)).channels["BrowC0"]
    assert channel.curve.time[1:-1] == pytest.approx(SHOT.curves["head"].time + 40 / 30)
    assert [p.kind for p in channel.pieces] == ["hold", "segment", "hold"]


def test_sources_are_named_only_where_they_explain_more_than_an_ease():
    """A bounce that no ease describes names its source; smooth eases of the same take do not."""

    def bouncing(times, values):
        keys = []
        for k, (t, v) in enumerate(zip(times, values, strict=True)):
            into = (t - times[k - 1]) if k else 0.0
            out = (times[k + 1] - t) if k < len(times) - 1 else 0.0
            keys.append(Key(t, v, (-0.9 * into, 0.0), (0.05 * out, 0.0), broken=True))
        return Curve(tuple(keys))

    library = Library.of([SHOT, Shot("bounce", {"head": bouncing([0, 1, 2], [0, 1, 0])})])
    played = bouncing([0, 1.2, 2.2, 3.4], [0.2, 0.9, 0.1, 0.7]).sample(30.0)
    eased_ = eased([0, 1.2, 2.2, 3.4], [0.2, 0.9, 0.1, 0.7]).sample(30.0)
    rng = np.random.default_rng(0)
    noise = rng.normal(0, 0.004, (2, len(played)))
    take = take_of(played + noise[0], eased_ + noise[1])
    found = match(take, library, Rig.of(take)).channels
    named = [p for p in found["BrowC0"].pieces if p.shot]
    assert named
    assert {p.shot for p in named} == {"bounce"}
    assert all(p.margin > 3.0 for p in named)
    assert not any(p.shot for p in found["BrowC1"].pieces)


def test_rest_is_rest():
    """A still eye over a minute: one hold, two keys, no source and no doubt, noise or not."""
    rng = np.random.default_rng(0)
    noisy = 0.4 + rng.normal(0, 0.002, 1800)
    take = take_of(noisy, np.full(1800, 0.4))
    for name in ("BrowC0", "BrowC1"):
        channel = match(take, LIBRARY, Rig.of(take)).channels[name]
        assert len(channel.curve.keys) == 2
        assert [(p.kind, p.shot, p.doubtful) for p in channel.pieces] == [("hold", "", False)]


@pytest.mark.parametrize("settings", WAYS)
@pytest.mark.parametrize("most", [0.05, 0.005])
def test_the_largest_error_is_kept(settings, most):
    rng = np.random.default_rng(4)
    rough = np.clip(np.cumsum(rng.normal(0, 0.05, 150)) + 0.5, 0, 1)
    take = take_of(rough, unseen()[:1].repeat(150))
    bound = replace(settings, max_error=most)
    channel = match(take, LIBRARY, Rig.of(take), bound).channels["BrowC0"]
    off = np.abs(channel.curve.evaluate(take.time) - rough).max()
    assert off <= most * channel.unit * (1 + 1e-6)
    free = match(take, LIBRARY, Rig.of(take), settings).channels["BrowC0"]
    assert len(channel.curve.keys) > len(free.curve.keys)


def test_lips_are_dense_in_the_shot():
    take = take_of(unseen(), unseen(2), names=("BrowInnerUp", "JawOpen"))
    shot = match(take, LIBRARY, Rig.of(take)).shot()
    assert shot.curves["JawOpen"].evaluate(take.time) == pytest.approx(take.channel("JawOpen"))
    assert len(shot.curves["JawOpen"].keys) == len(take.time)


def test_sliders_do_what_they_say():
    take = take_of(np.clip(unseen() + 0.1 * np.sin(np.arange(73)), 0, 2))
    rig = Rig.of(take)

    def keys(**kw):
        return match(take, LIBRARY, rig, MatchSettings(**kw)).keys

    assert keys(key_cost=2) > keys(key_cost=50)
    assert keys(fidelity=0.01) > keys(fidelity=0.3)


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


@pytest.mark.parametrize("settings", WAYS)
@pytest.mark.parametrize("frames", [2, 3, 4, 7])
def test_takes_shorter_than_any_segment(frames, settings):
    take = take_of(unseen()[:frames])
    result = match(take, LIBRARY, Rig.of(take), settings)
    curve = result.channels["BrowC0"].curve
    assert curve.start == 0
    assert curve.end == pytest.approx((frames - 1) / 30)


@pytest.mark.parametrize("settings", WAYS)
def test_constant_channels_become_two_keys(settings):
    take = take_of(np.full(60, 0.3), np.zeros(60))
    result = match(take, LIBRARY, Rig.of(take), settings)
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


@pytest.mark.parametrize("settings", PAPER)
def test_segments_of_the_paper_do_not_overlap(settings):
    rng = np.random.default_rng(3)
    rough = np.cumsum(rng.normal(0, 0.1, (200, 3)), axis=0)
    take = take_of(*rough.T)
    result = match(take, LIBRARY, Rig.of(take), replace(settings, tau=0.08))
    for channel in result.channels.values():
        assert channel.pieces[0].start == 0
        assert channel.pieces[-1].end == pytest.approx(take.time[-1])
        for left, right in pairwise(channel.pieces):
            assert left.end == pytest.approx(right.start)


RIG_WITH_LIPS = """
[groups.brows]
library = ["brow*"]
[groups.lips]
keyed = true
library = ["mouth of another character"]
[groups.head]
keyed = false
[channels.BrowInnerUp]
[channels.JawOpen]
[channels.HeadYaw]
range = [-1.0, 1.0]
"""


@pytest.mark.parametrize("preset", [None, "ruhland2017"])
def test_the_rig_says_which_groups_are_keyed_and_none_needs_shots(tmp_path, preset):
    """Lips that the rig has keyed, but of which no shot exists, are keyed by the capture alone."""
    (tmp_path / "rig.toml").write_text(RIG_WITH_LIPS)
    take = take_of(unseen(), unseen(2), unseen(), names=("BrowInnerUp", "JawOpen", "HeadYaw"))
    rig = Rig.load(tmp_path / "rig.toml")
    result = match(take, LIBRARY, rig, MatchSettings(preset=preset))
    assert set(result.channels) == {"BrowInnerUp", "JawOpen"}
    assert set(result.dense) == {"HeadYaw"}
    assert any("Group lips: the library has no shot" in note for note in result.notes)
    jaw = result.channels["JawOpen"]
    assert jaw.error < 0.05
    assert not any(piece.shot for piece in jaw.pieces)
    everything = match(take, LIBRARY, rig, MatchSettings(preset=preset, lips=True))
    assert set(everything.channels) == {"BrowInnerUp", "JawOpen", "HeadYaw"}


def test_doubt_is_a_key_less_likely_than_two_in_five():
    """Bends so weak that it is hard to say where they begin, in noise."""
    time = np.arange(180) / 30.0
    rows = [
        np.clip(0.5 + 0.3 * np.sin(time * (1 + k / 9)) + 0.02 * np.sin(5 * time + k), 0, 1)
        + np.random.default_rng(k).normal(0.0, 0.01, len(time))
        for k in range(9)
    ]
    take = take_of(*rows)
    pieces = [p for c in match(take, LIBRARY, Rig.of(take)).channels.values() for p in c.pieces]
    sure = [(p.confidence, p.doubtful) for p in pieces if p.kind != "hold"]
    assert {doubtful for _, doubtful in sure} == {True, False}
    assert all(doubtful == (confidence < 0.4) for confidence, doubtful in sure)
    between = [confidence for confidence, _ in sure if 0.3 < confidence < 0.5]
    assert between  # another threshold would be noticed
