"""Where the character goes and turns: its momentum follows the actor's (Yamane 2010, 5.1).

The mapped pose has no horizontal position and no heading. Both come from the actor's
centroidal momentum, scaled to the character: momentum says how a body moves as a whole without
asking which of its parts does what, so that it carries over to any shape.

On paper -> in code: ``P, L`` momentum about the centre of mass, in heading axes (x forward,
y left, z up); ``v, ω`` velocity and turning of the heading frame; ``s_m, s_i, s_d`` -> Scales.
The paper's eq. (6) and (8) lack masses; about the centre of mass all is exact and triangular::

    L_c,z + (I_c ω)_z = s_iz L_h,z          gives the turning rate ω_z
    P_c + m_c (v + ω × p) = s_m s_d P_h     gives v_x and v_y, p the centre of mass

The other directions are kept: the key poses have decided them.

The actor is the reference actor, onto which every capture's joint rotations are carried, its path
scaled by leg length. The paper had one actor; s_d of each capture's own would hang on how its file
cuts the skeleton (0.67 or 1.10 for equal legs), and the stream, which sees the reference actor
only, would go another way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from physretarget.errors import InputError
from physretarget.features import frame_of
from physretarget.kinematics import forward, jacobian, quat_multiply
from physretarget.mjcf import Character, Momentum, derivatives, momentum
from physretarget.options.retargeting import Heading

__all__ = ["Placed", "Scales", "place", "scales"]

Array = NDArray[np.float64]

CORRECTIONS = 4  # each takes in part of what discretisation has missed
SMOOTHNESS = 0.1  # see _integrated; five times less triples the jerk of a cartwheel


@dataclass(frozen=True, eq=False)
class Scales:
    """Ratios character : actor, axes x y z of the heading frame.

    ``mass`` s_m. ``size`` (3,) s_d: mean speed of the markers along each axis as every
    rotational degree of freedom turns at unit rate one by one, in the reference poses.
    ``inertia`` (T, 3) s_i: diagonals of the inertia about the centre of mass, frame by frame,
    so that the character turns at the actor's rate also when arms or legs are drawn in.
    """

    mass: float
    size: Array
    inertia: Array


@dataclass(frozen=True, eq=False)
class Placed:
    """A clip with its global transform.

    ``qpos`` (T, nq). ``target`` and ``achieved`` (T, 3) are linear momentum in kg m/s and
    ``target_angular`` and ``achieved_angular`` (T, 3) angular momentum about the centre of mass
    in kg m²/s, all in heading axes; achieved is recomputed by MuJoCo from the resulting qpos.
    Only x and y of the linear and z of the angular part are followed. ``error`` is the RMS of
    (achieved - target) over the RMS of the target, forward (x). ``yaw`` (T,) rad and
    ``position`` (T, 2) m are the heading frame's.
    """

    qpos: Array
    target: Array
    achieved: Array
    target_angular: Array
    achieved_angular: Array
    error: float
    scales: Scales
    yaw: Array
    position: Array


def place(
    character: Character,
    qpos: Array,
    actor: Character,
    actor_qpos: Array,
    time: Array,
    *,
    heading: Heading = "momentum",
) -> Placed:
    """Give the mapped poses ``qpos`` (T, nq) a heading and a place on the floor.

    ``actor_qpos`` (T, actor nq) is the actor's motion at the same times. The clip starts at the
    origin with the actor's first heading. ``heading`` tells where turning comes from:
    ``"momentum"`` is the paper's: a limb swung about the vertical turns the rest the other way
    unless the actor's momentum says otherwise, and a walk sets off at an angle to the actor's.
    ``"actor"`` takes the rate of the actor's own heading, so that the character faces where the
    actor faces, and lets the angular momentum be what it then is.

    Raises:
        InputError: one of the models has no free joint, or the clips differ in length.
    """
    for each in (character, actor):
        if not each.has_root:
            raise InputError(f"{each.name} has no free joint, it cannot move about", path=each.path)
    if len(qpos) != len(actor_qpos):
        raise InputError(f"{len(qpos)} poses of the character, {len(actor_qpos)} of the actor")
    frame = frame_of(actor, actor_qpos)
    human = _turned(momentum(actor, actor_qpos, derivatives(actor, actor_qpos, time)[0]), frame.yaw)
    local = _without_heading(character, qpos)
    own = momentum(character, local, derivatives(character, local, time)[0])
    ratio = scales(character, own.inertia, actor, human.inertia)
    target = ratio.mass * ratio.size * human.linear
    target_angular = ratio.inertia * human.angular

    step = float(time[-1] - time[0]) / max(len(time) - 1, 1)
    follow = heading == "momentum"
    turn = (target_angular - own.angular)[:, 2] / own.inertia[:, 2, 2]
    if not follow:
        turn = _central(frame.yaw, step)
    speed = (target - own.linear)[:, :2] / character.mass - _across(turn, own.com)
    for correction in range(CORRECTIONS + 1):
        yaw = frame.yaw[0] + _integrated(turn, step) if follow else frame.yaw
        position = _integrated(_rotated(speed, yaw), step)
        moved = _moved(character, local, yaw, position)
        got = _turned(momentum(character, moved, derivatives(character, moved, time)[0]), yaw)
        if correction == CORRECTIONS:
            break
        # What finite differences of the result miss, the next round asks for in addition.
        speed = speed + (target - got.linear)[:, :2] / character.mass
        if follow:
            turn = turn + (target_angular - got.angular)[:, 2] / own.inertia[:, 2, 2]
    missed, wanted = target[:, 0] - got.linear[:, 0], target[:, 0]
    error = float(np.sqrt(np.mean(missed**2)) / max(np.sqrt(np.mean(wanted**2)), 1e-9))
    return Placed(
        qpos=moved,
        target=target,
        achieved=got.linear,
        target_angular=target_angular,
        achieved_angular=got.angular,
        error=error,
        scales=ratio,
        yaw=yaw,
        position=position,
    )


def scales(
    character: Character, character_inertia: Array, actor: Character, actor_inertia: Array
) -> Scales:
    """Ratios of mass, size and inertia; inertias (T, 3, 3) in heading axes."""
    diagonal = (0, 1, 2), (0, 1, 2)
    return Scales(
        mass=character.mass / actor.mass,
        size=_marker_speed(character) / _marker_speed(actor),
        inertia=character_inertia[:, *diagonal] / actor_inertia[:, *diagonal],
    )


def _marker_speed(character: Character) -> Array:
    """Mean speed (3,) of the markers per axis and rotational degree of freedom (m per rad).

    Slides move points by one metre per metre whatever the size, so they say nothing here. A
    degree of freedom counts the markers that it carries, no others: with the others counted as
    standing still, a lamp of 0.6 m with its few joints comes out twice as large as a man.
    """
    tree = character.tree
    pose = _without_heading(character, character.reference_qpos[None])
    markers = character.markers
    speeds = np.abs(jacobian(tree, forward(tree, pose), pose, markers.body, markers.local)[0])
    rotational = np.ones(tree.nv, dtype=bool)
    for joint in tree.joints:
        if joint.kind in ("free", "slide"):
            rotational[joint.dof : joint.dof + (3 if joint.kind == "free" else 1)] = False
    speeds = speeds.reshape(-1, 3, tree.nv)[:, :, rotational]
    carried = tree.carries[np.ix_(tree.dof_body[rotational], markers.body)].T
    mean: Array = speeds.sum(axis=(0, 2)) / max(int(carried.sum()), 1)
    return np.maximum(mean, 1e-6)


def _without_heading(character: Character, qpos: Array) -> Array:
    """The same poses over the origin, heading along x."""
    frame = frame_of(character, qpos)
    return _moved(character, qpos, -frame.yaw, None)


def _moved(character: Character, qpos: Array, yaw: Array, position: Array | None) -> Array:
    """Turn poses about the root's vertical and put the root at ``position`` (the origin)."""
    at = character.root_qpos
    moved = np.array(qpos, dtype=np.float64)
    turn = np.zeros((len(qpos), 4))
    turn[:, 0], turn[:, 3] = np.cos(0.5 * yaw), np.sin(0.5 * yaw)
    moved[:, at + 3 : at + 7] = quat_multiply(turn, qpos[:, at + 3 : at + 7])
    moved[:, at : at + 2] = 0.0 if position is None else position
    return moved


