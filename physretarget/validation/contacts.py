"""Which points touch the floor, and how far a centre of pressure lies outside them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget.kinematics import Pose
from physretarget.validation.geometry import Candidates, lowest_heights, lowest_points

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]
Series = dict[str, NDArray[np.generic]]

# A swing foot this deep in the floor is still said to be clear of it: rounding and a filter's
# bends. Deeper it touches, whatever is said: one end of a rigid base may be said to stand a frame
# before the other, while the impact of a landing needs both.
SAID_CLEAR_M = 0.001
# Of many touching points of one body the outermost in these horizontal directions stand for
# all: any box keeps its corners, any hull the octagon that fits it.
_DIRECTIONS = 8
_ANGLES = (np.arange(_DIRECTIONS) + 0.25) * 2 * np.pi / _DIRECTIONS
_COMPASS = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)])


@dataclass(frozen=True, eq=False)
class Touch:
    """Touching points of T frames: position (T, n, 3) world m, body (T, n), mask (T, n).

    ``lowest`` (T,) m above the floor and its body; ``clearance`` (T,) m by which no point
    touches, below 0 where one does; ``bodies`` (B,) that may touch and ``on`` (T, B) which of
    them do. ``tolerance`` m is how near that is.
    """

    position: Floats
    body: Ints
    mask: Bools
    lowest: Floats
    lowest_body: Ints
    clearance: Floats
    bodies: Ints
    on: Bools
    floor: float
    tolerance: float = 0.01

    def series(self, frames: slice) -> Series:
        """The results that are kept, of some frames."""
        return {
            "lowest": self.lowest[frames],
            "lowest_body": self.lowest_body[frames],
            "clearance": self.clearance[frames],
            "touching": self.mask[frames].sum(axis=1),
            "touch": self.on[frames],
        }


def find_touch(
    points: Candidates,
    pose: Pose,
    floor: float,
    tolerance: float,
    declared: Bools | None = None,
) -> Touch:
    """Points within ``tolerance`` (m) of the floor, at most eight for every body.

    Where contacts are ``declared`` (T, K), a point that is said not to stand touches only where
    it is plainly in the floor: the tolerance is for not knowing.
    """
    frames = len(pose.position)
    clearance = np.full(frames, np.inf)
    bodies = points.bodies
    lowest, lowest_body = np.full(frames, np.inf), np.zeros(frames, dtype=np.int64)
    on = np.zeros((frames, len(bodies)), dtype=bool)
    picked: list[tuple[Floats, Bools, int]] = []
    matters = _can_matter(points, pose, floor, tolerance)
    for index, body in enumerate(bodies):
        rows = np.flatnonzero(matters[:, index])
        if len(rows) == 0:
            continue
        own = of_body(points, int(body))
        height = lowest_heights(_rows(pose, rows), own) - floor
        low = height.min(axis=1)
        under = low < lowest[rows]
        lowest_body[rows[under]] = body
        lowest[rows] = np.minimum(low, lowest[rows])
        gap = height - tolerance
        if declared is not None:
            stands = declared[np.ix_(rows, points.body == body)]
            gap = np.where(stands, gap, height + SAID_CLEAR_M)
        least = gap.min(axis=1)
        clearance[rows] = np.minimum(least, clearance[rows])
        touching = least < 0
        if touching.any():
            on[rows[touching], index] = True
            near = gap[touching] < 0
            place, mask = _outermost(lowest_points(_rows(pose, rows[touching]), own), near)
            picked.append((*_spread(place, mask, rows[touching], frames), int(body)))
    position, mask, owner = _packed(picked, frames)
    return Touch(
        position, owner, mask, lowest, lowest_body, clearance, bodies, on, floor, tolerance
    )


def lowest(points: Candidates, pose: Pose, floor: float) -> tuple[Floats, Ints]:
    """(T,) height of the lowest point above the floor (m), and its body."""
    height = np.full(len(pose.position), np.inf)
    owner = np.zeros(len(height), dtype=np.int64)
    matters = _can_matter(points, pose, floor, -np.inf)
    for index, body in enumerate(points.bodies):
        rows = np.flatnonzero(matters[:, index])
        if len(rows) == 0:
            continue
        low = lowest_heights(_rows(pose, rows), of_body(points, int(body))).min(axis=1) - floor
        under = rows[low < height[rows]]
        owner[under] = body
        height[rows] = np.minimum(low, height[rows])
    return height, owner


def _rows(pose: Pose, rows: Ints) -> Pose:
    return (
        pose if len(rows) == len(pose.position) else Pose(pose.position[rows], pose.rotation[rows])
    )


def _spread(place: Floats, mask: Bools, rows: Ints, frames: int) -> tuple[Floats, Bools]:
    """Points of some frames among all frames."""
    everywhere = np.zeros((frames, *place.shape[1:]))
    there = np.zeros((frames, mask.shape[1]), dtype=bool)
    everywhere[rows], there[rows] = place, mask
    return everywhere, there


def _can_matter(points: Candidates, pose: Pose, floor: float, tolerance: float) -> Bools:
    """(T, B) whether a body may touch or be the lowest, by its bounding sphere."""
    reach = np.linalg.norm(points.local, axis=1) + points.radius + points.axes.max(axis=1)
    bounds = np.array([reach[points.body == b].max() for b in points.bodies])
    height = pose.position[:, points.bodies, 2] - floor
    ceiling = np.maximum((height + bounds).min(axis=1), tolerance)
    can: Bools = (height - bounds) <= ceiling[:, None]
    return can


def of_body(points: Candidates, body: int) -> Candidates:
    """The candidates of one body."""
    rows = points.body == body
    return Candidates(
        points.body[rows], points.local[rows], points.radius[rows], points.axes[rows],
        points.frame[rows], points.source,
    )  # fmt: skip


def _outermost(place: Floats, near: Bools) -> tuple[Floats, Bools]:
    """(T, <=8, 3) points and mask: all of a few points, the outermost of many."""
    if place.shape[1] <= _DIRECTIONS:
        return place, near
    along = np.where(near[..., None], place[..., :2] @ _COMPASS, -np.inf)
    best = along.argmax(axis=1)
    rows = np.arange(len(place))[:, None]
    chosen = np.zeros_like(near)
    chosen[rows, best] = near[rows, best]
    order = np.argsort(~chosen, axis=1, kind="stable")[:, :_DIRECTIONS]
    return place[rows, order], chosen[rows, order]


def _packed(picked: list[tuple[Floats, Bools, int]], frames: int) -> tuple[Floats, Bools, Ints]:
    """Touching points of all bodies, moved to the front of each frame's row."""
    if not picked:
        empty = np.zeros((frames, 0), dtype=np.int64)
        return np.zeros((frames, 0, 3)), empty.astype(bool), empty
    place = np.concatenate([p for p, _, _ in picked], axis=1)
    near = np.concatenate([m for _, m, _ in picked], axis=1)
    owner = np.concatenate([np.full(m.shape[1], b) for _, m, b in picked])
    width = int(near.sum(axis=1).max())
    order = np.argsort(~near, axis=1, kind="stable")[:, :width]
    rows = np.arange(frames)[:, None]
    return place[rows, order], near[rows, order], owner[order]


