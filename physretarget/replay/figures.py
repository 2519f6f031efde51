"""From a MuJoCo model and a motion to a :class:`~physretarget.replay.scene.Figure`."""

from __future__ import annotations

from typing import Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from physretarget.errors import InputError
from physretarget.replay.scene import (
    Array,
    Color,
    Contacts,
    Figure,
    Forces,
    Light,
    Shape,
    ShapeKind,
    check_frames,
)

_KINDS: dict[int, ShapeKind] = {
    int(mujoco.mjtGeom.mjGEOM_BOX): "box",
    int(mujoco.mjtGeom.mjGEOM_SPHERE): "sphere",
    int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): "ellipsoid",
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): "capsule",
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): "cylinder",
    int(mujoco.mjtGeom.mjGEOM_MESH): "mesh",
}
# MuJoCo's viewers show geom groups 0 to 2 unless told otherwise.
_VISIBLE_GROUPS = 3
_DEFAULT_RGBA = (0.5, 0.5, 0.5, 1.0)
# Smaller than this (m) nobody sees it: placeholders such as a head marker.
_SPECK = 5e-4


class PointsLike(Protocol):
    """Points fixed on bodies, as :class:`physretarget.mjcf.Points`."""

    @property
    def names(self) -> tuple[str, ...]: ...  # noqa: D102
    @property
    def body(self) -> NDArray[np.int64]: ...  # noqa: D102
    @property
    def local(self) -> NDArray[np.float64]: ...  # noqa: D102


class Modelled(Protocol):
    """What can be put on stage: any character with a compiled model and contact points."""

    @property
    def model(self) -> mujoco.MjModel: ...  # noqa: D102
    @property
    def contacts(self) -> PointsLike: ...  # noqa: D102


def figure(
    character: Modelled,
    qpos: Array,
    *,
    name: str,
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0),
    tint: Color | None = None,
    repaint: bool = False,
    opacity: float = 1.0,
    hidden: bool = False,
    contact_active: NDArray[np.bool_] | None = None,
    forces: Forces | None = None,
) -> Figure:
    """Pose a character along a motion and keep what can be seen of it.

    Args:
        character: its ``model`` is any MjModel; its ``contacts`` are shown as points.
        qpos: (T, nq) in MuJoCo's layout.
        name: shown beside it.
        offset: metres, where it stands when figures are shown side by side.
        tint: RGB in 0..1 for shapes that have no colour of their own (all with ``repaint``).
        repaint: let ``tint`` cover declared colours too.
        opacity: 0..1.
        hidden: start switched off.
        contact_active: (T, K), which of the character's contact points stand.
        forces: arrows in body weights.

    Returns:
        What the player needs of it.

    Raises:
        InputError: qpos does not fit the model, is not finite, or the tracks differ in length.
    """
    model = character.model
    qpos = np.asarray(qpos, dtype=np.float64)
    _check_motion(model, qpos)
    points = character.contacts
    if contact_active is not None:
        check_frames("contact_active", len(contact_active), len(qpos))
        if contact_active.shape[1] != len(points.names):
            raise InputError(
                f"contact_active has {contact_active.shape[1]} columns, "
                f"the character {len(points.names)} contact points."
            )
    if forces is not None:
        check_frames("force arrows", len(forces.origin), len(qpos))
    position, rotation, com = body_poses(model, qpos)
    parts = shapes(model)
    return Figure(
        name=name,
        shapes=parts,
        position=position,
        rotation=rotation,
        com=com,
        height=_tallest(parts, position, rotation),
        offset=offset,
        tint=tint,
        repaint=repaint,
        opacity=opacity,
        hidden=hidden,
        lights=_lights(model),
        contacts=Contacts(tuple(points.names), points.body, points.local, contact_active)
        if len(points.names)
        else None,
        forces=forces,
    )


def _check_motion(model: mujoco.MjModel, qpos: Array) -> None:
    if qpos.ndim != 2 or qpos.shape[1] != model.nq or len(qpos) == 0:
        raise InputError(f"qpos has shape {qpos.shape}, the model needs (frames, {model.nq}).")
    bad = np.flatnonzero(~np.isfinite(qpos).all(axis=1))
    if bad.size:
        raise InputError("qpos holds values that are not finite.", frame=int(bad[0]))


