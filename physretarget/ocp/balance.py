"""The balance of a clip as a convex programme: how far its momentum must be led elsewhere.

Unknown is the excursion u (T, 6) of every frame: by how much the centre of mass is displaced,
over its height h, and the displacement's moment about it, ∫ΔL dt, over m h². With the bodies'
inertias frozen, and τ² = h / g, the wrench that the motion requires about the centre of mass,
in body weights, changes by

    Δw = τ² ü + (0, u_lin × f)            (the centre of mass moves away from where f acts)

The floor answers with a force in the friction cone of every point in contact. What no floor
can explain, r, costs its length, not its square, so that few frames are left unexplained, not all
of them a little; ``patience`` says in which it is worth it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import clarabel
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from physretarget.ocp.cones import solve

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Ints = NDArray[np.int64]

_PRICE_OF_FORCE = 1e-6
_UNIT = 1e4
"""The programme's cost is multiplied by this: a hundredth of the height squared is 1, so that the
solver's tolerances, absolute below 1, are small against what can be seen."""
_ACCURATE = 1e-8


@dataclass(frozen=True, kw_only=True)
class Weights:
    """What counts how much, against half the mean square displacement of the markers.

    Displacements are in heights of the character, forces in body weights, moments in body
    weights times the height of the centre of mass.

    residual: price of the length of what the floor cannot explain in a frame. spike: it grows
        with the square, too, by half of this: much in one frame is worse than a little in many.
    roughness: of half the mean square of the acceleration that the markers are given, in heights
        per τ² (τ² = h / g: the lower the centre of mass, the quicker the balance is lost).
    ends: of half the mean square of the velocity that they are given at a clip's ends (within about
        τ), in heights per τ: beyond them nobody has to catch a fall.
    limit: the most that the markers of a frame move (RMS).
    """

    residual: float = 0.2
    spike: float = 5.0
    roughness: float = 0.005
    ends: float = 3.0
    limit: float = 0.08


@dataclass(frozen=True, eq=False)
class Support:
    """Where the floor can push: ``points`` (R, n, 3) from the centre of mass, over its height,
    ``on`` (R, n) those that may, ``friction`` of all of them."""

    points: Array
    on: Flags
    friction: float

    def of(self, rows: Ints) -> Support:
        """The same for some of the frames."""
        return replace(self, points=self.points[rows], on=self.on[rows])


@dataclass(frozen=True, eq=False)
class Programme:
    """T frames, of which R are judged.

    ``wrench`` (R, 6) required now, force and moment about the centre of mass; ``support`` of
    the same frames; ``patience`` (R,) how much their residual counts; ``columns`` (R,) which of
    the frames they are. ``second`` (R, T) second differences times τ²; ``first`` (T, T)
    differences times τ, near the ends of the clip alone. ``excursion`` (T, 6) of the clip as it
    is now and ``cost`` (T, 6, 6): ½ uᵀ cost u is half the mean square displacement of the
    markers that it takes.
    """

    wrench: Array
    support: Support
    patience: Array
    second: sparse.csr_array
    columns: Ints
    first: sparse.csr_array
    excursion: Array
    cost: Array


@dataclass(frozen=True, eq=False)
class Excursion:
    """What the programme asks for: ``excursion`` (T, 6) and what is left, ``residual`` (R, 6)."""

    excursion: Array
    residual: Array


