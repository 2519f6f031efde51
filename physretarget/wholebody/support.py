"""What stands: which contact points hold still, where the floor may push, and what it explains."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, distance_transform_edt

from physretarget import kinematics
from physretarget.ground.cones import fit_forces
from physretarget.ground.contacts import contact_tolerance, find_contacts
from physretarget.ground.undersides import Undersides, undersides
from physretarget.mjcf import Character
from physretarget.wholebody.settings import WholeBodySettings

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Ints = NDArray[np.int64]

PRICE_OF_FORCE = 1e-3
"""Half of this times a force's square (BW²) is added to half the squared residual: it makes forces
unique, and leaves a residual of 1e-3 where none need be."""
PRICE_OF_ABSENCE = 0.1
"""The same for what stood a moment ago or will stand: it is asked where the others do not do."""
_ALONG_A_LINE = 1e-6
_MOST = 8
"""Points that stand for all of a body's that touch, see :mod:`physretarget.ground.contacts`."""
CHUNK = 1024
"""Frames whose poses are held at once: memory does not grow with the clip."""


@dataclass(frozen=True, eq=False)
class Support:
    """Where the floor may push: ``place`` (T, n, 3) m, ``on`` (T, n), ``price`` (T, n) of force,
    and the ``friction`` that is used."""

    place: Array
    on: Flags
    price: Array
    friction: float

    def of(self, frames: slice) -> Support:
        """The same for some of the frames."""
        return Support(self.place[frames], self.on[frames], self.price[frames], self.friction)


def completed_stances(character: Character, active: Flags) -> Flags:
    """Contact points that stand, (T, P), with those that stand because their body does.

    Three points that do not lie on a line hold a rigid body: where they stand, all others of that
    body do.
    """
    whole = active.copy()
    for body in np.unique(character.contacts.body):
        own = np.flatnonzero(character.contacts.body == body)
        local = character.contacts.local[own]
        for flags in np.unique(active[:, own], axis=0):
            spread = (
                local[flags] - local[flags].mean(axis=0) if flags.sum() > 2 else np.zeros((1, 3))
            )
            if np.linalg.svd(spread, compute_uv=False)[1:2].sum() > _ALONG_A_LINE:
                whole[np.ix_(np.all(active[:, own] == flags, axis=1), own)] = True
    return whole


def firmness(stands: Flags, height: Array, step: float, settings: WholeBodySettings) -> Array:
    """(T, P) weight of contact points, from ``flight`` to ``stance``, smoothly in time.

    ``height`` (T, P) above the floor over the character's; ``step`` s from frame to frame.
    """
    away = np.full(stands.shape, np.inf)
    for k in np.flatnonzero(stands.any(axis=0)):
        away[:, k] = distance_transform_edt(~stands[:, k]) * step if not stands[:, k].all() else 0.0
    near = np.exp(-((away / settings.fade) ** 2))
    near = np.maximum(near, np.exp(-((np.maximum(height, 0.0) / settings.low) ** 2)))
    weight: Array = settings.flight ** (1.0 - near) * settings.stance**near
    return weight


def support_of(
    character: Character, qpos: Array, stands: Flags, settings: WholeBodySettings
) -> Support:
    """Where the floor may push on the bodies that stand in a clip qpos (T, nq).

    All of a body's geometry that touches bears load while one of its contact points ``stands``
    (T, P), and ``reach`` frames before and after, where it stood last or will stand; where none
    touches, the contact points themselves do. Drawn in towards the middle by ``inset``.
    """
    points = undersides(character)
    bodies = np.unique(character.contacts.body)
    held = np.stack([stands[:, character.contacts.body == b].any(axis=1) for b in bodies], axis=1)
    parts = [
        _touching(character, points, qpos[at : at + CHUNK], stands[at : at + CHUNK], bodies)
        for at in range(0, len(qpos), CHUNK)
    ]
    place = np.concatenate([part[0] for part in parts])  # (T, B, n, 3)
    on = np.concatenate([part[1] for part in parts]) & held[..., None]
    for k in np.flatnonzero(held.any(axis=0)):
        nearest = distance_transform_edt(~held[:, k], return_distances=False, return_indices=True)[
            0
        ]
        near = binary_dilation(held[:, k], np.ones(2 * settings.reach + 1, dtype=bool))
        place[near, k], on[near, k] = place[nearest[near], k], on[nearest[near], k]
    there, may = place.reshape(len(qpos), -1, 3), on.reshape(len(qpos), -1)
    count = np.maximum(may.sum(axis=1), 1)[:, None]
    middle = np.where(may[..., None], there, 0.0).sum(axis=1) / count
    there = there + settings.inset * (middle[:, None] - there)
    used = np.flatnonzero(may.any(axis=0))
    price = np.where(np.repeat(held, on.shape[2], axis=1), PRICE_OF_FORCE, PRICE_OF_ABSENCE)
    return Support(
        there[:, used], may[:, used], price[:, used], settings.friction * character.friction
    )


def _touching(
    character: Character, points: Undersides, qpos: Array, stands: Flags, bodies: Ints
) -> tuple[Array, Flags]:
    """(T, B, n, 3) outermost touching points of ``bodies`` (B,), and (T, B, n) which exist."""
    pose = kinematics.forward(character.tree, qpos)
    tolerance = contact_tolerance(character.com_height)
    found = find_contacts(points, pose, character.floor_height, tolerance)
    declared = kinematics.points(pose, character.contacts.body, character.contacts.local)
    size = max(_MOST, *(int((character.contacts.body == b).sum()) for b in bodies))
    place = np.zeros((len(qpos), len(bodies), size, 3))
    on = np.zeros(place.shape[:3], dtype=bool)
    for k, body in enumerate(bodies):
        mine = found.outer & (found.body == body)
        first = np.argsort(~mine, axis=1, kind="stable")[:, :size]
        width = first.shape[1]
        place[:, k, :width] = np.take_along_axis(found.position, first[..., None], axis=1)
        on[:, k, :width] = np.take_along_axis(mine, first, axis=1)
        own = np.flatnonzero(character.contacts.body == body)
        bare = ~on[:, k].any(axis=1)
        place[bare, k, : len(own)] = declared[bare][:, own]
        on[bare, k, : len(own)] = stands[bare][:, own]
    return place, on


def residual(support: Support, com: Array, wrench: Array, height: float) -> tuple[Array, Array]:
    """What no force at the support explains of a wrench (T, 6) about ``com`` (T, 3).

    Wrench in BW and BW ``height``. Returns y (T, 6) and its derivative by the wrench V (T, 6, 6):
    both of the least of ½ |y|² + ½ PRICE |f|².
    """
    arm = (support.place - com[:, None]) / height
    fit = fit_forces(
        arm, support.on, wrench, friction=support.friction, rho=support.price, curvature=True
    )
    assert fit.curvature is not None
    return fit.gradient, fit.curvature