def _turned(world: Momentum, yaw: Array) -> Momentum:
    """Momentum in the axes of a heading frame at ``yaw`` (T,)."""
    axes = np.zeros((len(yaw), 3, 3))
    axes[:, 0, 0] = axes[:, 1, 1] = np.cos(yaw)
    axes[:, 0, 1] = np.sin(yaw)
    axes[:, 1, 0] = -axes[:, 0, 1]
    axes[:, 2, 2] = 1.0
    linear, angular = (
        np.einsum("tij,tj->ti", axes, each) for each in (world.linear, world.angular)
    )
    inertia = axes @ world.inertia @ np.swapaxes(axes, 1, 2)
    return Momentum(world.com, linear, angular, inertia)


def _across(turn: Array, com: Array) -> Array:
    """ω × p in the plane (T, 2), for ω along z."""
    return turn[:, None] * np.column_stack([-com[:, 1], com[:, 0]])


def _rotated(vector: Array, yaw: Array) -> Array:
    cosine, sine = np.cos(yaw), np.sin(yaw)
    x, y = vector.T
    return np.column_stack([cosine * x - sine * y, sine * x + cosine * y])


def _central(values: Array, step: float) -> Array:
    """Central differences (T,), of second order at the ends too, as in ``derivatives``."""
    if len(values) < 3:
        return np.full(len(values), (values[-1] - values[0]) / step)
    rate: Array = np.gradient(values, step, edge_order=2)
    return rate