def minimise(programme: Programme, weights: Weights) -> Excursion:
    """Solve the programme. Raises SolverError if the solver gives up."""
    frames, judged = len(programme.cost), len(programme.wrench)
    change = _change_of_wrench(programme)
    push = _push(programme.support)
    forces = push.shape[1]
    # unknowns: u, forces, (length of r, r) per frame
    blocks = [6 * frames, forces, 7 * judged]
    start = np.concatenate([[0], np.cumsum(blocks)])
    rest = _inside_cones(judged)
    balance = sparse.hstack([-change, push, rest])
    right = programme.wrench.ravel() - change @ programme.excursion.ravel()
    friction = _padded(_friction_cones(programme.support.friction, forces), start[1], start[-1])
    bend = _padded(-sparse.eye_array(7 * judged, format="csr"), start[2], start[-1])
    reach, most = _reach(programme.cost, weights.limit)
    matrix = sparse.vstack([balance, friction, bend, _padded(reach, 0, start[-1])], format="csc")
    bound = np.concatenate([right, np.zeros(forces + 7 * judged), most])
    cones: list[object] = [clarabel.ZeroConeT(6 * judged)]
    cones += [clarabel.SecondOrderConeT(3)] * (forces // 3)
    cones += [clarabel.SecondOrderConeT(7)] * (judged + frames)
    rough = sparse.kron(programme.second, sparse.eye_array(6), format="csr")
    seen = sparse.block_diag(list(programme.cost[programme.columns]))
    whole = sparse.block_diag(list(programme.cost))
    speed = sparse.kron(programme.first, sparse.eye_array(6), format="csr")
    slope = np.zeros(start[-1])
    slope[start[2] :: 7] = weights.residual * programme.patience
    quadratic = sparse.block_diag(
        [
            whole
            + weights.roughness * (rough.T @ seen @ rough)
            + weights.ends * (speed.T @ whole @ speed),
            _PRICE_OF_FORCE * sparse.eye_array(forces),
            sparse.diags_array(weights.spike * slope[start[2] :]),
        ],
        format="csc",
    )
    x = _solved(_UNIT * quadratic, _UNIT * slope, matrix, bound, cones)
    residual = rest @ x[start[2] :]
    return Excursion(x[: start[1]].reshape(frames, 6), residual.reshape(judged, 6))


def unexplained(wrench: Array, support: Support) -> Array:
    """(R,) least length of what the floor cannot explain of ``wrench`` (R, 6), frame by frame."""
    judged = len(wrench)
    push = _push(support)
    forces = push.shape[1]
    total = forces + 7 * judged
    balance = sparse.hstack([push, _inside_cones(judged)])
    friction = _padded(_friction_cones(support.friction, forces), 0, total)
    bend = _padded(-sparse.eye_array(7 * judged, format="csr"), forces, total)
    matrix = sparse.vstack([balance, friction, bend], format="csc")
    bound = np.concatenate([wrench.ravel(), np.zeros(forces + 7 * judged)])
    cones: list[object] = [clarabel.ZeroConeT(6 * judged)]
    cones += [clarabel.SecondOrderConeT(3)] * (forces // 3)
    cones += [clarabel.SecondOrderConeT(7)] * judged
    quadratic = sparse.diags_array(
        np.concatenate([np.full(forces, _PRICE_OF_FORCE), np.zeros(7 * judged)]), format="csc"
    )
    slope = np.zeros(total)
    slope[forces::7] = 1.0
    x = _solved(quadratic, slope, matrix, bound, cones)
    rest: Array = np.linalg.norm(x[forces:].reshape(judged, 7)[:, 1:], axis=1)
    return rest


def _change_of_wrench(programme: Programme) -> sparse.csr_array:
    """(6 R, 6 T): what an excursion adds to the required wrench."""
    judged, frames = programme.second.shape
    by_acceleration = sparse.kron(programme.second, sparse.eye_array(6), format="csr")
    x, y, z = programme.wrench[:, :3].T
    row, column = 6 * np.arange(judged), 6 * programme.columns
    entries = [(3, 1, z), (3, 2, -y), (4, 0, -z), (4, 2, x), (5, 0, y), (5, 1, -x)]
    lever = sparse.csr_array(
        (
            np.concatenate([value for _, _, value in entries]),
            (
                np.concatenate([row + i for i, _, _ in entries]),
                np.concatenate([column + j for _, j, _ in entries]),
            ),
        ),
        (6 * judged, 6 * frames),
    )
    return sparse.csr_array(by_acceleration + lever)


def _push(support: Support) -> sparse.csr_array:
    """(6 R, 3 F): wrench about the centre of mass of a force at every point that may push."""
    frame, point = np.nonzero(support.on)
    x, y, z = support.points[frame, point].T
    one = np.ones(len(frame))
    row, column = 6 * frame, 3 * np.arange(len(frame))
    entries = [(0, 0, one), (1, 1, one), (2, 2, one)]
    entries += [(3, 1, -z), (3, 2, y), (4, 0, z), (4, 2, -x), (5, 0, -y), (5, 1, x)]
    values = np.concatenate([value for _, _, value in entries])
    rows = np.concatenate([row + i for i, _, _ in entries])
    columns = np.concatenate([column + j for _, j, _ in entries])
    shape = (6 * len(support.on), 3 * len(frame))
    return sparse.csr_array((values, (rows, columns)), shape)


def _inside_cones(judged: int) -> sparse.csr_array:
    """(6 R, 7 R): takes the six residuals out of each frame's cone (length, residual)."""
    columns = (7 * np.arange(judged)[:, None] + np.arange(1, 7)).ravel()
    ones = np.ones(6 * judged)
    return sparse.csr_array((ones, (np.arange(6 * judged), columns)), (6 * judged, 7 * judged))


def _friction_cones(friction: float, forces: int) -> sparse.csr_array:
    """(F, F) rows (-μ f_z, -f_x, -f_y) of each force."""
    columns = (np.arange(0, forces, 3)[:, None] + [2, 0, 1]).ravel()
    values = np.tile([-friction, -1.0, -1.0], forces // 3)
    return sparse.csr_array((values, (np.arange(forces), columns)), (forces, forces))


def _reach(cost: Array, limit: float) -> tuple[sparse.csr_array, Array]:
    """Rows and bounds of |u| ≤ limit, in the length that ``cost`` gives an excursion."""
    frames = len(cost)
    blocks = np.zeros((frames, 7, 6))
    blocks[:, 1:] = -np.swapaxes(np.linalg.cholesky(cost), 1, 2)
    bound = np.zeros((frames, 7))
    bound[:, 0] = limit
    return sparse.block_diag(list(blocks), format="csr"), bound.ravel()


def _padded(block: sparse.csr_array, before: int, total: int) -> sparse.csr_array:
    """A block of rows over all ``total`` unknowns, its own from ``before`` on."""
    padded = sparse.coo_array(block)
    at = (padded.coords[0], padded.coords[1] + before)
    return sparse.csr_array((padded.data, at), (block.shape[0], total))


def _solved(
    quadratic: Any, slope: Array, matrix: sparse.csc_array, bound: Array, cones: list[object]
) -> Array:
    upper = sparse.triu(quadratic)
    return solve("balance", upper, slope, matrix, bound, cones, tolerance=_ACCURATE).x
