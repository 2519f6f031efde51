"""What the floor must supply: the wrench about the centre of mass, from the poses alone.

Newton's and Euler's laws for a whole body: the force from outside is the mass times the
acceleration of the centre of mass (CoM) less gravity, the moment about the CoM the rate of the
angular momentum.
Of samples at t - s, t and t + s the second difference of the CoM's path is *exactly* the force
averaged over that time with a hat for a weight, through impacts as well. The angular momentum
between two samples,

    L = sum_b m_b (r_b x r_b') / s + spin,    r_b from the CoM, r_b' a sample later,

differs from one pair of samples to the next by the moment, averaged in the same way, up to the
square of the angle that a body turns by between samples. Inverse dynamics of the sample in the
middle gives the same for smooth motion; at an impact it does not, since the rates there are means
of before and after, and their squares are not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.mjcf import Character

Floats = NDArray[np.float64]

# Angles between samples below which the sine is the angle, to rounding.
_SMALL = 1e-4


@dataclass(frozen=True, eq=False)
class Wrench:
    """Required of the surroundings: ``force`` (T, 3) BW and ``moment`` (T, 3) BW h about the CoM,
    in world axes; ``com`` (T, 3) m. BW is the body weight, h the CoM's height in the reference
    pose."""

    force: Floats
    moment: Floats
    com: Floats


def centre_of_mass(character: Character, pose: kinematics.Pose) -> Floats:
    """(T, 3) m."""
    bodies = list(character.bodies)
    mass = character.model.body_mass[bodies]
    offset = mass[:, None] * character.model.body_ipos[bodies]
    moments = mass @ pose.position[:, bodies]
    moments += np.einsum("tbij,bj->ti", pose.rotation[:, bodies], offset)
    com: Floats = moments / mass.sum()
    return com


def external_wrench(character: Character, pose: kinematics.Pose, step: float) -> Wrench:
    """The wrench of every frame of ``pose``, ``step`` seconds apart; at least three frames.

    The first and last frame have no second difference of their own and take the neighbour's.
    """
    model = character.model
    bodies = [b for b in character.bodies if model.body_mass[b] > 0]
    mass = model.body_mass[bodies][:, None]
    turn = pose.rotation.transpose(2, 3, 1, 0)[:, :, bodies]
    centre = pose.position.transpose(2, 1, 0)[:, bodies].copy()
    for axis in range(3):
        centre += turn[:, axis] * model.body_ipos[bodies, axis][:, None]
    com = (mass * centre).sum(axis=1) / mass.sum()
    away = centre - com[:, None]
    path = away[:, :, :-1], away[:, :, 1:]
    spin = (mass * _cross(*path)).sum(axis=1) + _spin(character, bodies, turn)
    weight = character.weight
    gravity = np.asarray(model.opt.gravity, dtype=np.float64)[:, None]
    height = max(character.com_height, 1e-3)
    pull = (com[:, 2:] - 2 * com[:, 1:-1] + com[:, :-2]) / step**2 - gravity
    force = _with_ends(pull * (character.mass / weight))
    moment = _with_ends(np.diff(spin, axis=1) / (step**2 * weight * height))
    return Wrench(force, moment, np.ascontiguousarray(com.T))


def _spin(character: Character, bodies: list[int], turn: Floats) -> Floats:
    """(3, T - 1) angular momentum of bodies about their own centres, times the step.

    A body is three pairs of points on its principal axes: sum j_p a_p x a_p', a sample later a',
    which is short by the sine of the angle between, over the angle.
    """
    model = character.model
    inertia = model.body_inertia[bodies]
    second = 0.5 * inertia.sum(axis=1, keepdims=True) - inertia
    total = np.zeros((3, len(bodies), turn.shape[-1] - 1))
    trace = np.zeros(total.shape[1:])
    frame = kinematics.quat_to_matrix(np.array(model.body_iquat[bodies]))
    for p in range(3):
        axis = np.einsum("icbt,bc->ibt", turn, frame[..., p])
        before, after = axis[:, :, :-1], axis[:, :, 1:]
        total += second[:, p][:, None] * _cross(before, after)
        trace += (before * after).sum(axis=0)
    angle = np.arccos(np.clip(0.5 * (trace - 1), -1.0, 1.0))
    sine = np.sin(angle)
    fair = (angle > _SMALL) & (sine > _SMALL)
    stretched = np.where(fair, angle / np.where(fair, sine, 1.0), 1.0)
    spin: Floats = (total * stretched).sum(axis=1)
    return spin


def _cross(left: Floats, right: Floats) -> Floats:
    """Cross products of the first axis of (3, ...) and (3, ...)."""
    out = np.empty_like(left)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[i] = left[j] * right[k]
        out[i] -= left[k] * right[j]
    return out


def _with_ends(inner: Floats) -> Floats:
    """(T, 3) of (3, T - 2)."""
    whole: Floats = np.concatenate([inner[:, :1], inner, inner[:, -1:]], axis=1).T
    return np.ascontiguousarray(whole)
