"""A rigid body's contact points: how it stands on the floor and how it may tilt."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.ground.undersides import Solid

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

_EPS = 1e-9


@dataclass(frozen=True, eq=False)
class Sole:
    """The n contact points that one rigid body carries.

    ``body``; ``points`` (n,) their indices among the character's contact points; ``local``
    (n, 3) in the body's frame and ``centre`` (3,) their mean; ``flat`` (3, 3) the rotation of
    the body when it stands flat with heading zero; ``foot`` (n, 3) the points relative to
    the centre then; ``sides`` which of the actor's sides each one follows. ``under`` (m, 3)
    further points of the body's underside at the floor's level, in the body's frame, and
    ``print`` (m, 3) the same relative to the centre when it stands flat: they bear nothing by
    the timetable, but must not sink. ``friction`` of the floor under it.
    """

    body: int
    points: Ints
    local: Floats
    centre: Floats
    flat: Floats
    foot: Floats
    sides: tuple[str, ...]
    under: Floats
    print: Floats
    friction: float = 1.0

    @cached_property
    def radius(self) -> float:
        """The farthest point's distance from the centre, m."""
        return float(np.linalg.norm(self.foot, axis=1).max())

    @cached_property
    def two_sided(self) -> bool:
        """Whether both feet of the actor are tied to this one body."""
        return len(set(self.sides)) > 1


def make_sole(
    body: int,
    points: Ints,
    local: Floats,
    sides: tuple[str, ...],
    stand: Floats,
    *,
    friction: float = 1.0,
) -> Sole:
    """The sole of a body whose rotation in the character's reference pose is ``stand``.

    The plane (or line) of the points becomes horizontal by the smallest rotation.
    """
    centre = local.mean(axis=0)
    arms = (local - centre) @ stand.T
    flat = _levelled(arms) @ stand
    foot, none = (local - centre) @ flat.T, np.zeros((0, 3))
    return Sole(body, points, local, centre, flat, foot, sides, none, none, friction)


def with_underside(sole: Sole, shapes: Sequence[Solid], level: float) -> Sole:
    """The sole with the undersides of its body's geoms that reach down to its contact points.

    Points higher than ``level`` (m) when the body stands flat may sink as it tilts and are left
    out, and so are those of a body that carries both feet: it is made to rock on its edges. A
    single contact point has no direction to tilt in.
    """
    if sole.two_sided or len(sole.local) < 2:
        return sole
    points = [shape.undersides(sole.flat[2]) for shape in shapes if shape.body == sole.body]
    under = np.concatenate([*points, np.zeros((0, 3))])
    arm = (under - sole.centre) @ sole.flat.T
    near = arm[:, 2] < sole.foot[:, 2].min() + level
    gap = np.linalg.norm(arm[:, None] - sole.foot, axis=-1).min(axis=1)
    keep = near & (gap > 1e-3)
    return replace(sole, under=under[keep], print=arm[keep])


def _levelled(arms: Floats) -> Floats:
    """The smallest rotation (3, 3) that makes centred points (n, 3) as level as they can be."""
    _, size, axes = np.linalg.svd(arms, full_matrices=True)
    if len(arms) < 2 or size[0] < _EPS:
        return np.eye(3)
    if len(arms) == 2 or size[1] < 1e-3 * size[0]:
        line = axes[0]
        level = np.array([line[0], line[1], 0.0])
        return _turning(line, level) if np.linalg.norm(level) > 0.3 else np.eye(3)
    normal = axes[2] * (1.0 if axes[2, 2] >= 0 else -1.0)
    # Points that stand upright in the reference pose (a hand's edge) are left as they are.
    return _turning(normal, np.array([0.0, 0.0, 1.0])) if normal[2] > 0.7 else np.eye(3)


def _turning(start: Floats, end: Floats) -> Floats:
    """The smallest rotation (3, 3) from one direction to another, less than a half turn apart."""
    start, end = start / np.linalg.norm(start), end / np.linalg.norm(end)
    axis = np.cross(start, end)
    quat = np.concatenate([[1.0 + start @ end], axis])
    turned: Floats = kinematics.quat_to_matrix(quat / np.linalg.norm(quat))
    return turned


@dataclass(frozen=True, eq=False)
class SoleMotion:
    """Where a sole is over time.

    ``centre`` (T, 3) world; ``rotation`` (T, 3, 3) of the body; ``yaw`` (T,) unwrapped
    heading; ``tilt`` (T, 3) rotation vector, horizontal, in the frame turned by yaw:
    ``rotation = Rz(yaw) exp(tilt) flat``.
    """

    centre: Floats
    rotation: Floats
    yaw: Floats
    tilt: Floats


def sole_motion(sole: Sole, pose: kinematics.Pose) -> SoleMotion:
    """Follow a sole through a clip, its rotation split into heading and tilt."""
    rotation = pose.rotation[:, sole.body]
    centre = pose.position[:, sole.body] + rotation @ sole.centre
    quat = kinematics.continuous(kinematics.matrix_to_quat(rotation @ sole.flat.T))
    yaw = np.unwrap(2.0 * np.arctan2(quat[:, 3], quat[:, 0]))
    back = yaw_quat(-yaw)
    tilt = kinematics.quat_to_rotvec(kinematics.quat_multiply(back, quat))
    return SoleMotion(centre, rotation, yaw, tilt)


