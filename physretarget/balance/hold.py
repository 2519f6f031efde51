"""What must stay where it is: contact points, and the rest of the soles that they stand for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from physretarget import kinematics
from physretarget.balance.settings import BalanceSettings
from physretarget.ground.undersides import solids
from physretarget.mjcf import Character

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Ints = NDArray[np.int64]

CHUNK = 1024
"""Frames worked on at once: memory beyond the clip itself does not grow with its length."""
_LEVEL = 0.005
"""Of a sole's underside, what is this near to its contact points' level (of the height)."""
_APART = 1e-3
"""What is nearer to a contact point (m) is held by it."""


@dataclass(frozen=True, eq=False)
class Hold:
    """Points of bodies, where the clip has them and how firmly they are kept there.

    ``body`` (H,), ``local`` (H, 3), ``place`` (T, H, 3) m, ``weight`` (T, H) against 1 for a
    marker, ``firm`` (T, H) those that stand on the floor.
    """

    body: Ints
    local: Array
    place: Array
    weight: Array
    firm: Flags


def held(
    character: Character, qpos: Array, active: Flags, step: float, settings: BalanceSettings
) -> Hold:
    """The points to hold of a clip qpos (T, nq) whose contact points ``active`` (T, P) stand."""
    contacts = character.contacts
    flank_body, flank_local = _flanks(character)
    body = np.concatenate([contacts.body, flank_body])
    local = np.concatenate([contacts.local, flank_local])
    place = kinematics.trajectories(character.tree, qpos, body, local)
    own = np.array([contacts.body == b for b in flank_body], dtype=bool).reshape(-1, len(contacts))
    firm = np.concatenate([active, (active.astype(float) @ own.T) > 1.5], axis=1)
    height = (place[..., 2] - character.floor_height) / character.height
    count = np.array([(flank_body == b).sum() for b in flank_body])
    share = np.concatenate([np.ones(len(contacts)), settings.flank / np.maximum(count, 1)])
    weight = share * _firmness(firm, height, step, settings)
    return Hold(body, local, place, weight, firm)


def _firmness(firm: Flags, height: Array, step: float, settings: BalanceSettings) -> Array:
    """(T, H) from ``flight`` to ``stance``, smoothly in time."""
    away = np.full(firm.shape, np.inf)
    for k in np.flatnonzero(firm.any(axis=0)):
        away[:, k] = distance_transform_edt(~firm[:, k]) * step if not firm[:, k].all() else 0.0
    near = np.exp(-((away / settings.fade) ** 2))
    near = np.maximum(near, np.exp(-((np.maximum(height, 0.0) / settings.low) ** 2)))
    weight: Array = settings.flight ** (1.0 - near) * settings.stance**near
    return weight


def _flanks(character: Character) -> tuple[Ints, Array]:
    """Bodies (M,) and points (M, 3) of undersides that reach down to their contact points.

    Two points hold a sole along a line, about which it could still roll into the floor.
    """
    pose = kinematics.forward(character.tree, character.reference_qpos[None])
    bodies: list[int] = []
    found: list[Array] = []
    for body in np.unique(character.contacts.body):
        mine = character.contacts.local[character.contacts.body == body]
        if len(mine) != 2:
            continue
        up = pose.rotation[0, body, 2]
        for solid in solids(character, [int(body)]):
            under = solid.undersides(up)
            low = (under - mine[0]) @ up < _LEVEL * character.height
            apart = np.linalg.norm(under[:, None] - mine, axis=-1).min(axis=1) > _APART
            found.append(under[low & apart])
            bodies += [int(body)] * int((low & apart).sum())
    return np.array(bodies, dtype=np.int64), np.concatenate([*found, np.zeros((0, 3))])
