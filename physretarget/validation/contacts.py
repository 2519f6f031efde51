"""Which points touch the floor, how they move, and what their forces are worth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget.kinematics import Pose
from physretarget.validation.cones import RHO
from physretarget.validation.geometry import Candidates, lowest_heights, lowest_points

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]
Series = dict[str, NDArray[np.generic]]

# Of many touching points of one body the outermost in these horizontal directions stand for
# all: any box keeps its corners, any hull the octagon that fits it.
_DIRECTIONS = 8
_ANGLES = (np.arange(_DIRECTIONS) + 0.25) * 2 * np.pi / _DIRECTIONS
_COMPASS = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)])
# A body bears load above this share of body weight and of what is borne in all.
LOADED_BW, LOADED_SHARE = 0.1, 0.25
# Sliding is braked when friction takes this share of the power that the cone allows.
BRAKED = 0.7
_ARROWS = 4
# The fit prefers resting points. The price of force grows with the square of the speed beyond
# the slowest touching point's: 1e-3 at 0.1 m/s, 0.1 at 1 m/s, where 1 would halve the force.
_PRICE_PER_SPEED2 = 0.1
_DEAREST = 1.0


@dataclass(frozen=True, eq=False)
class Touch:
    """Touching points of T frames: position (T, n, 3) world m, body (T, n), mask (T, n).

    ``lowest`` (T,) m above the floor and its body; ``bodies`` (B,) that may touch and ``on``
    (T, B) which of them do.
    """

    position: Floats
    body: Ints
    mask: Bools
    lowest: Floats
    lowest_body: Ints
    bodies: Ints
    on: Bools
    floor: float

    def series(self) -> Series:
        """The per-frame results that are kept."""
        return {
            "lowest": self.lowest,
            "lowest_body": self.lowest_body,
            "touching": self.mask.sum(axis=1),
            "touch": self.on,
        }

    def velocity(self, pose: Pose, moving: tuple[Floats, Floats]) -> Floats:
        """(T, n, 2) tangential velocity of the touching material points, m/s."""
        linear, angular = moving
        column = np.searchsorted(self.bodies, self.body)
        column = np.minimum(column, max(len(self.bodies) - 1, 0))
        rows = np.arange(len(self.body))[:, None]
        arm = self.position - pose.position[rows, self.body]
        velocity = linear[rows, column] + np.cross(angular[rows, column], arm)
        return np.where(self.mask[..., None], velocity[..., :2], 0.0)


def find_touch(points: Candidates, pose: Pose, floor: float, tolerance: float) -> Touch:
    """Points within ``tolerance`` (m) of the floor, at most eight for every body."""
    frames = len(pose.position)
    bodies = points.bodies
    lowest, lowest_body = np.full(frames, np.inf), np.zeros(frames, dtype=np.int64)
    on = np.zeros((frames, len(bodies)), dtype=bool)
    picked: list[tuple[Floats, Bools, int]] = []
    matters = _can_matter(points, pose, floor, tolerance)
    for index, body in enumerate(bodies):
        rows = np.flatnonzero(matters[:, index])
        if len(rows) == 0:
            continue
        own = _of_body(points, int(body))
        height = lowest_heights(_rows(pose, rows), own) - floor
        low = height.min(axis=1)
        under = low < lowest[rows]
        lowest_body[rows[under]] = body
        lowest[rows] = np.minimum(low, lowest[rows])
        touching = low < tolerance
        if touching.any():
            on[rows[touching], index] = True
            near = height[touching] < tolerance
            place, mask = _outermost(lowest_points(_rows(pose, rows[touching]), own), near)
            picked.append((*_spread(place, mask, rows[touching], frames), int(body)))
    position, mask, owner = _packed(picked, frames)
    return Touch(position, owner, mask, lowest, lowest_body, bodies, on, floor)


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


def _of_body(points: Candidates, body: int) -> Candidates:
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


def body_motion(pose: Pose, bodies: Ints, keep: slice, step: float) -> tuple[Floats, Floats]:
    """Linear and angular velocity (T, B, 3), world, of bodies by central differences."""
    position, rotation = pose.position[:, bodies], pose.rotation[:, bodies]
    linear = np.gradient(position, step, axis=0, edge_order=2)[keep]
    turning = np.gradient(rotation, step, axis=0, edge_order=2)[keep]
    # dR/dt R^T is the cross-product matrix of the angular velocity.
    cross = turning @ np.swapaxes(rotation[keep], -1, -2)
    angular = 0.5 * np.stack(
        [
            cross[..., 2, 1] - cross[..., 1, 2],
            cross[..., 0, 2] - cross[..., 2, 0],
            cross[..., 1, 0] - cross[..., 0, 1],
        ],
        axis=-1,
    )
    return linear, angular


def touch_rho(touch: Touch, speed: Floats, tolerance: float) -> Floats:
    """(T, n) price of force at a point: resting points on the floor come first.

    Where several points could bear the load, the kindest reading of the clip is taken: the
    foot at rest stands, the one that passes by does not. Speed counts relative to the slowest
    point of the frame, so that a body sliding as a whole is explained like one at rest.
    """
    above = np.clip((touch.position[..., 2] - touch.floor) / tolerance, 0.0, 1.0)
    slowest = np.where(touch.mask, speed, np.inf).min(axis=1, keepdims=True, initial=np.inf)
    beyond = np.where(touch.mask, speed - slowest, 0.0)
    return np.minimum(RHO * (1 + 9 * above**2) + _PRICE_PER_SPEED2 * beyond**2, _DEAREST)


def skate(touch: Touch, force: Floats, velocity: Floats, friction: float) -> Series:
    """Sliding of loaded bodies: ``skate`` (T,) m/s of the fastest, and ``skate_body``.

    A body slides as fast as its slowest loaded point, so that rolling over the toes or
    turning about the heel is no sliding. ``skate_free`` counts only sliding that friction
    does not brake: a body that skids to a halt with its force on the edge of the cone,
    against the motion, does what physics asks of it.
    """
    frames = len(force)
    speed = np.linalg.norm(velocity, axis=2)
    total = force[..., 2].sum(axis=1)
    worst, free = np.zeros(frames), np.zeros(frames)
    body = np.zeros(frames, dtype=np.int64)
    for index, candidate in enumerate(touch.bodies):
        if not touch.on[:, index].any():
            continue
        mine = touch.mask & (touch.body == candidate)
        normal = np.where(mine, force[..., 2], 0.0)
        load = normal.sum(axis=1)
        bearing = mine & (normal > 0.01 * load[:, None])
        slowest = np.where(bearing, speed, np.inf).min(axis=1, initial=np.inf)
        loaded = (load > LOADED_BW) & (load > LOADED_SHARE * total) & np.isfinite(slowest)
        slides = np.where(loaded, slowest, 0.0)
        power = np.where(mine[..., None], force[..., :2] * velocity, 0.0).sum(axis=(1, 2))
        most = friction * (normal * speed).sum(axis=1)
        free = np.maximum(free, np.where(power < -BRAKED * most, 0.0, slides))
        body[slides > worst] = candidate
        worst = np.maximum(worst, slides)
    return {"skate": worst, "skate_free": free, "skate_body": body}


def arrows(touch: Touch, force: Floats) -> Series:
    """The four largest forces on bodies: where they act (T, 4, 3) m and their size (T, 4, 3) BW.

    Zero where fewer bodies bear load.
    """
    frames = len(force)
    bearing = [int(b) for i, b in enumerate(touch.bodies) if touch.on[:, i].any()]
    place = np.zeros((frames, max(len(bearing), _ARROWS), 3))
    size = np.zeros_like(place)
    for k, body in enumerate(bearing):
        own = np.where((touch.mask & (touch.body == body))[..., None], force, 0.0)
        size[:, k] = own.sum(axis=1)
        load = own[..., 2]
        total = load.sum(axis=1, keepdims=True)
        share = load / np.where(total > 0, total, 1.0)
        place[:, k] = np.einsum("tn,tni->ti", share, touch.position)
    order = np.argsort(-size[..., 2], axis=1, kind="stable")[:, :_ARROWS]
    rows = np.arange(frames)[:, None]
    # Drawn, not computed with: single precision keeps an hour's clip small.
    return {
        "arrow_origin": place[rows, order].astype(np.float32),
        "arrow_force": size[rows, order].astype(np.float32),
    }


def cop_outside(touch: Touch, force: Floats, moment: Floats, com: Floats, floor: float) -> Floats:
    """(T,) m that the required centre of pressure lies outside the touching points' hull.

    NaN where nothing touches or less than a fifth of body weight is to be borne; 0 inside.
    """
    judged = (force[:, 2] > 0.2) & touch.mask.any(axis=1)
    outside = np.full(len(force), np.nan)
    if not judged.any():
        return outside
    f, m, c = force[judged], moment[judged], com[judged]
    drop = floor - c[:, 2]
    x = c[:, 0] + (drop * f[:, 0] - m[:, 1]) / f[:, 2]
    y = c[:, 1] + (m[:, 0] + drop * f[:, 1]) / f[:, 2]
    points, mask = touch.position[judged][..., :2], touch.mask[judged]
    outside[judged] = hull_distance(np.c_[x, y], points, mask)
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
