"""What a clip's poses say about themselves: whether they stand on the floor, and stay there.

A body that is read as it was recorded has its lowest point on the floor most of the time, keeps
that point where it is while it stands on it, and its joints within their ranges. One that is read
wrongly (axes, quaternions, joints, units) loses at least one of these. Positions and rotations
alone are looked at, before any filter and without dynamics: what is compared are readings of one
clip, frame for frame the same.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.ground.undersides import Solid, bearing_solids, lowest_heights
from physretarget.mjcf import Character

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

# Instants that are looked at, and their rate: half a minute of a clip tells how it was read.
MOST_FRAMES = 900
PROBE_HZ = 30.0
# Of the lowest points a fifth may be in a landing or in a hole of the floor: the floor is there.
_FLOOR_QUANTILE = 0.2
_FASTEST_M_S = 20.0


@dataclass(frozen=True, eq=False)
class Evidence:
    """Of n instants, ``step`` s apart.

    Attributes:
        lowest: (n,) m above the floor of the lowest point of the geometry.
        body: (n,) the body that it belongs to.
        slip: (n - 1, 3) m that the lowest point moves until the next instant.
        carry: (n - 1, 3) m that the root's origin moves.
        beyond: (n,) rad by which a hinge is out of its range, on average.
        height: m of the centre of mass in the reference pose.
    """

    step: float
    lowest: Floats
    body: Ints
    slip: Floats
    carry: Floats
    beyond: Floats
    height: float

    @property
    def offset(self) -> float:
        """m above the floor of what stands, below 0 in it."""
        return float(np.quantile(self.lowest, _FLOOR_QUANTILE))

    @property
    def spread(self) -> float:
        """m by which the lowest point strays from where it stands, on average."""
        strays = np.minimum(np.abs(self.lowest - self.offset), self.height)
        return float(strays.mean())

    @property
    def restless(self) -> float:
        """The same badness if the whole clip were lifted or lowered to its floor."""
        return self.badness - min(abs(self.offset), self.height) / self.height

    @property
    def badness(self) -> float:
        """How little it reads as a body on a floor: 0 for a perfect one, several for nonsense.

        Slip in units of the speed of a fall from the height of the CoM, stray and offset in that
        height, joints in radians.
        """
        slipping = float(self._slipping.mean()) if len(self.slip) else 0.0
        sunk = min(abs(self.offset), self.height)
        return float(
            slipping
            + (self.spread + sunk) / self.height
            + float(np.minimum(self.beyond, 1.0).mean())
        )

    @property
    def _slipping(self) -> Floats:
        speed = np.linalg.norm(self.slip[:, :2], axis=1) / self.step
        shares: Floats = np.minimum(speed, _FASTEST_M_S) / np.sqrt(9.81 * self.height)
        return shares

    def bound(self, frames: int) -> float:
        """The least badness that ``frames`` instants can have of which these are some.

        Wherever they stand, stray and offset together are at least how far off the floor they are.
        """
        off = np.minimum(np.abs(self.lowest), self.height) / self.height
        alone = off + np.minimum(self.beyond, 1.0)
        return float(alone.sum() / frames + self._slipping.sum() / max(frames - 1, 1))


def probe(poses: Callable[[int, int], Floats], frames: int, fps: float) -> tuple[Floats, float]:
    """(n, nq) instants of the clip, at about 30 a second, and their step in s."""
    stride = max(1, round(fps / PROBE_HZ))
    last = min(frames, MOST_FRAMES * stride)
    return poses(0, last)[::stride], stride / fps


def evidence(
    character: Character, qpos: Floats, step: float, solids: Sequence[Solid] | None = None
) -> Evidence:
    """What these poses, ``step`` s apart, say; ``solids`` are the character's bearing ones."""
    pose = kinematics.forward(character.tree, qpos)
    solids = bearing_solids(character) if solids is None else solids
    lowest, body, local = _lowest_points(solids, pose)
    now, points = np.arange(len(qpos) - 1), (body[:-1], local[:-1])
    root = pose.position[:, character.root_body]
    return Evidence(
        step=step,
        lowest=lowest - character.floor_height,
        body=body,
        slip=_place(pose, now + 1, *points) - _place(pose, now, *points),
        carry=np.diff(root, axis=0),
        beyond=_beyond(character, qpos),
        height=max(character.com_height, 1e-3),
    )  # fmt: skip


def _place(pose: kinematics.Pose, frames: Ints, body: Ints, local: Floats) -> Floats:
    """(n, 3) world places of one point in each of some frames."""
    turned = np.einsum("tij,tj->ti", pose.rotation[frames, body], local)
    place: Floats = pose.position[frames, body] + turned
    return place


def _lowest_points(solids: Sequence[Solid], pose: kinematics.Pose) -> tuple[Floats, Ints, Floats]:
    """(n,) z of the lowest point, its body, and (n, 3) where it is in that body's frame."""
    frames = len(pose.position)
    lowest, owner = np.full(frames, np.inf), np.full(frames, -1)
    for k, height in enumerate(lowest_heights(solids, pose).T):
        lower = height < lowest
        lowest[lower], owner[lower] = height[lower], k
    body, local = np.zeros(frames, dtype=np.int64), np.zeros((frames, 3))
    for k in np.unique(owner[owner >= 0]).tolist():
        solid, mine = solids[k], owner == k
        up = pose.rotation[mine, solid.body, 2]
        along = (up @ solid.frame) * solid.axes
        size = np.linalg.norm(along, axis=1)
        below = (along * solid.axes / np.where(size > 0, size, 1.0)[:, None]) @ solid.frame.T
        which = (up @ solid.points.T).argmin(axis=1)
        body[mine], local[mine] = solid.body, (solid.points[which] - below)
    return lowest, body, local


def _beyond(character: Character, qpos: Floats) -> Floats:
    """(n,) rad by which limited joints are out of their ranges, on average over these joints."""
    limited = np.isfinite(character.lower) | np.isfinite(character.upper)
    if not limited.any():
        return np.zeros(len(qpos))
    over = np.maximum(character.lower - qpos, qpos - character.upper)[:, limited]
    mean: Floats = np.maximum(over, 0.0).mean(axis=1)
    return mean
