"""What it takes to lead a pose's momentum elsewhere: the cheapest change of its joints.

The change δq of a pose costs ½ δqᵀ K δq: the mean square displacement of the markers, over the
height squared, with contact points held and joints kept. Among all changes with an excursion
u = A δq the cheapest is δq = K⁻¹ Aᵀ Q u and costs ½ uᵀ Q u, Q = (A K⁻¹ Aᵀ)⁻¹.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.balance.centroidal import centroidal
from physretarget.balance.hold import Hold
from physretarget.balance.settings import BalanceSettings
from physretarget.contact.carry import joint_weights
from physretarget.mjcf import Character

Array = NDArray[np.float64]

CHUNK = 256
"""Frames worked on at once."""


@dataclass(frozen=True, eq=False)
class Metric:
    """``matrix`` A (T, 6, nv) of excursions, ``cost`` Q (T, 6, 6), ``change`` (T, nv, 6) by
    which u becomes δq, and the centre of mass ``com`` (T, 3), m."""

    matrix: Array
    cost: Array
    change: Array
    com: Array


def scale(character: Character) -> Array:
    """(6,) momentum over this is an excursion's rate: m h, and m h² for the angular part."""
    h = character.com_height
    return character.mass * np.array([h, h, h, h * h, h * h, h * h])


def metric(
    character: Character,
    qpos: Array,
    hold: Hold,
    stops: Array,
    frames: slice,
    settings: BalanceSettings,
) -> Metric:
    """The metric of some ``frames`` of a clip qpos (T, nq).

    ``stops`` (T, nv) are further weights of joints, against 1 for a marker.
    """
    parts = [
        _chunk(character, qpos, hold, stops, slice(at, min(at + CHUNK, frames.stop)), settings)
        for at in range(frames.start, frames.stop, CHUNK)
    ]
    return Metric(
        matrix=np.concatenate([part.matrix for part in parts]),
        cost=np.concatenate([part.cost for part in parts]),
        change=np.concatenate([part.change for part in parts]),
        com=np.concatenate([part.com for part in parts]),
    )


def _chunk(
    character: Character,
    qpos: Array,
    hold: Hold,
    stops: Array,
    part: slice,
    settings: BalanceSettings,
) -> Metric:
    poses, markers = qpos[part], character.markers
    pose = kinematics.forward(character.tree, poses)
    matrix, com = centroidal(character, poses, pose)
    matrix = matrix / scale(character)[:, None]
    body = np.concatenate([markers.body, hold.body])
    local = np.concatenate([markers.local, hold.local])
    weight = np.concatenate([np.ones((len(poses), len(markers))), hold.weight[part]], axis=1)
    stiffness = kinematics.stiffness(character.tree, poses, pose, body, local, weight)
    diagonal = np.einsum("tii->ti", stiffness)
    diagonal += joint_weights(character, settings.joint) + stops[part]
    diagonal += 1e-9 * diagonal.max(axis=1, keepdims=True)
    stiffness /= len(markers) * character.height**2
    yielding = np.linalg.solve(stiffness, np.swapaxes(matrix, 1, 2))  # K⁻¹ Aᵀ
    free = matrix @ yielding
    # A direction in which nothing can move (planted and stiff) is dear, not impossible.
    free += 1e-5 * np.einsum("tii->t", free)[:, None, None] * np.eye(6)
    cost = np.linalg.inv(free)
    cost = 0.5 * (cost + np.swapaxes(cost, 1, 2))
    return Metric(matrix, cost, yielding @ cost, com)
