"""Gaussian bumps over time and their finite differences: Yamane 2010 eq. (10), kept sparse."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

Array = NDArray[np.float64]
Sparse = sparse.csr_array

CUTOFF = 4.0
"""Bumps are cut off at this many σ, where they have fallen to 1e-7."""


@dataclass(frozen=True)
class Basis:
    """Displacement, velocity and acceleration as linear functions of n weights.

    Frame t depends on ``width`` consecutive weights from ``first[t]`` on: ``value``, ``rate``
    and ``curvature`` (T, width) are the coefficients, in units of 1, 1/s and 1/s².
    """

    count: int
    first: NDArray[np.intp]
    value: Array
    rate: Array
    curvature: Array

    @property
    def width(self) -> int:
        """Weights that act on one frame."""
        return int(self.value.shape[1])

    @property
    def columns(self) -> NDArray[np.intp]:
        """Indices (T, width) of the weights that act on each frame."""
        return self.first[:, None] + np.arange(self.width)

    def motion(self, weights: Array) -> tuple[Array, Array, Array]:
        """Displacement (m), velocity (m/s), acceleration (m/s²), each (T,), of weights (n,)."""
        local = weights[self.columns]
        return (
            np.einsum("tm,tm->t", self.value, local),
            np.einsum("tm,tm->t", self.rate, local),
            np.einsum("tm,tm->t", self.curvature, local),
        )


def gaussian_basis(time: Array, interval: float, share: Array | None = None) -> Basis:
    """Bumps at every ``interval`` seconds (at least a frame's length), σ twice that.

    ``share`` (T,): by which the displacement of each frame is multiplied; 1 if None.
    """
    frames = time.size
    step = float(time[-1] - time[0]) / max(frames - 1, 1) if frames > 1 else 1.0
    interval = max(interval, step)
    count = int(np.ceil((time[-1] - time[0]) / interval - 1e-9)) + 1
    centres = time[0] + interval * np.arange(count)
    sigma = 2.0 * interval
    reach = int(np.ceil(CUTOFF * sigma / interval))
    nearest = np.rint((time - time[0]) / interval).astype(np.intp)
    columns = nearest[:, None] + np.arange(-reach, reach + 1)
    inside = (columns >= 0) & (columns < count)
    distance = (time[:, None] - centres[np.clip(columns, 0, count - 1)]) / sigma
    inside &= np.abs(distance) <= CUTOFF
    rows = np.broadcast_to(np.arange(frames)[:, None], columns.shape)
    value = Sparse(
        (np.exp(-(distance[inside] ** 2)), (rows[inside], columns[inside])), (frames, count)
    )
    if share is not None:
        value = Sparse(sparse.diags_array(share) @ value)
    first_difference, second_difference = differences(frames, step)
    return _windows(value, first_difference @ value, second_difference @ value)


def differences(frames: int, step: float) -> tuple[Sparse, Sparse]:
    """Velocity and acceleration (T, T) of samples ``step`` seconds apart.

    The very formulas of ``mjcf.derivatives``: central inside, one-sided of second order at the
    ends, so that what is optimised is what inverse dynamics of the result will see.
    """
    inside = np.arange(1, frames - 1)
    rows, columns = np.tile(inside, 3), np.concatenate([inside - 1, inside, inside + 1])
    rate = [(rows, columns, np.repeat([-0.5, 0.0, 0.5], inside.size))]
    curvature = [(rows, columns, np.repeat([1.0, -2.0, 1.0], inside.size))]
    if frames == 2:
        rate += [_row(t, 0, [-1.0, 1.0]) for t in (0, 1)]
    if frames > 2:
        rate.append(_row(0, 0, [-1.5, 2.0, -0.5]))
        rate.append(_row(frames - 1, frames - 3, [0.5, -2.0, 1.5]))
        one_sided = [2.0, -5.0, 4.0, -1.0] if frames > 3 else [1.0, -2.0, 1.0]
        curvature.append(_row(0, 0, one_sided))
        curvature.append(_row(frames - 1, frames - len(one_sided), one_sided[::-1]))
    return _assembled(rate, frames, step), _assembled(curvature, frames, step**2)


_Entries = tuple[NDArray[np.intp], NDArray[np.intp], Array]


def _row(row: int, first: int, values: list[float]) -> _Entries:
    columns = np.arange(first, first + len(values))
    return np.full(len(values), row), columns, np.array(values)


def _assembled(entries: list[_Entries], frames: int, scale: float) -> Sparse:
    rows, columns, values = (np.concatenate(part) for part in zip(*entries, strict=True))
    matrix = Sparse((values / scale, (rows, columns)), (frames, frames))
    matrix.eliminate_zeros()
    return matrix


def _windows(*operators: Sparse) -> Basis:
    """Rows of sparse operators of one shape as dense windows over common columns."""
    frames, count = operators[0].shape
    low = np.full(frames, count)
    high = np.zeros(frames, dtype=np.intp)
    for operator in operators:
        rows = np.repeat(np.arange(frames), np.diff(operator.indptr))
        np.minimum.at(low, rows, operator.indices)
        np.maximum.at(high, rows, operator.indices)
    width = min(int((high - low).max()) + 1, count)
    first = np.minimum(low, count - width).astype(np.intp)
    dense = []
    for operator in operators:
        rows = np.repeat(np.arange(frames), np.diff(operator.indptr))
        window = np.zeros((frames, width))
        window[rows, operator.indices - first[rows]] = operator.data
        dense.append(window)
    return Basis(count, first, *dense)


def sparse_of(basis: Basis, window: Array) -> Sparse:
    """One of the basis's windows (T, width) as a sparse (T, n) matrix."""
    frames = basis.first.size
    rows = np.broadcast_to(np.arange(frames)[:, None], window.shape)
    keep = window != 0.0
    return Sparse((window[keep], (rows[keep], basis.columns[keep])), (frames, basis.count))
