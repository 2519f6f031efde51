"""How well any displacement could do: a convex programme with the contact times known.

With the phases given, forces at the floor are free variables instead of functions of height.
Both programmes below are then convex: their optimum is global and comes with a certificate.
"""

from __future__ import annotations

from dataclasses import dataclass

import clarabel
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from physretarget.errors import SolverError
from physretarget.ocp.basis import Basis, sparse_of
from physretarget.ocp.problem import Scene, lowest_displacement
from physretarget.ocp.settings import RootHeightSettings

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

SINK = 0.015
RISE = 0.003
"""Heights, over the character's, between which a touching point must stay for the bound; widened
to those of the solution that is judged, so that it always counts among the possible ones."""


WINDOW = 600
"""Frames per programme of the bound."""


@dataclass(frozen=True)
class Convex:
    """Weights (n,) of the bumps and the floor's force (T, 3), N."""

    weights: Array
    force: Array
    status: str
    iterations: int


def vertical_bound(
    scene: Scene, basis: Basis, touching: Flags, displacement: Array, limit: float
) -> float:
    """Least RMS vertical mismatch (N) of all displacements with the contact times ``touching``.

    The floor may push with any force in ``touching`` frames (T,) and not at all in others; it
    never pulls. The displacement stays within ``limit`` (m), or that of the judged
    ``displacement`` (T,) where larger. Long clips are cut into windows that need not agree where
    they meet: less is asked, so that the sum is still a bound. NaN if the solver gives up.
    """
    limit = max(limit, float(np.abs(displacement).max()))
    lowest = scene.height.min(axis=1)
    there = lowest + displacement
    low = np.minimum(-SINK * scene.size, there) - lowest
    high = np.maximum(RISE * scene.size, there) - lowest
    low = np.where(touching, np.maximum(low, -limit), -limit) / scene.size
    high = np.where(touching, np.minimum(high, limit), limit) / scene.size
    required = scene.force[:, 2] / scene.weight
    gain = sparse_of(basis, basis.curvature) * (scene.mass * scene.size / scene.weight)
    value = sparse_of(basis, basis.value)
    total = 0.0
    for start in range(0, scene.frames, WINDOW):
        rows = slice(start, start + WINDOW)
        columns = slice(int(basis.first[rows].min()), int(basis.first[rows].max()) + basis.width)
        part = (gain[rows, columns], value[rows, columns], required[rows])
        try:
            total += _window_bound(*part, touching[rows], low[rows], high[rows])
        except SolverError:
            return float("nan")
    return float(np.sqrt(total / scene.frames) * scene.weight)


def _window_bound(
    gain: sparse.csr_array,
    value: sparse.csr_array,
    required: Array,
    touching: Flags,
    low: Array,
    high: Array,
) -> float:
    """Least sum of squared defects, in body weights and heights."""
    frames, count = gain.shape
    # unknowns (w, r): r = required in flight, r <= required where the floor may push
    balance = sparse.hstack([-gain, sparse.eye_array(frames)], format="csr")
    inside = sparse.hstack([value, sparse.csr_array((frames, frames))], format="csr")
    order = np.concatenate([np.flatnonzero(~touching), np.flatnonzero(touching)])
    matrix = sparse.vstack([balance[order], inside, -inside], format="csc")
    bound = np.concatenate([required[order], high + 1e-9, -low + 1e-9])
    cones = [
        clarabel.ZeroConeT(int((~touching).sum())),
        clarabel.NonnegativeConeT(int(touching.sum()) + 2 * frames),
    ]
    quadratic = sparse.diags_array(
        np.concatenate([np.full(count, 1e-9), np.ones(frames)]), format="csc"
    )
    x, _, _ = _solve(quadratic, np.zeros(matrix.shape[1]), matrix, bound, cones)
    return float(np.sum(x[count:] ** 2))


def cone_programme(scene: Scene, basis: Basis, settings: RootHeightSettings) -> Convex:
    """Displacement and floor forces together: a second-order cone programme.

    A force at every active contact point, inside its friction cone, against the whole required
    wrench. Touching points are drawn to the floor, others kept above it.
    """
    at, point = np.nonzero(scene.active)
    count, forces = basis.count, at.size
    wrench, constant = _wrench_rows(scene, basis, settings, at, point)
    shape_rows, shape_constant = _shape_rows(scene, basis, settings, forces)
    rows = sparse.vstack([wrench, shape_rows], format="csr")
    constants = np.concatenate([constant, shape_constant])
    residuals = rows.shape[0]
    unknowns = count + 3 * forces
    # r = rows x + constants, as equalities, keeps everything sparse
    equal = sparse.hstack([rows, -sparse.eye_array(residuals)], format="csr")
    value = sparse_of(basis, basis.value)
    rest = sparse.csr_array((scene.frames, 3 * forces + residuals))
    inside = sparse.hstack([value, rest], format="csr")
    limit = min(settings.limit, 1e3) * scene.size
    lowest = scene.height.min(axis=1)
    floor = np.minimum(lowest, 0.0) - 0.002 * scene.size - lowest
    low = np.where(scene.flight, np.maximum(floor, -limit), -limit)
    if np.isfinite(settings.floor):
        low = np.maximum(low, lowest_displacement(scene, settings))
    cone = sparse.csr_array(
        (
            np.tile([-scene.friction, -1.0, -1.0], forces),
            (np.arange(3 * forces), count + (3 * np.arange(forces)[:, None] + [2, 0, 1]).ravel()),
        ),
        (3 * forces, unknowns + residuals),
    )
    matrix = sparse.vstack([equal, inside, -inside, cone], format="csc")
    bound = np.concatenate([-constants, np.full(scene.frames, limit), -low, np.zeros(3 * forces)])
    cones = [clarabel.ZeroConeT(residuals), clarabel.NonnegativeConeT(2 * scene.frames)]
    cones += [clarabel.SecondOrderConeT(3)] * forces
    weights = np.concatenate([np.full(unknowns, settings.weights), np.ones(residuals)])
    quadratic = sparse.diags_array(weights, format="csc")
    x, status, used = _solve(quadratic, np.zeros(matrix.shape[1]), matrix, bound, cones)
    force = np.zeros((scene.frames, 3))
    np.add.at(force, at, x[count:unknowns].reshape(-1, 3) * scene.weight)
    return Convex(x[:count], force, status, used)


