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
from physretarget.ocp.cones import solve
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

CONE_WINDOW = 1200
CONE_AHEAD = 240
"""Frames of a piece of the cone programme, and further ones that it knows of."""


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
    x, _, _ = solve("root height", quadratic, np.zeros(matrix.shape[1]), matrix, bound, cones)
    return float(np.sum(x[count:] ** 2))


def cone_programme(scene: Scene, basis: Basis, settings: RootHeightSettings) -> Convex:
    """Displacement and floor forces together: a second-order cone programme.

    A force at every active contact point, inside its friction cone, against the whole required
    wrench. Touching points are drawn to the floor, others kept above it.

    Long clips are solved piece by piece, or memory would grow with them by a gigabyte every three
    minutes: a piece knows what follows for a while (CONE_AHEAD), but only its own weights stay,
    and the next one finds them given. What is CONE_AHEAD away hardly matters.
    """
    weights: Array = np.zeros(basis.count)
    force = np.zeros((scene.frames, 3))
    value, curvature = (sparse_of(basis, b) for b in (basis.value, basis.curvature))
    before: Array = np.zeros(0)
    first, given, iterations, status = 0, 0, 0, "Solved"
    # A piece is at least as long as a weight acts, or the next one would begin no later.
    window = max(CONE_WINDOW, 2 * int(np.ceil(basis.width * scene.frames / basis.count)))
    while given < basis.count:
        last = min(first + window + CONE_AHEAD, scene.frames)
        rows, columns = slice(first, last), slice(given, int(basis.first[last - 1]) + basis.width)
        piece = _Piece(
            scene.between(first, last), value[rows, columns], curvature[rows, columns],
            value[rows] @ weights, curvature[rows] @ weights, before[first:last],
        )  # fmt: skip
        found = _cone_piece(piece, settings)
        weights[columns], force[rows] = found.weights, found.force
        iterations += found.iterations
        status = status if found.status == "Solved" else found.status
        if last == scene.frames:
            break
        before = value[:last] @ weights
        given = int(basis.first[first + window]) + basis.width // 2
        weights[given:] = 0.0
        first = int(np.searchsorted(basis.first, given - basis.width, side="right"))
    return Convex(weights, force, status, iterations)


@dataclass(frozen=True)
class _Piece:
    """Some frames of a clip, and the weights that are still free there.

    ``value`` and ``curvature`` (T, n) lead from them to displacement (m) and acceleration (m/s²);
    ``displacement`` and ``acceleration`` (T,) are what the weights before make of these frames,
    ``before`` the displacement that the first of them had in the piece before: it is possible.
    """

    scene: Scene
    value: sparse.csr_array
    curvature: sparse.csr_array
    displacement: Array
    acceleration: Array
    before: Array


def _cone_piece(piece: _Piece, settings: RootHeightSettings) -> Convex:
    scene = piece.scene
    at, point = np.nonzero(scene.active)
    count, forces = piece.value.shape[1], at.size
    wrench, constant = _wrench_rows(piece, settings, at, point)
    shape_rows, shape_constant = _shape_rows(piece, settings, forces)
    rows = sparse.vstack([wrench, shape_rows], format="csr")
    constants = np.concatenate([constant, shape_constant])
    residuals = rows.shape[0]
    unknowns = count + 3 * forces
    # r = rows x + constants, as equalities, keeps everything sparse
    equal = sparse.hstack([rows, -sparse.eye_array(residuals)], format="csr")
    rest = sparse.csr_array((scene.frames, 3 * forces + residuals))
    inside = sparse.hstack([piece.value, rest], format="csr")
    low, high = _reach(piece, settings)
    cone = sparse.csr_array(
        (
            np.tile([-scene.friction, -1.0, -1.0], forces),
            (np.arange(3 * forces), count + (3 * np.arange(forces)[:, None] + [2, 0, 1]).ravel()),
        ),
        (3 * forces, unknowns + residuals),
    )
    matrix = sparse.vstack([equal, inside, -inside, cone], format="csc")
    bound = np.concatenate([-constants, high, -low, np.zeros(3 * forces)])
    cones = [clarabel.ZeroConeT(residuals), clarabel.NonnegativeConeT(2 * scene.frames)]
    cones += [clarabel.SecondOrderConeT(3)] * forces
    weights = np.concatenate([np.full(unknowns, settings.weights), np.ones(residuals)])
    quadratic = sparse.diags_array(weights, format="csc")
    x, status, used = solve(
        "root height", quadratic, np.zeros(matrix.shape[1]), matrix, bound, cones
    )
    force = np.zeros((scene.frames, 3))
    np.add.at(force, at, x[count:unknowns].reshape(-1, 3) * scene.weight)
    return Convex(x[:count], force, status, used)


