"""Volumes of geoms and meshes."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import trimesh

__all__ = ["Solid", "geom_volume", "inertia_box_volume", "mesh_solid"]


@dataclass(frozen=True)
class Solid:
    """A mesh as a solid: whether it is watertight, and the volume it encloses (m³)."""

    watertight: bool
    volume: float


def mesh_solid(model: mujoco.MjModel, mesh: int) -> Solid:
    """Close a mesh of `model` up as far as equal vertices allow, and measure it."""
    vertex, face = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
    shape = trimesh.Trimesh(
        model.mesh_vert[vertex : vertex + model.mesh_vertnum[mesh]],
        model.mesh_face[face : face + model.mesh_facenum[mesh]],
        process=True,  # merges vertices that differ in normal or texture only
        merge_norm=True,
        merge_tex=True,
    )
    return Solid(bool(shape.is_watertight), abs(float(shape.volume)))


def geom_volume(model: mujoco.MjModel, geom: int, solids: dict[int, Solid]) -> float:
    """Volume of a geom (m³); NaN for an open mesh and for what encloses none."""
    kind, (a, b, c) = int(model.geom_type[geom]), model.geom_size[geom]
    shapes = mujoco.mjtGeom
    if kind == shapes.mjGEOM_MESH:
        solid = solids[int(model.geom_dataid[geom])]
        return solid.volume if solid.watertight else float("nan")
    volume = {
        int(shapes.mjGEOM_SPHERE): 4 / 3 * np.pi * a**3,
        int(shapes.mjGEOM_CAPSULE): np.pi * a**2 * (2 * b + 4 / 3 * a),
        int(shapes.mjGEOM_CYLINDER): np.pi * a**2 * 2 * b,
        int(shapes.mjGEOM_ELLIPSOID): 4 / 3 * np.pi * a * b * c,
        int(shapes.mjGEOM_BOX): 8 * a * b * c,
    }.get(kind, np.nan)
    return float(volume)


def inertia_box_volume(mass: float, moments: tuple[float, float, float]) -> float:
    """Volume (m³) of the box of even density with this mass and these principal moments."""
    a, b, c = moments
    edges = np.array([b + c - a, a + c - b, a + b - c]) * 6.0 / mass
    return float(np.sqrt(np.prod(np.maximum(edges, 0.0))))