def _wrench_rows(
    scene: Scene,
    basis: Basis,
    settings: RootHeightSettings,
    at: NDArray[np.intp],
    point: NDArray[np.intp],
) -> tuple[sparse.csr_array, Array]:
    """(required - floor) wrench in body weights as rows over (w, forces in body weights)."""
    frames, forces = scene.frames, at.size
    curvature = sparse_of(basis, basis.curvature) * (scene.mass / scene.weight)
    arm, contact = scene.arm / scene.size, scene.contact[at, point] / scene.size
    column = 3 * np.arange(forces)
    empty = sparse.csr_array((frames, basis.count))

    def floor(x: Array | float, y: Array | float, z: Array | float) -> sparse.csr_array:
        entries = [np.broadcast_to(c, forces) for c in (x, y, z)]
        where = (np.tile(at, 3), np.concatenate([column, column + 1, column + 2]))
        return sparse.csr_array((np.concatenate(entries), where), (frames, 3 * forces))

    x, y, z = contact.T
    parts = [  # weight, by acceleration, by force, constant
        (settings.horizontal, empty, floor(1, 0, 0), scene.force[:, 0] / scene.weight),
        (settings.horizontal, empty, floor(0, 1, 0), scene.force[:, 1] / scene.weight),
        (settings.vertical, curvature, floor(0, 0, 1), scene.force[:, 2] / scene.weight),
    ]
    moment = scene.moment / (scene.weight * scene.size)
    tilts = (
        sparse.csr_array(curvature.multiply(arm[:, 1:2])),
        sparse.csr_array(curvature.multiply(-arm[:, 0:1])),
        empty,
    )
    levers = (floor(0, -z, y), floor(z, 0, -x), floor(-y, x, 0))
    for axis in range(3):
        parts.append((settings.moment, tilts[axis], levers[axis], moment[:, axis]))
    rows = [w * sparse.hstack([a, -f]) for w, a, f, _ in parts if w > 0]
    constants = [w * c for w, _, _, c in parts if w > 0]
    return sparse.csr_array(sparse.vstack(rows)), np.concatenate(constants)


def _shape_rows(
    scene: Scene, basis: Basis, settings: RootHeightSettings, forces: int
) -> tuple[sparse.csr_array, Array]:
    """Displacement, roughness, and touching points drawn to the floor."""
    value, curvature = (sparse_of(basis, b) for b in (basis.value, basis.curvature))
    touching = (~scene.flight).astype(np.float64)
    lowest = np.where(scene.active, scene.height, np.inf).min(axis=1, initial=np.inf)
    lowest = np.where(scene.flight, 0.0, lowest)
    draw = 5.0 / scene.size * touching
    rows = [
        settings.displacement / scene.size * value,
        settings.roughness * scene.mass / scene.weight * curvature,
        value.multiply(draw[:, None]),
    ]
    zeros = np.zeros(scene.frames)
    stacked = sparse.hstack(
        [sparse.vstack(rows), sparse.csr_array((3 * scene.frames, 3 * forces))], format="csr"
    )
    return sparse.csr_array(stacked), np.concatenate([zeros, zeros, draw * lowest])


def _solve(
    quadratic: sparse.csc_array,
    linear: Array,
    matrix: sparse.csc_array,
    bound: Array,
    cones: list[object],
) -> tuple[Array, str, int]:
    options = clarabel.DefaultSettings()
    options.verbose = False
    options.max_threads = 1
    solver = clarabel.DefaultSolver(
        sparse.csc_matrix(quadratic), linear, sparse.csc_matrix(matrix), bound, cones, options
    )
    found = solver.solve()
    status = str(found.status)
    if status not in ("Solved", "AlmostSolved"):
        raise SolverError(f"the convex programme of the root height ended as {status}")
    return np.asarray(found.x, dtype=np.float64), status, int(found.iterations)
