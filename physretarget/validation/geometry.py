"""Where a character can touch the floor: fixed candidate points of its collision geometry.

A sphere is one point with a radius, a capsule two, a box its corners, a cylinder points on
its rims, a mesh the vertices of its convex hull; an ellipsoid's lowest point is found anew in
every frame. Declared contact points, where the model has them, take the geometry's place.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from physretarget.kinematics import Pose
from physretarget.mjcf import Character

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

# A rim of 24 points is within 0.9 % of the radius of a circle.
_RIM = 24


@dataclass(frozen=True, eq=False)
class Candidates:
    """Points that may touch: body (K,), local (K, 3) m in the body frame, radius (K,) m.

    ``axes`` (K, 3) are an ellipsoid's semi-axes and zero elsewhere; ``frame`` (K, 3, 3) its
    rotation in the body. ``source`` says where the points came from.
    """

    body: Ints
    local: Floats
    radius: Floats
    axes: Floats
    frame: Floats
    source: str

    def __len__(self) -> int:
        return len(self.body)

    @property
    def bodies(self) -> Ints:
        """Distinct bodies, ascending."""
        return np.unique(self.body)


def candidates(character: Character) -> Candidates:
    """The points by which contact is judged: declared ones, else the collision geometry."""
    if len(character.contacts):
        points = character.contacts
        return _assembled(
            [(int(b), p, 0.0) for b, p in zip(points.body, points.local, strict=True)],
            f"{len(points)} declared contact points",
        )
    geoms = collision_geoms(character)
    return of_geoms(character, geoms)


def collision_geoms(character: Character) -> Ints:
    """Geoms of the character's tree that can collide with the floor by the model's masks."""
    model = character.model
    floor = [
        g
        for g in range(model.ngeom)
        if model.geom_type[g] == mujoco.mjtGeom.mjGEOM_PLANE and model.geom_bodyid[g] == 0
    ]
    mine = np.isin(model.geom_bodyid, character.bodies)
    kind, affinity = model.geom_contype, model.geom_conaffinity
    if floor:
        touches = np.any(
            [(kind & affinity[g]) | (kind[g] & affinity) for g in floor], axis=0
        )  # fmt: skip
    else:
        touches = (kind | affinity) != 0
    flat = (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD)
    solid = ~np.isin(model.geom_type, flat)
    return np.flatnonzero(mine & touches & solid).astype(np.int64)


def of_geoms(character: Character, geoms: Ints) -> Candidates:
    """Candidate points of these geoms."""
    model = character.model
    rows: list[tuple[int, Floats, float]] = []
    ellipsoids: list[tuple[int, Floats, Floats, Floats]] = []
    for geom in geoms:
        body = int(model.geom_bodyid[geom])
        place, turn = model.geom_pos[geom], _matrix(model.geom_quat[geom])
        size = model.geom_size[geom]
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            ellipsoids.append((body, place.copy(), size.copy(), turn))
            continue
        points, radius = _shape_points(model, int(geom), size)
        rows += [(body, place + turn @ p, radius) for p in points]
    source = f"{len(geoms)} collision geoms" if len(geoms) else "nothing"
    return _assembled(rows, source, ellipsoids)


def _shape_points(model: mujoco.MjModel, geom: int, size: Floats) -> tuple[Floats, float]:
    kinds = mujoco.mjtGeom
    kind = model.geom_type[geom]
    if kind == kinds.mjGEOM_SPHERE:
        return np.zeros((1, 3)), float(size[0])
    if kind == kinds.mjGEOM_CAPSULE:
        return np.array([[0, 0, -size[1]], [0, 0, size[1]]]), float(size[0])
    if kind == kinds.mjGEOM_BOX:
        corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
        return corners * size, 0.0
    if kind == kinds.mjGEOM_CYLINDER:
        angle = np.arange(_RIM) * 2 * np.pi / _RIM
        ring = np.c_[size[0] * np.cos(angle), size[0] * np.sin(angle)]
        return np.vstack([np.c_[ring, np.full(_RIM, s * size[1])] for s in (-1, 1)]), 0.0
    if kind == kinds.mjGEOM_MESH:
        return _hull(model, int(model.geom_dataid[geom])), 0.0
    return np.zeros((1, 3)), float(model.geom_rbound[geom])


def _hull(model: mujoco.MjModel, mesh: int) -> Floats:
    start = model.mesh_vertadr[mesh]
    vertices = np.asarray(model.mesh_vert[start : start + model.mesh_vertnum[mesh]], np.float64)
    try:
        return vertices[np.sort(ConvexHull(vertices).vertices)]
    except QhullError:  # flat or tiny meshes have no hull with a volume
        return vertices


def _matrix(quat: Floats) -> Floats:
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, quat)
    return matrix.reshape(3, 3)


def _assembled(
    rows: list[tuple[int, Floats, float]],
    source: str,
    ellipsoids: list[tuple[int, Floats, Floats, Floats]] | None = None,
) -> Candidates:
    extra = ellipsoids or []
    order = sorted(range(len(rows)), key=lambda i: rows[i][0])
    count = len(rows) + len(extra)
    body = np.array([rows[i][0] for i in order] + [e[0] for e in extra], dtype=np.int64)
    local = np.array([rows[i][1] for i in order] + [e[1] for e in extra]).reshape(count, 3)
    radius = np.array([rows[i][2] for i in order] + [0.0] * len(extra))
    axes, frame = np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1))
    for k, (_, _, size, turn) in enumerate(extra, start=len(rows)):
        axes[k], frame[k] = size, turn
    by_body = np.argsort(body, kind="stable")
    return Candidates(
        body[by_body], local[by_body], radius[by_body], axes[by_body], frame[by_body], source
    )


def lowest_heights(pose: Pose, points: Candidates) -> Floats:
    """(T, K) z of the lowest points of candidates that all belong to one body: cheap."""
    body = int(points.body[0])
    upward = pose.rotation[:, body, 2]
    height: Floats = pose.position[:, body, 2, None] + upward @ points.local.T - points.radius
    for k in np.flatnonzero(points.axes.any(axis=1)):
        height[:, k] -= np.linalg.norm(points.axes[k] * (upward @ points.frame[k]), axis=1)
    return height


def lowest_points(pose: Pose, points: Candidates) -> Floats:
    """(T, K, 3) world position of the lowest point of every candidate."""
    place = pose.position[:, points.body]
    turn = pose.rotation[:, points.body]
    world: Floats = place + np.einsum("tkij,kj->tki", turn, points.local)
    world[..., 2] -= points.radius
    for k in np.flatnonzero(points.axes.any(axis=1)):
        # Lowest point of an ellipsoid: centre - A²n / |A n|, n = down-direction in its frame.
        axes = pose.rotation[:, points.body[k]] @ points.frame[k]
        up = axes[:, 2, :]
        scaled = points.axes[k] * up
        reach = np.linalg.norm(scaled, axis=1, keepdims=True)
        world[:, k] -= np.einsum("tij,tj->ti", axes, points.axes[k] * scaled / reach)
    return world
