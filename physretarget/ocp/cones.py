"""Convex programmes over cones, solved by Clarabel."""

from __future__ import annotations

from typing import NamedTuple

import clarabel
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from physretarget.errors import SolverError

__all__ = ["Solved", "solve"]

Array = NDArray[np.float64]

_REGULARIZATION = (1e-8, 1e-7, 1e-6)
"""Of the solver's linear systems, tried in this order; the first is its own. Programmes with
entries from 1e-4 to 1e7 now and then stop it a digit before its tolerance; a firmer one gets past
that, and what it changes iterative refinement takes back."""


class Solved(NamedTuple):
    """The unknowns ``x`` (n,), how the solver ended and after how many iterations."""

    x: Array
    status: str
    iterations: int


def solve(
    what: str,
    quadratic: sparse.sparray,
    linear: Array,
    matrix: sparse.sparray,
    bound: Array,
    cones: list[object],
    *,
    tolerance: float | None = None,
) -> Solved:
    """Minimise ½ xᵀ P x + qᵀ x where b - A x lies in a product of cones, on one thread.

    ``what`` the programme is of, for the error; ``quadratic`` P (n, n) upper triangle, ``linear``
    q (n,), ``matrix`` A (m, n), ``bound`` b (m,); ``tolerance`` of gap and feasibility, the
    solver's own if None.

    Raises:
        SolverError: the solver gives up.
    """
    for regularization in _REGULARIZATION:
        options = clarabel.DefaultSettings()
        options.verbose = False
        options.max_threads = 1
        options.static_regularization_constant = regularization
        if tolerance is not None:
            options.tol_gap_abs = options.tol_gap_rel = options.tol_feas = tolerance
        found = clarabel.DefaultSolver(
            sparse.csc_matrix(quadratic), linear, sparse.csc_matrix(matrix), bound, cones, options
        ).solve()
        status = str(found.status)
        if status in ("Solved", "AlmostSolved"):
            return Solved(np.asarray(found.x, dtype=np.float64), status, int(found.iterations))
    raise SolverError(f"the convex programme of the {what} ended as {status}")
