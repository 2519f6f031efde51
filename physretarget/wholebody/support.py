"""What stands: which contact points hold still, where the floor may push, and what it explains."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, distance_transform_edt

from physretarget.ground.cones import fit_forces
from physretarget.mjcf import Character
from physretarget.wholebody.settings import WholeBodySettings

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

PRICE_OF_FORCE = 1e-3
"""Half of this times a force's square (BW²) is added to half the squared residual: it makes forces
unique, and leaves a residual of 1e-3 where none need be."""
_ALONG_A_LINE = 1e-6


@dataclass(frozen=True, eq=False)
class Support:
    """Where the floor may push: ``place`` (T, P, 3) m, ``on`` (T, P), ``friction`` that is used."""

    place: Array
    on: Flags
    friction: float

    def of(self, frames: slice) -> Support:
        """The same for some of the frames."""
        return Support(self.place[frames], self.on[frames], self.friction)


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
    character: Character, stands: Flags, place: Array, settings: WholeBodySettings
) -> Support:
    """The support of contact points that stand, (T, P), at ``place`` (T, P, 3).

    Drawn in towards its middle by ``inset``; a contact bears load ``reach`` frames before and
    after, where it stood last or will stand.
    """
    there = place.copy()
    for k in np.flatnonzero(stands.any(axis=0)):
        nearest = distance_transform_edt(
            ~stands[:, k], return_distances=False, return_indices=True
        )[0]
        there[:, k] = place[nearest, k]
    on = binary_dilation(stands, np.ones((2 * settings.reach + 1, 1), dtype=bool))
    count = np.maximum(on.sum(axis=1), 1)[:, None]
    middle = np.where(on[..., None], there, 0.0).sum(axis=1) / count
    there += settings.inset * (middle[:, None] - there)
    return Support(there, on, settings.friction * character.friction)


def residual(support: Support, com: Array, wrench: Array, height: float) -> tuple[Array, Array]:
    """What no force at the support explains of a wrench (T, 6) about ``com`` (T, 3).

    Wrench in BW and BW ``height``. Returns y (T, 6) and its derivative by the wrench V (T, 6, 6):
    both of the least of ½ |y|² + ½ PRICE |f|².
    """
    arm = (support.place - com[:, None]) / height
    fit = fit_forces(
        arm, support.on, wrench, friction=support.friction, rho=PRICE_OF_FORCE, curvature=True
    )
    assert fit.curvature is not None
    return fit.gradient, fit.curvature
