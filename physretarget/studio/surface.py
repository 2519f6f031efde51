"""Where a ray from the camera meets the character: what a click on it means."""

from __future__ import annotations

import itertools

import mujoco
import numpy as np
from numpy.typing import NDArray

from physretarget.mjcf import Character
from physretarget.replay.figures import shown_geoms

__all__ = ["surface_point"]

Array = NDArray[np.float64]

# A corner this near to the click is meant, as a share of the character's height: some 8 pixels
# of a view that the character fills.
_CORNER = 0.02


def surface_point(
    character: Character, qpos: Array, origin: Array, way: Array
) -> tuple[int, Array] | None:
    """The nearest point of what is drawn, on a ray; a corner close by is preferred.

    Args:
        character: the character.
        qpos: (nq,) its pose.
        origin: (3,) m, where the ray begins.
        way: (3,) its direction, of any length.

    Returns:
        The body and the (3,) point in its frame, m. None where the ray misses.
    """
    length = float(np.linalg.norm(way))
    if length == 0.0 or not np.isfinite([*origin, *way]).all():
        return None
    model, data = character.model, mujoco.MjData(character.model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    shown = shown_geoms(model)
    groups = np.zeros(mujoco.mjNGROUP, dtype=np.uint8)
    groups[np.unique(model.geom_group[shown])] = 1
    geom = np.full((1, 1), -1, dtype=np.int32)
    way = way / length
    far = mujoco.mj_ray(model, data, origin, way, groups, False, -1, geom)
    if far < 0 or int(model.geom_bodyid[geom[0, 0]]) not in set(character.bodies.tolist()):
        return None
    hit, which = origin + far * way, int(geom[0, 0])
    corners = _corners(model, data, which)
    if len(corners):
        away = np.linalg.norm(corners - hit, axis=1)
        if away.min() < _CORNER * character.height:
            hit = corners[int(away.argmin())]
    body = int(model.geom_bodyid[which])
    return body, data.xmat[body].reshape(3, 3).T @ (hit - data.xpos[body])


def _corners(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> Array:
    """(n, 3) m in the world: of a box, or the vertices of a mesh."""
    kind = int(model.geom_type[geom])
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        local = np.array(list(itertools.product((-1.0, 1.0), repeat=3))) * model.geom_size[geom]
    elif kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        local = model.mesh_vert[first : first + count].astype(np.float64)
    else:
        return np.zeros((0, 3))
    turned: Array = local @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
    return turned
