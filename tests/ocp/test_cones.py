"""The convex solver: a case in closed form, none to solve, and one that fails at first."""

from __future__ import annotations

from typing import Any

import clarabel
import numpy as np
import pytest
from scipy import sparse

from physretarget.errors import SolverError
from physretarget.ocp import cones as module
from physretarget.ocp.cones import solve


def nearest_in_cone(point: np.ndarray) -> np.ndarray:
    """The nearest point of the second-order cone to ``point`` (3,), by the solver."""
    eye = sparse.eye_array(3, format="csc")
    return solve(
        "projection", eye, -point, -eye, np.zeros(3), [clarabel.SecondOrderConeT(3)], tolerance=1e-9
    ).x


def test_projection_onto_a_cone_in_closed_form() -> None:
    for point in np.random.default_rng(0).normal(size=(20, 3)):
        t, length = point[0], float(np.linalg.norm(point[1:]))
        if length <= t:
            closed = point
        elif length <= -t:
            closed = np.zeros(3)
        else:
            closed = 0.5 * (t + length) * np.array([1.0, *(point[1:] / length)])
        assert nearest_in_cone(point) == pytest.approx(closed, abs=1e-6)


def test_what_has_no_solution_is_named() -> None:
    both = sparse.csc_array(np.array([[1.0], [-1.0]]))  # x <= -1 and x >= 1
    with pytest.raises(SolverError, match="programme of the wobble ended as PrimalInfeasible"):
        solve(
            "wobble",
            sparse.eye_array(1, format="csc"),
            np.zeros(1),
            both,
            np.array([-1.0, -1.0]),
            [clarabel.NonnegativeConeT(2)],
        )


def test_a_solver_that_stops_short_gets_a_firmer_system(monkeypatch: Any) -> None:
    tried: list[float] = []

    class Fickle:
        def __init__(self, *problem: Any) -> None:
            tried.append(problem[-1].static_regularization_constant)
            if len(tried) == 1:
                problem[-1].max_iter = 1
            self.solver = clarabel.DefaultSolver(*problem)

        def solve(self) -> Any:
            return self.solver.solve()

    monkeypatch.setattr(
        module,
        "clarabel",
        type("C", (), {"DefaultSolver": Fickle, "DefaultSettings": clarabel.DefaultSettings}),
    )
    point = np.array([0.5, 2.0, -1.0])
    length = float(np.hypot(2.0, 1.0))
    closed = 0.5 * (0.5 + length) * np.array([1.0, 2.0 / length, -1.0 / length])
    assert nearest_in_cone(point) == pytest.approx(closed, abs=1e-6)
    assert len(tried) == 2
    assert tried[1] > tried[0]