def body_poses(model: mujoco.MjModel, qpos: Array) -> tuple[Array, Array, Array]:
    """World poses of all bodies: position (T, nb, 3), rotation (T, nb, 4), CoM (T, 3)."""
    data = mujoco.MjData(model)
    frames = len(qpos)
    position = np.empty((frames, model.nbody, 3))
    rotation = np.empty((frames, model.nbody, 4))
    com = np.empty((frames, 3))
    mass = np.array(model.body_mass)
    total = float(mass.sum())
    for t in range(frames):
        data.qpos[:] = qpos[t]
        mujoco.mj_kinematics(model, data)
        position[t] = data.xpos
        rotation[t] = data.xquat
        com[t] = mass @ data.xipos / total if total > 0 else data.xpos[1:].mean(axis=0)
    # q and -q are one rotation; neighbours of one sign can be blended.
    if frames > 1:
        turn = np.sum(rotation[1:] * rotation[:-1], axis=-1) < 0
        rotation[1:] *= np.where(np.cumsum(turn, axis=0) % 2, -1.0, 1.0)[..., None]
    return position, rotation, com


def shapes(model: mujoco.MjModel) -> tuple[Shape, ...]:
    """The visible geoms of moving bodies, as shapes."""
    made = (_shape(model, g) for g in shown_geoms(model))
    return tuple(shape for shape in made if shape.rgba[3] > 0.01)


def shown_geoms(model: mujoco.MjModel) -> list[int]:
    """The visible geoms of moving bodies; all groups where the default ones hold nothing.

    Args:
        model: the model.

    Returns:
        Ids of geoms.
    """
    moving = [g for g in range(model.ngeom) if int(model.geom_bodyid[g]) > 0]
    moving = [g for g in moving if int(model.geom_type[g]) in _KINDS]
    seen = [g for g in moving if int(model.geom_group[g]) < _VISIBLE_GROUPS]
    seen = [g for g in seen if float(model.geom_rbound[g]) > _SPECK]
    return seen or moving


def _shape(model: mujoco.MjModel, geom: int) -> Shape:
    kind = _KINDS[int(model.geom_type[geom])]
    rgba = tuple(float(c) for c in model.geom_rgba[geom])
    declared = not np.allclose(rgba, _DEFAULT_RGBA)
    material = int(model.geom_matid[geom])
    emission, gloss = 0.0, 0.4
    if material >= 0:
        emission = float(model.mat_emission[material])
        gloss = float(model.mat_shininess[material])
        # A geom's own colour wins over its material's, as in MuJoCo.
        if not declared:
            rgba = tuple(float(c) for c in model.mat_rgba[material])
            declared = True
    vertices = faces = None
    if kind == "mesh":
        vertices, faces = _mesh(model, int(model.geom_dataid[geom]))
    return Shape(
        kind=kind,
        body=int(model.geom_bodyid[geom]),
        size=np.array(model.geom_size[geom]),
        position=np.array(model.geom_pos[geom]),
        rotation=np.array(model.geom_quat[geom]),
        rgba=(rgba[0], rgba[1], rgba[2], rgba[3]),
        declared=declared,
        emission=emission,
        gloss=gloss,
        vertices=vertices,
        faces=faces,
    )


def _mesh(model: mujoco.MjModel, mesh: int) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    vertex, vertices = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    face, faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    return (
        np.array(model.mesh_vert[vertex : vertex + vertices], dtype=np.float32),
        np.array(model.mesh_face[face : face + faces], dtype=np.int32),
    )


def _lights(model: mujoco.MjModel) -> tuple[Light, ...]:
    found = []
    for light in range(model.nlight):
        if int(model.light_bodyid[light]) == 0:
            continue
        color = [float(c) for c in model.light_diffuse[light]]
        found.append(
            Light(
                body=int(model.light_bodyid[light]),
                position=np.array(model.light_pos[light]),
                direction=np.array(model.light_dir[light]),
                color=(color[0], color[1], color[2]),
            )
        )
    return tuple(found)


def _tallest(parts: tuple[Shape, ...], position: Array, rotation: Array) -> float:
    """Height (m) of the figure at its tallest, looked at in some thirty frames of the motion."""
    frames = np.unique(np.linspace(0, len(position) - 1, 32).astype(int))
    return max(_height(parts, position[t], rotation[t]) for t in frames)


def _height(parts: tuple[Shape, ...], position: Array, rotation: Array) -> float:
    """Height (m) of a frame's bounding box, from the shapes' bounding spheres' centres."""
    tops, bottoms = [], []
    for part in parts:
        turned = np.empty(3)
        mujoco.mju_rotVecQuat(turned, part.position, rotation[part.body])
        middle = float(position[part.body, 2] + turned[2])
        reach = _reach(part)
        tops.append(middle + reach)
        bottoms.append(middle - reach)
    return max(max(tops) - min(bottoms), 0.05) if tops else 1.0


def _reach(part: Shape) -> float:
    if part.vertices is not None and len(part.vertices):
        return float(np.abs(part.vertices).max())
    if part.kind in ("capsule", "cylinder"):
        return float(part.size[0] + 0.5 * part.size[1])
    return float(part.size[:1].max() if part.kind == "sphere" else part.size.mean())
