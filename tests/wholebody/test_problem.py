"""The quadratic that the search solves has the cost's own gradient."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from physretarget import kinematics
from physretarget.wholebody import WholeBodySettings
from physretarget.wholebody.problem import Price, evaluate, normal
from physretarget.wholebody.stage import whole_window


@pytest.mark.parametrize("most", [0.01, 1.0])
def test_gradient_is_that_of_the_cost(stalk, standing, most: float) -> None:
    """Every term at work: residual, limits, floor, budget, gaze, both ends of the clip."""
    rng = np.random.default_rng(0)
    qpos, time, active = standing(0.5)
    active[10:16] = False
    qpos[:, 7] = np.radians(80) - 0.05 * rng.random(len(qpos))
    window = whole_window(stalk, qpos, time, active, WholeBodySettings(most=most))
    price = Price(0.1, np.ones(len(qpos)))

    def smooth(size: float):
        return size * gaussian_filter1d(rng.normal(size=(len(qpos), 8)), 2, axis=0)

    at = kinematics.integrate(stalk.tree, qpos, smooth(0.05))
    state, step, eps = evaluate(window, at, price), smooth(1.0), 1e-7
    assert all(part > 0 for name, part in state.parts.items() if name != "budget" or most < 0.1)
    ahead, behind = (
        evaluate(window, kinematics.integrate(stalk.tree, at, sign * eps * step), price)
        for sign in (1, -1)
    )
    found = float(np.sum(normal(window, state, price, 0.1).gradient * step))
    assert found == pytest.approx((ahead.cost - behind.cost) / (2 * eps), rel=1e-4)