def _integrated(rate: Array, step: float) -> Array:
    """The path from zero whose central differences are ``rate`` (T,) or (T, n).

    Momentum is taken from central differences; a sum by trapezoids would come back damped,
    by 10 % at a tenth of the frame rate. Central differences alone do not tie even frames to
    odd ones, so the path also follows the trapezoids, with the small weight SMOOTHNESS: least
    squares, banded, linear in time.
    """
    frames = len(rate)
    if frames < 3:
        return np.cumsum(np.concatenate([0.0 * rate[:1], rate[1:]]), axis=0) * step
    # Bands of AᵀA, upper form: row 2 the diagonal, row 1 and 0 the first and second above it.
    bands = np.zeros((3, frames))
    right = np.zeros_like(rate)

    def add(rows: slice, offsets: dict[int, float], value: Array, weight: float) -> None:
        start, count = rows.start, rows.stop - rows.start
        for i, a in offsets.items():
            at = slice(start + i, start + i + count)
            right[at] += weight * a * value
            for j, b in offsets.items():
                if j >= i:
                    bands[2 - (j - i), start + j : start + j + count] += weight * a * b

    add(slice(0, frames - 2), {0: -0.5, 2: 0.5}, rate[1:-1], 1.0)
    add(slice(0, 1), {0: -1.5, 1: 2.0, 2: -0.5}, rate[:1], 1.0)
    add(slice(frames - 3, frames - 2), {0: 0.5, 1: -2.0, 2: 1.5}, rate[-1:], 1.0)
    middle = 0.5 * (rate[1:] + rate[:-1])
    add(slice(0, frames - 1), {0: -1.0, 1: 1.0}, middle, SMOOTHNESS)
    bands[2, 0] += 1.0  # starts at zero; costs nothing, for the rest is blind to a shift
    path: Array = step * solveh_banded(bands, right)
    return path