def cop_outside(points: Floats, mask: Bools, force: Floats, moment: Floats) -> Floats:
    """(T,) m that the required centre of pressure lies outside the supporting points' hull.

    ``points`` (T, n, 3) m and ``moment`` (T, 3) BW m are about the CoM; the pressure is looked
    for at the lowest point's height. NaN where nothing supports or less than a fifth of body
    weight is to be borne; 0 inside.
    """
    judged = (force[:, 2] > 0.2) & mask.any(axis=1)
    outside = np.full(len(force), np.nan)
    if not judged.any():
        return outside
    f, m, own = force[judged], moment[judged], mask[judged]
    drop = np.where(own, points[judged][..., 2], np.inf).min(axis=1)
    x = (drop * f[:, 0] - m[:, 1]) / f[:, 2]
    y = (m[:, 0] + drop * f[:, 1]) / f[:, 2]
    outside[judged] = hull_distance(np.c_[x, y], points[judged][..., :2], own)
    return outside


def hull_distance(point: Floats, corners: Floats, mask: Bools) -> Floats:
    """(T,) distance of a point (T, 2) from the convex hull of corners (T, n, 2); 0 inside.

    Outside, all corners are seen within half a turn; the nearest point then lies on a segment
    between two of them (or on the only one).
    """
    seen = corners - point[:, None]
    angle = np.where(mask, np.arctan2(seen[..., 1], seen[..., 0]), np.inf)
    angle.sort(axis=1)
    last = np.take_along_axis(angle, mask.sum(axis=1)[:, None] - 1, axis=1)
    gaps = np.diff(np.where(np.isfinite(angle), angle, last), axis=1)
    around = angle[:, 0] + 2 * np.pi - last[:, 0]
    widest = np.maximum(gaps.max(axis=1, initial=0.0), around)
    distance = np.zeros(len(point))
    outside = np.flatnonzero(widest > np.pi)
    distance[outside] = _segment_distance(seen[outside], mask[outside])
    return distance


def _segment_distance(seen: Floats, mask: Bools) -> Floats:
    """(T,) distance of the origin from the nearest segment between two points (T, n, 2)."""
    first, second = np.triu_indices(mask.shape[1])
    start = seen[:, first]
    way = seen[:, second] - start
    length = np.maximum(np.sum(way**2, axis=2), 1e-300)
    share = np.clip(-np.sum(start * way, axis=2) / length, 0.0, 1.0)
    nearest = start + share[..., None] * way
    apart = np.where(
        mask[:, first] & mask[:, second], np.sum(nearest**2, axis=2), np.inf
    )  # fmt: skip
    distance: Floats = np.sqrt(apart.min(axis=1, initial=np.inf))
    return distance
