"""Exact derivatives of the wrench that poses require of the floor.

:func:`physretarget.ground.wrench.external_wrench` makes it of three poses: the force from the
second difference of the centre of mass (CoM), the moment from the difference of two angular momenta

    s L = Σ m (x × x'),    x a body's centre, from the CoM, and points on its principal axes,

x' a sample later. A change δq of the first pose moves x by J δq: s δL = Σ m (J δq × x'), and so for
the second. Sums over what a degree of freedom carries give all of it. The angular momenta need no
velocity, and so the derivatives hold for steps of any size between frames.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.mjcf import Character

Array = NDArray[np.float64]

_SMALL = 1e-4
"""rad between frames below which a body's turn leaves its length as it is, to rounding."""


@dataclass(frozen=True, eq=False)
class WrenchSlopes:
    """How changes of poses (rad, m) change the required wrench about the CoM, BW and BW h.

    ``behind``, ``here``, ``ahead`` (T - 2, 6, nv): that of frame t by the poses t - 1, t and t + 1;
    ``shift`` (T, 3, nv) of the CoM, over its height h.
    """

    behind: Array
    here: Array
    ahead: Array
    shift: Array


def cross(a: Array, b: Array) -> Array:
    """Cross product over the last axis; np.cross costs several times as much."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    out[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    out[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return out


def wrench_slopes(
    character: Character, qpos: Array, pose: kinematics.Pose, step: float
) -> WrenchSlopes:
    """The slopes at poses qpos (T, nq), ``step`` seconds apart; ``pose`` is theirs."""
    tree, bodies, model = character.tree, character.bodies, character.model
    mass = np.array(model.body_mass)[bodies]
    centre = kinematics.points(pose, bodies, np.array(model.body_ipos)[bodies])
    com = np.einsum("b,tbi->ti", mass, centre) / mass.sum()
    arm = centre - com[:, None]
    angular, anchor, linear = kinematics.screws(tree, pose, qpos)
    linear = linear + cross(anchor - com[:, None], angular)  # velocity at the CoM
    carried = tree.carries[np.ix_(tree.dof_body, bodies)].astype(np.float64)
    moment = carried @ (mass[:, None] * arm)  # (T, nv, 3)
    weight = (carried @ mass)[:, None]
    height = character.com_height
    shift = (weight * linear + cross(angular, moment)) / (mass.sum() * height)

    first, second = _turning(character, pose, arm, mass)
    total = (carried @ np.stack([first, second]).reshape(2, len(first), len(bodies), 9)).reshape(
        2, len(first), tree.nv, 3, 3
    )
    by_first = cross(linear[:-1], moment[1:])
    by_first += (total[0] @ angular[:-1, :, :, None])[..., 0]
    by_second = -cross(linear[1:], moment[:-1])
    by_second += (total[1] @ angular[1:, :, :, None])[..., 0]
    unit = 1.0 / (step**2 * character.weight * height)
    by_first, by_second = unit * by_first, unit * by_second
    pull = character.mass * height / (step**2 * character.weight) * shift
    return WrenchSlopes(
        behind=_rows(pull[:-2], -by_first[:-1]),
        here=_rows(-2.0 * pull[1:-1], by_first[1:] - by_second[:-1]),
        ahead=_rows(pull[2:], by_second[1:]),
        shift=np.ascontiguousarray(shift.swapaxes(1, 2)),
    )


def _turning(
    character: Character, pose: kinematics.Pose, arm: Array, mass: Array
) -> tuple[Array, Array]:
    """(T - 1, B, 3, 3) twice: what small turns of each body about the CoM, in the earlier and in
    the later pose, do to the step times its angular momentum."""
    model, bodies = character.model, character.bodies
    frame = kinematics.quat_to_matrix(np.array(model.body_iquat)[bodies])
    axes = pose.rotation[:, bodies] @ frame
    inertia = np.array(model.body_inertia)[bodies]
    spread = 0.5 * inertia.sum(axis=1, keepdims=True) - inertia  # (B, 3) along each axis
    before, after = axes[:-1], axes[1:]
    # Columns are axes: Σ j a a'ᵀ.
    outer = (spread[:, None, :] * before) @ after.swapaxes(-1, -2)
    stretch, bend, about = _stretch(before, after)
    spun = _axial(outer)
    outer = stretch[..., None, None] * outer
    outer = outer + mass[:, None, None] * arm[:-1, :, :, None] * arm[1:, :, None, :]
    trace = np.einsum("tbii->tb", outer)[..., None, None] * np.eye(3)
    grown = bend[..., None, None] * spun[..., :, None] * about[..., None, :]
    return outer - trace - grown, trace - outer.swapaxes(-1, -2) + grown


def _axial(outer: Array) -> Array:
    """Σ a × a' of Σ a a'ᵀ."""
    found: Array = np.stack(
        [
            outer[..., 1, 2] - outer[..., 2, 1],
            outer[..., 2, 0] - outer[..., 0, 2],
            outer[..., 0, 1] - outer[..., 1, 0],
        ],
        axis=-1,
    )
    return found


def _stretch(before: Array, after: Array) -> tuple[Array, Array, Array]:
    """(T, B) the angle between frames over its sine, that by the angle, and the axis (T, B, 3)."""
    turn = after @ before.swapaxes(-1, -2)
    twice = np.stack(
        [
            turn[..., 2, 1] - turn[..., 1, 2],
            turn[..., 0, 2] - turn[..., 2, 0],
            turn[..., 1, 0] - turn[..., 0, 1],
        ],
        axis=-1,
    )
    cosine = np.clip(0.5 * (np.einsum("tbii->tb", turn) - 1.0), -1.0, 1.0)
    angle, sine = np.arccos(cosine), np.sqrt(1.0 - cosine**2)
    fair = (angle > _SMALL) & (sine > _SMALL)
    safe = np.where(fair, sine, 1.0)
    stretch = np.where(fair, angle / safe, 1.0)
    bend = np.where(fair, (sine - angle * cosine) / safe**2, 0.0)
    return stretch, bend, twice / (2.0 * safe[..., None])


def _rows(force: Array, moment: Array) -> Array:
    """(T, 6, nv) of (T, nv, 3) twice."""
    return np.concatenate([force, moment], axis=-1).swapaxes(1, 2)
