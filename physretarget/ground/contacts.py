"""Which points touch the floor, frame by frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget.ground.undersides import Undersides
from physretarget.kinematics import Pose

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

# Of many touching points of one body the outermost in these horizontal directions stand for
# all: any box keeps its corners, any hull the polygon that fits it. An octagon in a circle is 8 %
# of the radius short, which at an impact of ten body weights is a moment: what it does not explain
# is asked of three times as many.
_DIRECTIONS, _FINE = 8, 3
_ANGLES = (np.arange(_DIRECTIONS * _FINE) + 0.25) * 2 * np.pi / (_DIRECTIONS * _FINE)
_COMPASS = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)])


# 3 % of the CoM height, within 1 and 2 cm: soles of robots and captures lie that far off.
_TOLERANCE_OF_HEIGHT, _TOLERANCE_M = 0.03, (0.01, 0.02)


def contact_tolerance(com_height: float) -> float:
    """How near to the floor a point touches, m, of a body whose CoM is ``com_height`` m high."""
    return float(np.clip(_TOLERANCE_OF_HEIGHT * com_height, *_TOLERANCE_M))


@dataclass(frozen=True, eq=False)
class Contacts:
    """Touching points of T frames: position (T, n, 3) world m, body (T, n), mask (T, n).

    ``outer`` (T, n) are few of them that stand for nearly all; ``friction`` (T, n) is the
    coefficient at each. ``lowest`` (T,) m above the floor and its
    body; ``clearance`` (T,) m by which no point touches, below 0 where one does; ``bodies`` (B,)
    that may touch and ``on`` (T, B) which of them do. ``twist`` (bodies of the model, 2) m is the
    torsional and rolling friction of bodies. ``tolerance`` m is how near that is.
    """

    position: Floats
    body: Ints
    friction: Floats
    mask: Bools
    outer: Bools
    lowest: Floats
    lowest_body: Ints
    clearance: Floats
    bodies: Ints
    on: Bools
    twist: Floats
    floor: float
    tolerance: float = 0.01


def find_contacts(
    points: Undersides, pose: Pose, floor: float, tolerance: float, friction: float | None = None
) -> Contacts:
    """Points within ``tolerance`` (m) of the floor, at most 24 for every body.

    A body that comes down and goes up again between two frames touches in both: see
    :func:`bounces`. ``friction`` takes the place of the points' own.
    """
    frames = len(pose.position)
    bodies = points.bodies
    lowest, lowest_body = np.full(frames, np.inf), np.zeros(frames, dtype=np.int64)
    on = np.zeros((frames, len(bodies)), dtype=bool)
    picked: list[tuple[Floats, Floats, Bools, Bools, int]] = []
    matters = _can_matter(points, pose, floor, tolerance)
    for index, body in enumerate(bodies):
        rows = np.flatnonzero(matters[:, index])
        if len(rows) == 0:
            continue
        own = points.of_body(int(body))
        height = own.heights(_rows(pose, rows)) - floor
        low = height.min(axis=1)
        under = low < lowest[rows]
        lowest_body[rows[under]] = body
        lowest[rows] = np.minimum(low, lowest[rows])
        near = height < tolerance
        near |= bounces(height - tolerance, rows)
        touching = near.any(axis=1)
        if touching.any():
            on[rows[touching], index] = True
            place = own.lowest(_rows(pose, rows[touching]))
            # Body and floor both give way: they meet halfway, as MuJoCo has it.
            place[..., 2] += 0.5 * np.maximum(floor - place[..., 2], 0.0)
            rubs = np.broadcast_to(own.friction, near[touching].shape)
            chosen = _outermost(place, rubs, near[touching])
            picked.append((*_spread(*chosen, rows[touching], frames), int(body)))
    place, rubs, mask, outer, owner = _packed(picked, frames)
    if friction is not None:
        rubs = np.full_like(rubs, friction)
    gap = lowest - tolerance
    clearance = np.where(on.any(axis=1), np.minimum(gap, -0.5 * tolerance), gap)
    return Contacts(
        place,
        owner,
        rubs,
        mask,
        outer,
        lowest,
        lowest_body,
        clearance,
        bodies,
        on,
        points.twist,
        floor,
        tolerance,
    )


def bounces(gap: Floats, rows: Ints) -> Bools:
    """(R, K) whether points (R, K) m from touching in the frames ``rows`` (R,) touch between two.

    At the speed with which a point comes to one frame and leaves the next it would have gone
    through the floor meanwhile: a ball at 3 m/s is 5 cm off before and after its bounce, at 60
    frames/s.
    """
    found = np.zeros(gap.shape, dtype=bool)
    if len(rows) < 4:
        return found
    change = np.diff(gap, axis=0)
    together = (rows[3:] - rows[:-3] == 3)[:, None]
    comes = gap[1:-2] + change[:-2] < 0
    leaves = gap[2:-1] - change[2:] < 0
    both = together & comes & leaves
    found[1:-2] |= both
    found[2:-1] |= both
    return found


def lowest(points: Undersides, pose: Pose, floor: float) -> tuple[Floats, Ints]:
    """(T,) height of the lowest point above the floor (m), and its body."""
    height = np.full(len(pose.position), np.inf)
    owner = np.zeros(len(height), dtype=np.int64)
    matters = _can_matter(points, pose, floor, -np.inf)
    for index, body in enumerate(points.bodies):
        rows = np.flatnonzero(matters[:, index])
        if len(rows) == 0:
            continue
        low = points.of_body(int(body)).heights(_rows(pose, rows)).min(axis=1) - floor
        under = rows[low < height[rows]]
        owner[under] = body
        height[rows] = np.minimum(low, height[rows])
    return height, owner


def _rows(pose: Pose, rows: Ints) -> Pose:
    return (
        pose if len(rows) == len(pose.position) else Pose(pose.position[rows], pose.rotation[rows])
    )


def _spread(
    place: Floats, rubs: Floats, mask: Bools, outer: Bools, rows: Ints, frames: int
) -> tuple[Floats, Floats, Bools, Bools]:
    """Points of some frames among all frames."""
    spread = []
    for part in (place, rubs, mask, outer):
        everywhere = np.zeros((frames, *part.shape[1:]), dtype=part.dtype)
        everywhere[rows] = part
        spread.append(everywhere)
    return spread[0], spread[1], spread[2], spread[3]


def _can_matter(points: Undersides, pose: Pose, floor: float, tolerance: float) -> Bools:
    """(T, B) whether a body may touch or be the lowest, by its bounding sphere."""
    reach = np.linalg.norm(points.local, axis=1) + points.radius + points.axes.max(axis=1)
    bounds = np.array([reach[points.body == b].max() for b in points.bodies])
    height = pose.position[:, points.bodies, 2] - floor
    ceiling = np.maximum((height + bounds).min(axis=1), tolerance)
    can: Bools = (height - bounds) <= ceiling[:, None]
    return can


def _outermost(place: Floats, rubs: Floats, near: Bools) -> tuple[Floats, Floats, Bools, Bools]:
    """(T, <=24, 3) points, their friction, mask, and which stand for them: all of a few points,
    the outermost of many."""
    if place.shape[1] <= _DIRECTIONS:
        return place, rubs, near, near
    along = np.where(near[..., None], place[..., :2] @ _COMPASS, -np.inf)
    best = along.argmax(axis=1)
    rows = np.arange(len(place))[:, None]
    chosen, outer = np.zeros_like(near), np.zeros_like(near)
    chosen[rows, best] = near[rows, best]
    outer[rows, best[:, ::_FINE]] = chosen[rows, best[:, ::_FINE]]
    order = np.argsort(~chosen, axis=1, kind="stable")[:, : len(_ANGLES)]
    return place[rows, order], rubs[rows, order], chosen[rows, order], outer[rows, order]


def _packed(
    picked: list[tuple[Floats, Floats, Bools, Bools, int]], frames: int
) -> tuple[Floats, Floats, Bools, Bools, Ints]:
    """Touching points of all bodies: first those that stand for the others, then the others."""
    if not picked:
        none = np.zeros((frames, 0), dtype=bool)
        return np.zeros((frames, 0, 3)), np.zeros((frames, 0)), none, none, none.astype(np.int64)
    place, rubs, near, outer = (
        np.concatenate([part[k] for part in picked], axis=1) for k in range(4)
    )
    owner = np.concatenate([np.full(part[2].shape[1], part[4]) for part in picked])
    width = int(near.sum(axis=1).max())
    order = np.argsort(np.where(outer, 0, np.where(near, 1, 2)), axis=1, kind="stable")[:, :width]
    at = (np.arange(frames)[:, None], order)
    return place[at], rubs[at], near[at], outer[at], owner[order]