def _reach(piece: _Piece, settings: RootHeightSettings) -> tuple[Array, Array]:
    """(T,) least and largest that the free weights may add to the displacement, m."""
    scene = piece.scene
    limit = min(settings.limit, 1e3) * scene.size
    lowest = scene.height.min(axis=1)
    floor = np.minimum(lowest, 0.0) - 0.002 * scene.size - lowest
    low = np.where(scene.flight, np.maximum(floor, -limit), -limit)
    if np.isfinite(settings.floor):
        low = np.maximum(low, lowest_displacement(scene, settings))
    high = np.full(scene.frames, limit)
    # Where hardly any weight is free, a solver's rounding must not make the impossible of it.
    known = slice(0, len(piece.before))
    low[known] = np.minimum(low[known], piece.before - 1e-9)
    high[known] = np.maximum(high[known], piece.before + 1e-9)
    return low - piece.displacement, high - piece.displacement


def _wrench_rows(
    piece: _Piece, settings: RootHeightSettings, at: NDArray[np.intp], point: NDArray[np.intp]
) -> tuple[sparse.csr_array, Array]:
    """(required - floor) wrench in body weights as rows over (w, forces in body weights)."""
    scene = piece.scene
    frames, forces = scene.frames, at.size
    curvature = piece.curvature * (scene.mass / scene.weight)
    push = piece.acceleration * (scene.mass / scene.weight)
    arm, contact = scene.arm / scene.size, scene.contact[at, point] / scene.size
    column = 3 * np.arange(forces)
    empty = sparse.csr_array(curvature.shape)

    def floor(x: Array | float, y: Array | float, z: Array | float) -> sparse.csr_array:
        entries = [np.broadcast_to(c, forces) for c in (x, y, z)]
        where = (np.tile(at, 3), np.concatenate([column, column + 1, column + 2]))
        return sparse.csr_array((np.concatenate(entries), where), (frames, 3 * forces))

    x, y, z = contact.T
    required = scene.force / scene.weight
    parts = [  # weight, by acceleration, by force, constant
        (settings.horizontal, empty, floor(1, 0, 0), required[:, 0]),
        (settings.horizontal, empty, floor(0, 1, 0), required[:, 1]),
        (settings.vertical, curvature, floor(0, 0, 1), required[:, 2] + push),
    ]
    moment = scene.moment / (scene.weight * scene.size)
    tilts = (arm[:, 1], -arm[:, 0], np.zeros(frames))
    levers = (floor(0, -z, y), floor(z, 0, -x), floor(-y, x, 0))
    for axis in range(3):
        tilted = sparse.csr_array(curvature.multiply(tilts[axis][:, None]))
        constant = moment[:, axis] + tilts[axis] * push
        parts.append((settings.moment, tilted, levers[axis], constant))
    rows = [w * sparse.hstack([a, -f]) for w, a, f, _ in parts if w > 0]
    constants = [w * c for w, _, _, c in parts if w > 0]
    return sparse.csr_array(sparse.vstack(rows)), np.concatenate(constants)


def _shape_rows(
    piece: _Piece, settings: RootHeightSettings, forces: int
) -> tuple[sparse.csr_array, Array]:
    """Displacement, roughness, and touching points drawn to the floor."""
    scene = piece.scene
    touching = (~scene.flight).astype(np.float64)
    lowest = np.where(scene.active, scene.height, np.inf).min(axis=1, initial=np.inf)
    lowest = np.where(scene.flight, 0.0, lowest)
    draw = 5.0 / scene.size * touching
    near, smooth = (
        settings.displacement / scene.size,
        settings.roughness * scene.mass / scene.weight,
    )
    rows = [near * piece.value, smooth * piece.curvature, piece.value.multiply(draw[:, None])]
    stacked = sparse.hstack(
        [sparse.vstack(rows), sparse.csr_array((3 * scene.frames, 3 * forces))], format="csr"
    )
    moved = piece.displacement
    constants = [near * moved, smooth * piece.acceleration, draw * (lowest + moved)]
    return sparse.csr_array(stacked), np.concatenate(constants)
