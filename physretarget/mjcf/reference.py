"""A model in its reference pose: extents, heights, sizes of bodies."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

__all__ = ["body_radius", "field_heights", "geom_span", "lowest_and_highest", "tree_bodies"]

Array = NDArray[np.float64]

# NumPy integers are members of a tuple only of integers, not of MuJoCo's enums.
_ENDLESS = (int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD))


def tree_bodies(model: mujoco.MjModel, root_body: int) -> NDArray[np.int64]:
    """Ids of the bodies in the subtree of `root_body`, itself included, ascending."""
    inside = np.zeros(model.nbody, dtype=bool)
    inside[root_body] = True
    for body in range(root_body + 1, model.nbody):  # parents come before children
        inside[body] |= inside[model.body_parentid[body]]
    return np.flatnonzero(inside)


def lowest_and_highest(
    model: mujoco.MjModel, data: mujoco.MjData, bodies: NDArray[np.int64]
) -> tuple[float, float]:
    """Lowest and highest world z over the geometry of `bodies`; of their frames if none.

    `data` has been through ``mj_kinematics``.
    """
    geoms = [
        int(geom)
        for geom in np.flatnonzero(np.isin(model.geom_bodyid, bodies))
        if int(model.geom_type[geom]) not in _ENDLESS
    ]
    if not geoms:
        heights = np.concatenate([data.xpos[bodies, 2], data.xipos[bodies, 2]])
        return float(heights.min()), float(heights.max())
    spans = np.array([geom_span(model, data, geom) for geom in geoms])
    return float(spans[:, 0].min()), float(spans[:, 1].max())


def geom_span(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> tuple[float, float]:
    """Lowest and highest world z of a geom that is not endless."""
    down, up = _reach(model, geom, data.geom_xmat[geom].reshape(3, 3)[2])
    centre = float(data.geom_xpos[geom, 2])
    return centre - down, centre + up


def field_heights(model: mujoco.MjModel, geom: int) -> Array:
    """Heights (nrow · ncol,) of a height field over the geom's origin, along its z axis (m)."""
    field = int(model.geom_dataid[geom])
    first, count = model.hfield_adr[field], model.hfield_nrow[field] * model.hfield_ncol[field]
    heights: Array = model.hfield_data[first : first + count] * model.hfield_size[field, 2]
    return heights


def _reach(model: mujoco.MjModel, geom: int, up: Array) -> tuple[float, float]:
    """How far a geom reaches down and up from its centre, `up` being world z in its frame."""
    size = model.geom_size[geom]
    kind = model.geom_type[geom]
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        reach = size[0]
    elif kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        reach = size[0] + size[1] * abs(up[2])
    elif kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        reach = np.linalg.norm(size * up)
    elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        reach = size[0] * np.hypot(up[0], up[1]) + size[1] * abs(up[2])
    elif kind == mujoco.mjtGeom.mjGEOM_BOX:
        reach = size @ np.abs(up)
    elif kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        start = model.mesh_vertadr[mesh]
        along = model.mesh_vert[start : start + model.mesh_vertnum[mesh]] @ up
        return float(-along.min()), float(along.max())
    else:
        reach = model.geom_rbound[geom]
    return float(reach), float(reach)


def body_radius(model: mujoco.MjModel, body: int) -> float:
    """Half the size of a body (m): of its geometry, else 1.5 times its radius of gyration."""
    first, count = model.body_geomadr[body], model.body_geomnum[body]
    bounds = [
        float(model.geom_rbound[geom])
        for geom in range(first, first + count)
        if model.geom_rbound[geom] > 0  # planes have none
    ]
    if bounds:
        return float(max(bounds) / 3.0**0.5)
    mass = model.body_mass[body]
    if mass <= 0:
        return 0.0
    return float(1.5 * np.sqrt(model.body_inertia[body].sum() / (2.0 * mass)))
