"""How far what stands on the floor reaches: the edge over which a body tips."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from physretarget.ground.undersides import Solid
from physretarget.kinematics import Pose

__all__ = ["support_edge"]

Floats = NDArray[np.float64]

# Directions along which the edge of the support is looked for: a circle's edge is exact in each,
# and within 0.1 % of its radius between.
_DIRECTIONS = 72
# A rim's outermost point is its lowest when it is tilted this little.
_TILT = 1e-3


def support_edge(
    every: Sequence[Solid], pose: Pose, floor: float, tolerance: float
) -> tuple[Floats, Floats]:
    """(n, 2) directions, and how far what touches reaches along each, m from the origin.

    Args:
        every: what may stand.
        pose: of one frame.
        floor: its height, m.
        tolerance: what is this near to it touches, m.

    Returns:
        Directions, and reaches (n,): -inf where nothing touches.
    """
    angle = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    way = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    reach = np.full(_DIRECTIONS, -np.inf)
    for solid in every:
        low = solid.heights(pose)[0] <= floor + tolerance
        if low.any():
            reach = np.maximum(reach, _reach(solid, pose, low, way))
    return way, reach


def _reach(solid: Solid, pose: Pose, low: NDArray[np.bool_], way: Floats) -> Floats:
    """(n,) m along each direction of the points of a geom that are ``low``."""
    turn, place = pose.rotation[0, solid.body], pose.position[0, solid.body]
    points = place + solid.points[low] @ turn.T
    along = np.hstack([_TILT * way, -np.ones((len(way), 1))]) @ turn @ solid.frame
    size = np.linalg.norm(along * solid.axes, axis=1)
    grown = along * solid.axes**2 / np.where(size > 0, size, 1.0)[:, None]
    outermost = grown @ solid.frame.T @ turn.T
    reach: Floats = (points[:, :2] @ way.T).max(axis=0) + (outermost[:, :2] * way).sum(axis=1)
    return reach
