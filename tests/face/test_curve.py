from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from physretarget.errors import InputError
from physretarget.face.bezier import solve_time
from physretarget.face.curve import Curve, Key

unit = st.floats(0, 1)
small = st.floats(-100, 100)


def brute(points, time):
    """The span's value at a time by bisection on the parameter, in plain Python."""
    (x0, y0), (x1, y1), (x2, y2), (x3, y3) = points
    low, high = 0.0, 1.0
    for _ in range(200):
        u = 0.5 * (low + high)
        v = 1 - u
        x = v**3 * x0 + 3 * v * v * u * x1 + 3 * v * u * u * x2 + u**3 * x3
        low, high = (u, high) if x < time else (low, u)
    v = 1 - u
    return v**3 * y0 + 3 * v * v * u * y1 + 3 * v * u * u * y2 + u**3 * y3


@given(unit, unit, unit)
def test_solve_time_inverts_the_bezier(x, x1, x2):
    u = float(solve_time(x, x1, x2))
    v = 1 - u
    assert 3 * v * v * u * x1 + 3 * v * u * u * x2 + u**3 == pytest.approx(x, abs=1e-9)


@given(unit, small, unit, small, small, small, st.floats(0.01, 0.99))
def test_evaluation_equals_bisection(x1, y1, x2, y2, v0, v1, x):
    curve = Curve((Key(1.0, v0, out_tangent=(3 * x1, y1)), Key(4.0, v1, (-3 * x2, y2))))
    got = float(curve.evaluate(1 + 3 * x))
    expected = brute(curve.controls[0], 1 + 3 * x)
    # Where the curve runs straight up its value is not a continuous function of time.
    near = [brute(curve.controls[0], 1 + 3 * x + e) for e in (-1e-7, 1e-7)]
    assert min(*near, expected) - 1e-6 <= got <= max(*near, expected) + 1e-6


def test_ease_known_value():
    # CSS "ease-in-out", cubic-bezier(.42, 0, .58, 1): a half at half time, by symmetry,
    # and 0.12916 at a quarter (any browser).
    curve = Curve((Key(0, 0, out_tangent=(0.42, 0)), Key(1, 1, (-0.42, 0))))
    assert curve.evaluate([0.5, 0.25]) == pytest.approx([0.5, 0.129162], abs=1e-5)


def test_constant_outside_and_single_key():
    curve = Curve((Key(0, 1), Key(1, 3)))
    assert curve.evaluate([-5, 9]).tolist() == [1, 3]
    assert Curve((Key(2, 7),)).evaluate([0, 2, 4]).tolist() == [7, 7, 7]


def test_stepped():
    keys = (Key(0, 1, out_type="stepped"), Key(1, 2, out_type="stepped_next"), Key(2, 5))
    assert Curve(keys).evaluate([0, 0.5, 0.999, 1, 1.001, 2]).tolist() == [1, 1, 1, 2, 5, 5]


def test_long_tangents_are_shortened():
    curve = Curve((Key(0, 0, out_tangent=(5, 10)), Key(1, 1, (-4, -4))))
    assert curve.controls[0].tolist() == [[0, 0], [1, 2], [0, 0], [1, 1]]
    assert np.isfinite(curve.evaluate(np.linspace(0, 1, 50))).all()


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ((), "at least one key"),
        ((Key(1, 0), Key(1, 2)), "the same time"),
        ((Key(1, 0), Key(0, 2)), "earlier time"),
        ((Key(0, float("nan")),), "not finite"),
        ((Key(0, 0, (0.1, 0)),), "backward"),
        ((Key(0, 0, in_type="wavy"),), "tangent type"),  # type: ignore[arg-type]
    ],
)
def test_bad_curves_say_why(keys, message):
    with pytest.raises(InputError, match=message):
        Curve(keys)


def test_auto_tangents_do_not_overshoot():
    rng = np.random.default_rng(1)
    time, value = np.cumsum(rng.uniform(0.05, 1, 30)), rng.normal(size=30)
    curve = Curve.through(time, value)
    dense = curve.sample(500)
    assert dense.max() <= value.max() + 1e-12
    assert dense.min() >= value.min() - 1e-12
    assert Curve.through([0, 1, 2], [0, 1, 0]).keys[1].out_tangent[1] == 0


def test_tangent_types():
    spline = Curve.through([0, 1, 3], [0, 3, 3], "spline").keys[1]
    assert spline.out_tangent == pytest.approx((2 / 3, 2 / 3))
    assert spline.in_tangent == pytest.approx((-1 / 3, -1 / 3))
    line = Curve.through([0, 1, 3], [0, 3, 3], "linear")
    assert line.evaluate(0.25) == pytest.approx(0.75)
    assert Curve.through([0, 1, 2], [0, 3, 4], "flat").keys[1].out_tangent == (1 / 3, 0)


@given(st.lists(st.floats(0.001, 3.999), max_size=8))
def test_added_keys_do_not_change_the_curve(times):
    keys = (Key(0, 0, out_tangent=(1, 5)), Key(2, 3, (-2, 4), (0.1, -3)), Key(4, 0, (-1.5, 0)))
    curve = Curve(keys)
    dense = np.linspace(0, 4, 333)
    assert curve.with_keys_at(times).evaluate(dense) == pytest.approx(
        curve.evaluate(dense), abs=1e-6
    )


def test_scaling_keeps_the_shape():
    curve = Curve.through([0, 1, 3], [0, 3, 1], "spline")
    t = np.linspace(0, 3, 40)
    scaled = curve.scaled(2.0, -0.5).shifted(1.0, 2.0)
    assert scaled.evaluate(1 + 2 * t) == pytest.approx(2 - 0.5 * curve.evaluate(t), abs=1e-12)
    with pytest.raises(InputError, match="cannot scale"):
        curve.scaled(0.0)
    assert Curve.from_table(curve.table, [("spline", "spline", False)] * 3) == curve
