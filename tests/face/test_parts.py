"""Rig files, placement, reducers and measures."""

from __future__ import annotations

import numpy as np
import pytest

from physretarget.errors import InputError, UsageError
from physretarget.face.curve import Curve
from physretarget.face.measure import extrema, extremum_timing, key_f1, style
from physretarget.face.reduce import decimate, reduce_curve, schneider
from physretarget.face.rig import Rig, guess_group
from physretarget.face.shot import Take
from physretarget.face.spans import lengths

RIG = """
name = "girl"
[groups.brows]
library = ["*brow*"]
[channels.brow_up]
group = "brows"
range = [0.0, 2.0]
from = { BrowInnerUp = 1.0, BrowOuterUpLeft = 0.5 }
offset = 0.25
[channels.JawOpen]
"""


def rig_of(tmp_path, text):
    (tmp_path / "rig.toml").write_text(text)
    return Rig.load(tmp_path / "rig.toml")


def test_rig_combines_and_clips(tmp_path):
    rig = rig_of(tmp_path, RIG)
    values = np.array([[1.0, 0.5, 0.1], [1.8, 1.0, 0.2]])
    take = Take("t", np.array([0, 0.1]), ("BrowInnerUp", "BrowOuterUpLeft", "JawOpen"), values)
    driven = rig.drive(take)
    assert driven.channel("brow_up").tolist() == [1.5, 2.0]
    assert driven.channel("JawOpen").tolist() == [0.1, 0.2]
    assert [c.name for c in rig.matched()] == ["brow_up"]
    assert rig.borrows("brows", "Left EyeBROWs.rotation")
    assert not rig.borrows("brows", "mouth.scale.x")
    assert rig.borrows("lids", "anything")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[channels.a]\nrnage = [0, 1]", "no setting 'rnage'; there are group, range"),
        ("[chanels.a]", "no setting 'chanels'"),
        ("[channels.a]\nrange = [1, 0]", "must rise"),
        ("[channels.a]\nrange = [0, nan]", "finite"),
        ("[channels.a]\ngroup = 'ears'", "one of brows"),
        ("[channels.a]\nfrom = { b = 'x' }", "must be a number"),
        ("name = 'x'", "no \\[channels.NAME\\]"),
        ("[channels", "broken TOML"),
    ],
)
def test_bad_rigs_say_why(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        rig_of(tmp_path, text)


def test_groups_of_arkit_names():
    names = [
        "BrowDownLeft",
        "EyeBlinkRight",
        "EyeLookUpLeft",
        "HeadYaw",
        "MouthPucker",
        "LeftEyeYaw",
        "NoseSneerLeft",
        "TongueOut",
    ]
    assert [guess_group(n) for n in names] == [
        "brows",
        "lids",
        "gaze",
        "head",
        "lips",
        "gaze",
        "other",
        "lips",
    ]


def test_lengths_reach_the_whole_take():
    assert lengths(2, 30, 4).tolist() == [1]
    assert lengths(61, 30, 4)[-1] == 60
    assert lengths(5000, 60, 4)[-1] == 240
    assert (np.diff(lengths(5000, 60, 4)) > 0).all()
    assert np.diff(lengths(5000, 30, 10))[:58].tolist() == [1] * 58


@pytest.mark.parametrize("reducer", [decimate, schneider])
def test_reducers_keep_to_the_error_and_to_the_count(reducer):
    rng = np.random.default_rng(0)
    t = np.arange(200) / 30
    values = np.sin(3 * t) + 0.3 * np.sin(11 * t) + rng.normal(0, 0.005, 200)
    curve = reducer(values, 30, error=0.05)
    assert np.abs(curve.evaluate(t) - values).max() < 0.0501
    assert len(curve.keys) < 60
    assert len(reducer(values, 30, keys=17).keys) == 17
    assert reducer(np.full(50, 2.0), 30, error=0.01).evaluate(0.5) == pytest.approx(2.0)
    assert len(reducer(np.array([1.0]), 30, keys=3).keys) == 1


def test_a_single_cubic_needs_two_keys():
    u = np.linspace(0, 1, 90)
    assert len(decimate(u**3 - u, 30, error=1e-3).keys) == 2
    with pytest.raises(InputError, match="frame 1"):
        reduce_curve(np.array([0, np.nan]), 30)
    with pytest.raises(InputError, match="no samples"):
        reduce_curve(np.array([]), 30)


@pytest.mark.parametrize("error", [-0.1, float("nan"), float("inf")])
def test_an_error_that_is_none_is_told(error):
    with pytest.raises(UsageError, match="zero or above"):
        reduce_curve(np.arange(5.0), 30, error=error)
    with pytest.raises(UsageError, match="two at least"):
        reduce_curve(np.arange(5.0), 30, keys=0)


def test_f1():
    assert key_f1(np.array([0, 10, 20.0]), np.array([1, 9, 30.0]), 1)[0] == pytest.approx(2 / 3)
    assert key_f1(np.array([5.0, 5.5]), np.array([5.0]), 1) == pytest.approx((2 / 3, 0.5, 1.0))
    assert key_f1(np.array([]), np.array([1.0]), 1) == (0, 0, 0)


def test_extrema_and_their_timing():
    t = np.arange(100)
    wave = np.sin(2 * np.pi * t / 40)
    assert extrema(wave, 0.2).tolist() == [10, 30, 50, 70, 90]
    assert extremum_timing(np.roll(wave, 2), wave, 0.2) == pytest.approx(2, abs=0.5)
    assert extrema(np.zeros(10), 0.1).tolist() == []


def test_style_of_eased_curves():
    found = style([Curve.through([0, 1, 3], [0, 1, 0], "flat")])
    assert found.spacing.tolist() == [1, 2]
    assert found.handles == pytest.approx(np.full(4, 1 / 3))
    assert found.flat_share == 1
    assert found.hold_share == 0
