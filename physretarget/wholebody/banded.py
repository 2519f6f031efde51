"""Symmetric systems whose blocks couple each frame with the two after it: banded Cholesky."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from physretarget.errors import SolverError

Array = NDArray[np.float64]


class BlockBand:
    """A symmetric matrix over T frames of n unknowns each, built block by block, and its gradient.

    ``blocks`` are the diagonal blocks (T, n, n) and the ones below it: (T - 1, n, n) of frame
    t + 1 (rows) and t (columns), (T - 2, n, n) of frame t + 2 and t. ``gradient`` (T, n).
    """

    def __init__(self, frames: int, size: int) -> None:
        self.blocks = [np.zeros((max(frames - k, 0), size, size)) for k in range(3)]
        self.gradient = np.zeros((frames, size))

    def add_differences(
        self, factor: Array | float, metric: Array, order: int, value: Array
    ) -> None:
        """Add ½ Σ factor dᵀ M d, d the first or second differences of ``value`` (T, n).

        ``factor`` scalar or (T - order,), ``metric`` M (T - order, n, n).
        """
        stencil = {1: (-1.0, 1.0), 2: (1.0, -2.0, 1.0)}[order]
        weighted = np.broadcast_to(np.asarray(factor), (len(metric),))[:, None, None] * metric
        count = len(metric)
        pull = (weighted @ np.diff(value, order, axis=0)[..., None])[..., 0]
        for i, a in enumerate(stencil):
            self.gradient[i : i + count] += a * pull
            for j, b in enumerate(stencil[: i + 1]):
                self.blocks[i - j][j : j + count] += (a * b) * weighted

    def add_rows(
        self, parts: tuple[Array, ...], curvature: Array, pull: Array, *, last: bool = False
    ) -> None:
        """Add ½ |Σ_i parts[i] x_{t + i}|²_Q and its gradient by ``pull`` (N, k).

        ``parts`` (N, k, n), the maps of frame t, t + 1, …; ``curvature`` Q (N, k, k). Frames begin
        with the first, or end with the ``last``.
        """
        count = len(pull)
        first = len(self.gradient) - len(parts) + 1 - count if last else 0
        mapped = [curvature @ part for part in parts]
        for i, part in enumerate(parts):
            across = part.swapaxes(1, 2)
            self.gradient[first + i : first + i + count] += (across @ pull[..., None])[..., 0]
            for j in range(i + 1):
                self.blocks[i - j][first + j : first + j + count] += across @ mapped[j]

    def pin(self, frames: NDArray[np.bool_]) -> None:
        """Keep the unknowns of some frames at zero."""
        size = self.gradient.shape[1]
        self.gradient[frames] = 0.0
        for k, block in enumerate(self.blocks):
            count = len(block)
            block[frames[k : k + count] | frames[:count]] = 0.0
        self.blocks[0][frames] = np.eye(size)

    def solve(self) -> Array:
        """The unknowns (T, n) at which the gradient vanishes.

        Raises:
            SolverError: the matrix is not positive definite.
        """
        frames, size = self.gradient.shape
        width = 3 * size
        band = np.zeros((frames * size, width))
        grouped = band.reshape(frames, size, width)
        for c in range(size):
            for k, block in enumerate(self.blocks):
                first = max(k * size - c, 0)
                rows = block[:, c:, c] if k == 0 else block[:, :, c]
                grouped[: len(block), c, first : (k + 1) * size - c] = rows
        # Rows are columns in Fortran's order: the lower band, without a copy.
        factor, info = lapack.dpbtrf(band.T, lower=1, overwrite_ab=1)
        if info != 0:
            raise SolverError(
                f"the whole-body step has no unique solution (row {info} of {frames * size})"
            )
        found, _ = lapack.dpbtrs(factor, -self.gradient.ravel(), lower=1)
        return np.asarray(found.reshape(frames, size), dtype=np.float64)
