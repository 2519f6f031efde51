from __future__ import annotations

import numpy as np
import pytest

from physretarget.errors import SolverError
from physretarget.wholebody.banded import BlockBand

FRAMES, SIZE = 7, 3


def _spd(rng, *shape):
    root = rng.normal(size=(*shape, SIZE, SIZE))
    return root @ root.swapaxes(-1, -2) + np.eye(SIZE)


def _problem():
    """A band with every kind of term, and the same as one dense matrix and gradient."""
    rng = np.random.default_rng(0)
    band = BlockBand(FRAMES, SIZE)
    dense, gradient = np.zeros((FRAMES * SIZE,) * 2), np.zeros(FRAMES * SIZE)
    band.blocks[0] += (own := _spd(rng, FRAMES))
    for t in range(FRAMES):
        some = slice(SIZE * t, SIZE * (t + 1))
        dense[some, some] += own[t]
    value = rng.normal(size=(FRAMES, SIZE))
    for order in (1, 2):
        metric, factor = _spd(rng, FRAMES - order), rng.uniform(0.5, 2.0, FRAMES - order)
        band.add_differences(factor, metric, order, value)
        operator = np.kron(np.diff(np.eye(FRAMES), order, axis=0), np.eye(SIZE))
        weight = np.zeros((len(operator),) * 2)
        for t in range(len(metric)):
            some = slice(SIZE * t, SIZE * (t + 1))
            weight[some, some] = factor[t] * metric[t]
        dense += operator.T @ weight @ operator
        gradient += operator.T @ weight @ operator @ value.ravel()
    parts = tuple(rng.normal(size=(FRAMES - 2, 2, SIZE)) for _ in range(3))
    curvature = np.tile(np.diag([1.0, 2.0]), (FRAMES - 2, 1, 1))
    pull = rng.normal(size=(FRAMES - 2, 2))
    band.add_rows(parts, curvature, pull)
    for t in range(FRAMES - 2):
        row = np.zeros((2, FRAMES * SIZE))
        row[:, SIZE * t : SIZE * (t + 3)] = np.concatenate([part[t] for part in parts], axis=1)
        dense += row.T @ curvature[t] @ row
        gradient += row.T @ pull[t]
    band.add_rows(tuple(part[:1] for part in parts), curvature[:1], pull[:1], last=True)
    row = np.zeros((2, FRAMES * SIZE))
    row[:, -3 * SIZE :] = np.concatenate([part[0] for part in parts], axis=1)
    dense += row.T @ curvature[0] @ row
    gradient += row.T @ pull[0]
    return band, dense, gradient


def test_solution_is_that_of_the_dense_matrix() -> None:
    band, dense, gradient = _problem()
    assert band.gradient.ravel() == pytest.approx(gradient, abs=1e-12)
    assert band.solve().ravel() == pytest.approx(np.linalg.solve(dense, -gradient), abs=1e-10)


def test_pinned_frames_stay_and_the_rest_is_solved_without_them() -> None:
    band, dense, gradient = _problem()
    fixed = np.array([True, False, False, False, True, False, False])
    free = np.repeat(~fixed, SIZE)
    twin = np.linalg.solve(dense[np.ix_(free, free)], -gradient[free])
    band.pin(fixed)
    found = band.solve()
    assert not found[fixed].any()
    assert found[~fixed].ravel() == pytest.approx(twin, abs=1e-10)


def test_an_indefinite_matrix_is_refused() -> None:
    band = BlockBand(FRAMES, SIZE)
    band.blocks[0] -= np.eye(SIZE)
    with pytest.raises(SolverError, match="no unique solution"):
        band.solve()