def yaw_quat(yaw: Floats) -> Floats:
    """Quaternions (..., 4) of rotations about the vertical."""
    zero = np.zeros_like(yaw)
    return np.stack([np.cos(0.5 * yaw), zero, zero, np.sin(0.5 * yaw)], axis=-1)


def allowed_tilt(sole: Sole, tilt: Floats, planted: Bools) -> Floats:
    """The tilts (T, 3) nearest to ``tilt`` that keep planted points (T, n) on the floor.

    A rotation vector τ about a point on the floor lifts a point at distance d by
    ``(τ × d)_z`` times a positive factor, so the tilts that lift no planted point and sink no
    free one are a convex cone in the plane: everything for a corner that bears the
    body alone, a half line for an edge, nothing but zero for a face. The rest of the underside
    is free, always.
    """
    result = np.zeros_like(tilt)
    patterns, where = np.unique(planted, axis=0, return_inverse=True)
    for k, pattern in enumerate(patterns):
        frames = where.reshape(-1) == k
        if pattern.any():
            result[frames, :2] = _into_cone(tilt[frames, :2], *_cone(sole, pattern))
    return result


def _cone(sole: Sole, planted: Bools) -> tuple[Floats, Floats]:
    """Rows (…, 2) whose product with a tilt must be zero, and must not be negative."""
    pivot = int(np.argmax(planted))
    arm = np.concatenate([sole.foot, sole.print])[:, :2] - sole.foot[pivot, :2]
    planted = np.concatenate([planted, np.zeros(len(sole.print), dtype=bool)])
    rows = np.stack([arm[:, 1], -arm[:, 0]], axis=1)
    real = np.linalg.norm(rows, axis=1) > _EPS
    return rows[planted & real], rows[~planted & real]


def _into_cone(tilt: Floats, zero: Floats, positive: Floats) -> Floats:
    """Project tilts (N, 2) onto the cone ``zero · τ = 0``, ``positive · τ >= 0``."""
    if len(zero) == 0 and len(positive) == 0:
        return tilt
    best = np.zeros_like(tilt)
    distance = np.sum(tilt * tilt, axis=1)
    if len(zero) == 0:
        inside = (tilt @ positive.T >= -_EPS).all(axis=1)
        best[inside], distance[inside] = tilt[inside], 0.0
    for ray in _rays(zero, positive):
        along = np.maximum(tilt @ ray, 0.0)
        point = along[:, None] * ray
        gap = np.sum((tilt - point) ** 2, axis=1)
        nearer = gap < distance
        best[nearer], distance[nearer] = point[nearer], gap[nearer]
    return best


def _rays(zero: Floats, positive: Floats) -> Floats:
    """Directions (R, 2) of the cone's edges."""
    found = [np.zeros((0, 2))]
    size = 1e-6 * max(sole_size(zero), sole_size(positive))
    for row in np.concatenate([zero, positive]):
        for sign in (1.0, -1.0):
            ray = sign * np.array([-row[1], row[0]]) / np.linalg.norm(row)
            if (np.abs(zero @ ray) <= size).all() and (positive @ ray >= -size).all():
                found.append(ray[None])
    return np.concatenate(found)


@dataclass(frozen=True, eq=False)
class TiltCone:
    """The tilts (2,) that keep some planted points on the floor; see :func:`allowed_tilt`."""

    everything: bool
    inside: Floats | None
    rays: Floats

    @classmethod
    def of(cls, sole: Sole, planted: Bools) -> TiltCone:
        """Of planted points (n,)."""
        zero, positive = _cone(sole, planted)
        everything = len(zero) == 0 and len(positive) == 0
        return cls(everything, None if len(zero) else positive, _rays(zero, positive))

    def nearest(self, tilt: Floats) -> Floats:
        """The member (3,) nearest to a tilt (3,), as :func:`allowed_tilt` finds it for many."""
        flat = tilt[:2]
        result = np.zeros(3)
        if self.everything or (self.inside is not None and (self.inside @ flat >= -_EPS).all()):
            result[:2] = flat
        elif len(self.rays):
            along = self.rays @ flat
            best = int(np.argmax(along))
            result[:2] = max(float(along[best]), 0.0) * self.rays[best]
        return result


def sole_size(rows: Floats) -> float:
    """The longest row's length, 0 if there is none."""
    return float(np.linalg.norm(rows, axis=1).max()) if len(rows) else 0.0


def rolled(sole: Sole, planted: Bools, angle: float) -> Floats:
    """The tilt (3,) by ``angle`` that rolls the body onto its planted side."""
    towards = sole.foot[~planted, :2].mean(axis=0) - sole.foot[planted, :2].mean(axis=0)
    length = float(np.linalg.norm(towards))
    if length < _EPS:
        return np.zeros(3)
    return np.array([towards[1], -towards[0], 0.0]) * (angle / length)
