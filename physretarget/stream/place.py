"""Heading and place of the character, frame by frame (Yamane 2010, section 5.1).

Linear momentum is mass times the velocity of the centre of mass: following the actor's scaled
momentum means moving the centre of mass by the actor's way, scaled. No derivative is needed.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from physretarget.features import INVERTED_COSINE
from physretarget.stream.turns import turned

__all__ = ["Heading", "Placer"]

Array = NDArray[np.float64]


class Heading:
    """The heading of a root, rad, continuous; defined as in :mod:`physretarget.features`.

    While the body is upside down the heading follows its rotation about the vertical; the
    batch path also spreads what then remains over those frames, which needs to know the end.
    """

    def __init__(self, front: Array, up: Array) -> None:
        self.up = up / np.linalg.norm(up)
        forward = front - (front @ self.up) * self.up
        self.front = forward / np.linalg.norm(forward)
        self.yaw: float | None = None
        self.before = np.eye(3)

    def next(self, rotation: Array) -> float:
        """Of the root's rotation (3, 3)."""
        f, u = rotation @ self.front, rotation @ self.up
        if u[2] < INVERTED_COSINE and self.yaw is not None:
            turn = rotation @ self.before.T
            self.yaw += 0.5 * math.atan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1]) * 2.0
        else:
            share = f[2] / max(1.0 + u[2], 1e-9)
            raw = math.atan2(f[1] - share * u[1], f[0] - share * u[0])
            last = self.yaw if self.yaw is not None else raw
            self.yaw = last + math.remainder(raw - last, 2.0 * math.pi)
        self.before = np.array(rotation)
        return self.yaw


class Placer:
    """Where the character's root goes; starts at the origin."""

    def __init__(self, size: Array) -> None:
        """``size`` (3,): scale of speeds along the heading's axes, s_d of the paper."""
        self.size = size
        self.com: Array | None = None
        self.actor: Array | None = None
        self.yaw = 0.0

    def next(self, yaw: float, actor_com: Array, local_com: Array) -> Array:
        """The root's x, y (2,).

        ``actor_com`` (3,) in the world; ``local_com`` (3,) of the character with its root over
        the origin and heading zero.
        """
        own = turned(local_com[:2], yaw)
        if self.com is None or self.actor is None:
            self.com = own
        else:
            middle = 0.5 * (yaw + self.yaw)
            way = turned((actor_com - self.actor)[:2], -middle) * self.size[:2]
            self.com = self.com + turned(way, middle)
        self.actor, self.yaw = np.array(actor_com), yaw
        result: Array = self.com - own
        return result
