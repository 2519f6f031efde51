"""How low a character's bodies reach: the lowest point of every geom, exactly.

Every primitive is a few points, each grown by one ellipsoid (a Minkowski sum): a sphere is a
point and a ball, a capsule two, a cylinder two and a flat disc, an ellipsoid one, a box eight
bare corners, a mesh its vertices. The lowest point of a sum is the sum of the lowest points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from physretarget import kinematics
from physretarget.mjcf.character import Character

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Solid:
    """One geom of a body: ``points`` (n, 3) in the body's frame, m, grown by an ellipsoid.

    ``axes`` (3,) its semi-axes, m, zero for none, and ``frame`` (3, 3) their directions, as
    columns, in the body's frame.
    """

    name: str
    body: int
    points: Floats
    axes: Floats
    frame: Floats

    def heights(self, pose: kinematics.Pose) -> Floats:
        """(T, n) z of the lowest point around each of the points, m."""
        upward = pose.rotation[:, self.body, 2]
        grown = np.linalg.norm((upward @ self.frame) * self.axes, axis=1)
        at: Floats = pose.position[:, self.body, 2, None] + upward @ self.points.T
        lowest: Floats = at - grown[:, None]
        return lowest

    def undersides(self, up: Floats) -> Floats:
        """(n, 3) the lowest point around each of the points, body frame, if ``up`` is up there."""
        along = (up @ self.frame) * self.axes
        size = float(np.linalg.norm(along))
        reach = self.frame @ (self.axes * along) / size if size > 0 else np.zeros(3)
        lowest: Floats = self.points - reach
        return lowest


def solids(character: Character, bodies: Sequence[int] | Ints | None = None) -> tuple[Solid, ...]:
    """The geoms of ``bodies``, by default of all that move; planes and height fields are none."""
    model = character.model
    wanted = character.bodies if bodies is None else np.asarray(bodies, dtype=np.int64)
    found = []
    for geom in np.flatnonzero(np.isin(model.geom_bodyid, wanted)):
        shape = _shape(model, int(geom))
        if shape is None:
            continue
        points, axes = shape
        turn = kinematics.quat_to_matrix(np.array(model.geom_quat[geom]))
        points = points @ turn.T + model.geom_pos[geom]
        body = int(model.geom_bodyid[geom])
        name = model.geom(int(geom)).name or model.body(body).name
        found.append(Solid(name, body, points, axes, turn))
    return tuple(found)


def lowest_heights(every: Sequence[Solid], pose: kinematics.Pose) -> Floats:
    """(T, G) z of the lowest point of each solid, m."""
    frames = len(pose.position)
    if not every:
        return np.zeros((frames, 0))
    return np.stack([solid.heights(pose).min(axis=1) for solid in every], axis=1)


def _shape(model: mujoco.MjModel, geom: int) -> tuple[Floats, Floats] | None:
    """Points (n, 3) in the geom's frame and the semi-axes (3,) that they are grown by."""
    kinds = mujoco.mjtGeom
    kind = int(model.geom_type[geom])
    size: Floats = np.array(model.geom_size[geom], dtype=np.float64)
    ends = np.array([[0.0, 0.0, size[1]], [0.0, 0.0, -size[1]]])
    if kind == kinds.mjGEOM_SPHERE:
        return np.zeros((1, 3)), np.full(3, size[0])
    if kind == kinds.mjGEOM_CAPSULE:
        return ends, np.full(3, size[0])
    if kind == kinds.mjGEOM_CYLINDER:
        return ends, np.array([size[0], size[0], 0.0])
    if kind == kinds.mjGEOM_ELLIPSOID:
        return np.zeros((1, 3)), size
    if kind == kinds.mjGEOM_BOX:
        corners = np.array(np.meshgrid([-1.0, 1.0], [-1.0, 1.0], [-1.0, 1.0])).reshape(3, 8).T
        return corners * size, np.zeros(3)
    if kind == kinds.mjGEOM_MESH:
        return _hull(model, int(model.geom_dataid[geom])), np.zeros(3)
    return None


def _hull(model: mujoco.MjModel, mesh: int) -> Floats:
    start = int(model.mesh_vertadr[mesh])
    vertices: Floats = np.array(
        model.mesh_vert[start : start + int(model.mesh_vertnum[mesh])], dtype=np.float64
    )
    try:
        return vertices[np.sort(ConvexHull(vertices).vertices)]
    except QhullError:  # a flat mesh spans no volume
        return vertices
