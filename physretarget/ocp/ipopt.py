"""The root-height problem as one CasADi NLP over the weights, for ``casadi.nlpsol`` (IPOPT).

The same residuals over the same basis as ``gauss_newton``, with the exact Hessian in place of
JᵀJ: slower, and an independent judge of the optimum.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from physretarget.ocp.basis import Basis, sparse_of
from physretarget.ocp.gauss_newton import Outcome
from physretarget.ocp.problem import Problem

Array = NDArray[np.float64]

ITERATIONS, TOLERANCE = 500, 1e-8
"""IPOPT's limits, the second on the scaled gradient and its default."""
SOLVED = ("Solve_Succeeded", "Solved_To_Acceptable_Level")


def solve(
    problem: Problem,
    basis: Basis,
    start: Array,
    *,
    f0: float,
    ridge: float,
) -> Outcome:
    """Minimise ``½|r|² + ½ ridge |w|²`` over the weights w (n,) from ``start``."""
    solver = _solver(problem, basis, f0, ridge)
    found = solver(x0=start)
    told = solver.stats()
    return Outcome(
        np.asarray(found["x"]).ravel(),
        float(found["f"]),
        int(told["iter_count"]),
        told["return_status"] in SOLVED,
    )


def _solver(problem: Problem, basis: Basis, f0: float, ridge: float) -> Any:
    weights = ca.MX.sym("w", basis.count)
    motion = ca.horzcat(
        *(_matrix(basis, part) @ weights for part in (basis.value, basis.rate, basis.curvature))
    ).T
    frames = problem.parameters.shape[1]
    residual = problem.values.function.map("residuals", "serial", frames, [2], [])
    r = residual(motion, problem.parameters, f0)
    cost = 0.5 * ca.sumsqr(r) + 0.5 * ridge * ca.sumsqr(weights)
    return ca.nlpsol(
        "root_height",
        "ipopt",
        {"x": weights, "f": cost},
        {
            "print_time": False,
            "ipopt": {
                "print_level": 0,
                "sb": "yes",
                "max_iter": ITERATIONS,
                "tol": TOLERANCE,
            },
        },
    )


def _matrix(basis: Basis, window: Array) -> Any:
    """One of the basis's windows (T, width) as a sparse CasADi matrix (T, n)."""
    return ca.DM(sparse_of(basis, window).tocsc())
