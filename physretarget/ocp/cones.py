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
    options = clarabel.DefaultSettings()
    options.verbose = False
    options.max_threads = 1
    if tolerance is not None:
        options.tol_gap_abs = options.tol_gap_rel = options.tol_feas = tolerance
    found = clarabel.DefaultSolver(
        sparse.csc_matrix(quadratic), linear, sparse.csc_matrix(matrix), bound, cones, options
    ).solve()
    status = str(found.status)
    if status not in ("Solved", "AlmostSolved"):
        raise SolverError(f"the convex programme of the {what} ended as {status}")
    return Solved(np.asarray(found.x, dtype=np.float64), status, int(found.iterations))
