from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from physretarget.ocp.contact_model import friction_force, normal_force
from physretarget.ocp.settings import PAPER_MODEL


def _normal(height: float, speed: float = 0.0, residual: float = 1.0) -> float:
    return float(normal_force(ca.DM(height), ca.DM(speed), PAPER_MODEL, residual))


def _friction(slip: list[float], normal: float = 10.0) -> np.ndarray:
    return np.asarray(friction_force(ca.DM(slip), ca.DM(normal), PAPER_MODEL).full()).ravel()


@pytest.mark.parametrize("height", [-0.02, -1e-4, 0.0, 1e-5, 0.003, 0.1])
@pytest.mark.parametrize("speed", [-0.7, 0.0, 0.4])
def test_normal_force_is_equation_13(height: float, speed: float) -> None:
    stiff, damp, k, f0 = 1e4, 1.0, 20.0, 1.0
    g = 1 - 0.5 * np.exp(k * height) if height < 0 else 0.5 * np.exp(-k * height)
    expected = stiff / 2 * (np.sqrt(height**2 + 4 * f0**2 / stiff**2) - height) - damp * g * speed
    assert _normal(height, speed) == pytest.approx(expected, rel=1e-12)


def test_asymptotes_of_the_normal_force() -> None:
    assert _normal(-1.0) == pytest.approx(1e4, rel=1e-6)  # a linear spring deep inside
    assert _normal(1.0) == pytest.approx(0.0, abs=1e-3)  # nothing far above
    assert _normal(0.0) == pytest.approx(1.0)  # f0 on the floor
    assert _normal(0.0, residual=30.0) == pytest.approx(30.0)
    assert np.isfinite(_normal(-1e3, 5.0))
    assert np.isfinite(_normal(1e3, 5.0))


def test_friction_opposes_slip_and_saturates_at_the_cone() -> None:
    np.testing.assert_allclose(_friction([1.0, 0.0]), [-10.0, 0.0], atol=1e-9)
    slow = _friction([1e-5, -2e-5])
    np.testing.assert_allclose(slow, 10.0 * 20.0 * -100.0 * np.array([1e-5, -2e-5]), rtol=0.03)
    for speed in np.logspace(-8, 1, 30):
        assert np.linalg.norm(_friction([speed, speed])) <= 10.0 + 1e-9
    np.testing.assert_array_equal(_friction([0.0, 0.0]), 0.0)


def test_friction_is_continuous_where_the_paper_switches() -> None:
    edge = 1e-6 / 100.0
    below, above = _friction([edge * 0.999, 0.0]), _friction([edge * 1.001, 0.0])
    np.testing.assert_allclose(below, above, rtol=0.01)
