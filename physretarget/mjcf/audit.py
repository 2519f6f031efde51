"""What is odd about a model: facts that a simulator accepts and a physicist would not.

Only facts are gathered here; which of them is an error is the validator's to say. Bodies
that are welded together (no joint between them) are judged as one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from physretarget.mjcf.character import Character
from physretarget.mjcf.declared import passive_joints
from physretarget.mjcf.solids import Solid, geom_volume, inertia_box_volume, mesh_solid

__all__ = ["AUDIT_KEYS", "AuditFact", "audit"]

Array = NDArray[np.float64]
Subject = Literal["model", "body", "joint", "geom", "mesh"]

DENSITY = (50.0, 20_000.0)
"""kg/m³: between hard foam and tungsten; a hollow robot link lies at a few hundred."""
LIGHTEST = 1e-3
"""kg: a moving body below one gram is a placeholder."""
SIZE = (0.02, 20.0)
"""m: a model outside these was most likely written in another unit."""
SPRING_HOLDS = 3.0
"""A damped spring that carries its limb's weight, held out level, three times over at 1 rad (at
1 m for a slide) is as stiff as a controller. A springy tail has a few of them: so most of the
joints must, or the one must also hold SPRING_LARGE."""
SPRING_LARGE = 0.2
"""BW·h per rad (BW per m): no ornament is sprung that hard."""
DAMPER_BRAKES = 0.02
"""BW·h s/rad (BW s/m): a damper that brakes this hard at 1 rad/s is no joint friction; the
choice is ours, well above the friction of geared joints."""
SOLID_SHARE = (0.03, 5.0)
"""Mesh volume over that of the box with the body's mass and inertia. No solid of even density
exceeds 1.13, a ball; motors inside a shell raise it, thin shells lower it."""
TRIANGLE = 1e-6
"""Relative slack of the triangle inequality, for figures rounded in the file."""

_ON_JOINTS = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))

AUDIT_KEYS = {
    "mass_light": "a moving body with next to no mass",
    "mass_none": "a tree without mass",
    "inertia_triangle": "principal moments of inertia that no body can have",
    "inertia_reach": "mass would have to lie outside the body's geometry",
    "com_outside": "the centre of mass lies outside the body's geometry",
    "density_low": "lighter than foam for its volume",
    "density_high": "heavier than tungsten for its volume",
    "density_unknown": "a body with mass and no geometry to compare with",
    "mesh_open": "a mesh that is not watertight and so has no volume",
    "mesh_volume": "a mesh of another volume than the body's inertia says",
    "limit_missing": "a joint without limits",
    "torque_limit_missing": "joints whose torque nothing limits",
    "pd_gains": "a controller's gains hidden in joint stiffness and damping",
    "root_passive": "springs, damping or armature on the free root",
    "no_contact_geometry": "nothing that could touch the floor",
    "no_floor": "no floor plane",
    "no_root": "no free joint",
    "gravity": "gravity is not 9.81 m/s² downward",
    "size": "the model's size suggests another unit than the metre",
}


@dataclass(frozen=True)
class AuditFact:
    """One oddity: what is odd (a key of AUDIT_KEYS), where, how much, and the limit it passes.

    ``limit`` is the one that was crossed, NaN where there is no number to it.
    """

    key: str
    subject: Subject
    name: str
    value: float
    limit: float
    unit: str
    message: str


def audit(character: Character) -> list[AuditFact]:
    """All oddities of a character's tree, in a fixed order: model, bodies, meshes, joints."""
    groups = _groups(character)
    solids = _solids(character)
    return [
        *_whole(character),
        *_masses(character, groups),
        *_inertias(character, groups),
        *_densities(character, groups, solids),
        *_meshes(character, groups, solids),
        *_joints(character),
        *_gains(character),
    ]


@dataclass(frozen=True, eq=False)
class _Group:
    """Bodies welded together, in the reference pose; world coordinates."""

    name: str
    bodies: NDArray[np.int64]
    mass: float
    geoms: NDArray[np.int64]
    centre: Array  # (g, 3) of the geoms
    bound: Array  # (g,) radii of their bounding spheres
    colliding: NDArray[np.bool_]  # (g,)


def _groups(character: Character) -> list[_Group]:
    model = character.model
    data = mujoco.MjData(model)
    data.qpos[:] = character.reference_qpos
    mujoco.mj_kinematics(model, data)
    found = []
    for head in np.unique(model.body_weldid[character.bodies]):
        bodies = character.bodies[model.body_weldid[character.bodies] == head]
        geoms = np.flatnonzero(np.isin(model.geom_bodyid, bodies) & (model.geom_rbound > 0))
        first = bodies[0]
        found.append(
            _Group(
                name=_name(model, mujoco.mjtObj.mjOBJ_BODY, int(first)),
                bodies=bodies,
                mass=float(model.body_mass[bodies].sum()),
                geoms=geoms,
                centre=np.array(data.geom_xpos[geoms]),
                bound=np.array(model.geom_rbound[geoms]),
                colliding=_collides(model, geoms),
            )
        )
    return found


def _collides(model: mujoco.MjModel, geoms: NDArray[np.int64]) -> NDArray[np.bool_]:
    flags: NDArray[np.bool_] = (model.geom_contype[geoms] != 0) | (
        model.geom_conaffinity[geoms] != 0
    )
    return flags


def _solids(character: Character) -> dict[int, Solid]:
    """Every mesh that the character's geoms use, by mesh id."""
    model = character.model
    own = np.isin(model.geom_bodyid, character.bodies)
    meshes = model.geom_dataid[own & (model.geom_type == mujoco.mjtGeom.mjGEOM_MESH)]
    return {int(mesh): mesh_solid(model, int(mesh)) for mesh in np.unique(meshes)}


def _whole(character: Character) -> Iterator[AuditFact]:
    model = character.model
    nan = float("nan")

    def fact(key: str, value: float, limit: float, unit: str, message: str) -> AuditFact:
        return AuditFact(key, "model", character.name, value, limit, unit, message)

    gravity = model.opt.gravity
    if np.linalg.norm(gravity - [0, 0, -9.81]) > 0.05:
        yield fact(
            "gravity", float(np.linalg.norm(gravity)), 9.81, "m/s²", f"gravity is {gravity} m/s²"
        )
    if not SIZE[0] <= character.height <= SIZE[1]:
        limit = SIZE[0] if character.height < SIZE[0] else SIZE[1]
        message = f"{character.height:.3g} m high: is it written in metres?"
        yield fact("size", character.height, limit, "m", message)
    if not character.has_root:
        yield fact("no_root", 0, nan, "", "no free joint: the root is fixed in the world")
    if not character.has_floor:
        yield fact("no_floor", 0, nan, "", "no floor plane in the file: z = 0 is assumed")
    own = np.flatnonzero(np.isin(model.geom_bodyid, character.bodies))
    touching = int(_collides(model, own).sum())
    if not touching and not len(character.contacts):
        yield fact("no_contact_geometry", 0, 1, "geoms", "no geom collides, no contact point")
    if character.has_root:
        dofs = slice(character.root_dof, character.root_dof + 6)
        joint = model.body_jntadr[character.root_body]
        burden = max(
            float(model.dof_damping[dofs].max()),
            float(model.dof_armature[dofs].max()),
            float(model.jnt_stiffness[joint]),
        )
        if burden > 0:
            message = "damping, stiffness or armature on the free root acts from nowhere"
            yield fact("root_passive", burden, 0.0, "", message)


def _masses(character: Character, groups: list[_Group]) -> Iterator[AuditFact]:
    if character.mass <= 0:
        yield AuditFact("mass_none", "model", character.name, 0, 0, "kg", "the tree has no mass")
    for group in groups:
        moving = character.model.body_weldid[group.bodies[0]] != 0
        if moving and group.mass < LIGHTEST:
            message = f"{group.mass:.2g} kg is no mass of a moving body"
            yield AuditFact("mass_light", "body", group.name, group.mass, LIGHTEST, "kg", message)


def _inertias(character: Character, groups: list[_Group]) -> Iterator[AuditFact]:
    model = character.model
    data = mujoco.MjData(model)
    data.qpos[:] = character.reference_qpos
    mujoco.mj_kinematics(model, data)
    for group in groups:
        for body in group.bodies:
            name = _name(model, mujoco.mjtObj.mjOBJ_BODY, int(body))
            mass, moments = float(model.body_mass[body]), np.sort(model.body_inertia[body])
            if mass <= 0:
                continue
            if moments[2] > 0 and moments[0] + moments[1] < moments[2] * (1 - TRIANGLE):
                ratio = float(moments[2] / max(moments[0] + moments[1], 1e-300))
                message = (
                    f"inertia {moments[2]:.3g} exceeds the sum of the other two by {ratio:.2g}"
                )
                yield AuditFact("inertia_triangle", "body", name, ratio, 1.0, "", message)
            if not len(group.geoms):
                continue
            away = np.linalg.norm(group.centre - data.xipos[body], axis=1)
            reach = float((away + group.bound).max())
            # I = ∫ r² dm ≤ m r_max² for every axis.
            needed = float(np.sqrt(moments[2] / mass))
            if needed > reach:
                message = (
                    f"its inertia needs mass {needed:.3g} m off, its geometry reaches {reach:.3g} m"
                )
                yield AuditFact("inertia_reach", "body", name, needed, reach, "m", message)
            inside = float((away - group.bound).min())
            if inside > 0:
                message = f"its centre of mass lies {inside:.3g} m outside its geometry"
                yield AuditFact("com_outside", "body", name, inside, 0.0, "m", message)


def _densities(
    character: Character, groups: list[_Group], solids: dict[int, Solid]
) -> Iterator[AuditFact]:
    """Density with every doubt on the model's side: looks and collision shapes overlap."""
    for group in groups:
        if group.mass < LIGHTEST:
            continue

        def fact(
            key: str, value: float, limit: float, why: str, name: str = group.name
        ) -> AuditFact:
            return AuditFact(key, "body", name, value, limit, "kg/m³", why)

        volumes = np.array([geom_volume(character.model, int(g), solids) for g in group.geoms])
        known = ~np.isnan(volumes)
        total = float(volumes[known].sum())
        if total <= 0:
            why = f"{group.mass:.3g} kg without closed geometry: density not judged"
            yield fact("density_unknown", float("nan"), float("nan"), why)
            continue
        largest = max(
            float(volumes[known & group.colliding].sum()),
            float(volumes[known & ~group.colliding].sum()),
        )
        low, high = group.mass / largest, group.mass / total
        if low < DENSITY[0] and known.all():
            why = f"{group.mass:.3g} kg in {largest * 1e3:.3g} litres is {low:.3g} kg/m³"
            yield fact("density_low", low, DENSITY[0], why)
        elif high > DENSITY[1] and known.all():
            why = f"{group.mass:.3g} kg in {total * 1e3:.3g} litres is {high:.3g} kg/m³"
            yield fact("density_high", high, DENSITY[1], why)


def _meshes(
    character: Character, groups: list[_Group], solids: dict[int, Solid]
) -> Iterator[AuditFact]:
    model = character.model
    for mesh, solid in solids.items():
        if not solid.watertight:
            name = _name(model, mujoco.mjtObj.mjOBJ_MESH, mesh)
            why = "the mesh is not watertight: it encloses no volume"
            yield AuditFact("mesh_open", "mesh", name, float("nan"), float("nan"), "", why)
    for group in groups:
        if len(group.bodies) != 1 or group.mass < LIGHTEST:
            continue  # inertias of several bodies have no box of their own
        meshed = model.geom_type[group.geoms] == mujoco.mjtGeom.mjGEOM_MESH
        looks = meshed & ~group.colliding
        chosen = group.geoms[looks if looks.any() else meshed]
        volume = sum(geom_volume(model, int(g), solids) for g in chosen)
        moments = model.body_inertia[group.bodies[0]]
        box = inertia_box_volume(group.mass, tuple(moments))
        if not len(chosen) or np.isnan(volume) or box <= 0:
            continue
        share = float(volume / box)
        if not SOLID_SHARE[0] <= share <= SOLID_SHARE[1]:
            limit = SOLID_SHARE[0] if share < SOLID_SHARE[0] else SOLID_SHARE[1]
            why = (
                f"its meshes enclose {volume * 1e3:.3g} litres, its mass and inertia are those "
                f"of a box of {box * 1e3:.3g} litres"
            )
            yield AuditFact("mesh_volume", "body", group.name, share, limit, "", why)


def _own_joints(character: Character) -> list[int]:
    """The joints of the character's tree, its free root left out."""
    model = character.model
    return [
        joint
        for joint in range(model.njnt)
        if model.jnt_bodyid[joint] in character.bodies
        and model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_FREE
    ]


def _joints(character: Character) -> Iterator[AuditFact]:
    model = character.model
    nan = float("nan")
    joints = _own_joints(character)
    for joint in joints:
        if not model.jnt_limited[joint]:
            name = character.joint_names[joint]
            unit = "m" if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE else "rad"
            yield AuditFact("limit_missing", "joint", name, nan, nan, unit, "no range is given")
    limited = {joint for joint in joints if model.jnt_actfrclimited[joint]}
    for actuator in range(model.nu):
        bounded = model.actuator_forcelimited[actuator] or (
            # A motor's control range bounds its force as well.
            model.actuator_ctrllimited[actuator]
            and model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_NONE
        )
        if bounded and int(model.actuator_trntype[actuator]) in _ON_JOINTS:
            limited.add(int(model.actuator_trnid[actuator, 0]))
    missing = [joint for joint in joints if joint not in limited]
    if missing:
        why = f"nothing limits the torque of {len(missing)} of {len(joints)} joints"
        count = float(len(missing))
        yield AuditFact("torque_limit_missing", "model", character.name, count, 0.0, "joints", why)


def _gains(character: Character) -> Iterator[AuditFact]:
    """Joint springs and dampers that are too strong to be a mechanism's own.

    Joints that the model declares passive are springs by design.
    """
    model = character.model
    declared = passive_joints(character)
    joints = [j for j in _own_joints(character) if character.joint_names[j] not in declared]
    if not joints:
        return
    loads = _limb_loads(character, joints)
    springs = model.jnt_stiffness[joints]
    damping = model.dof_damping[model.jnt_dofadr[joints]]
    sliding = model.jnt_type[joints] == mujoco.mjtJoint.mjJNT_SLIDE
    scale = character.weight * np.where(sliding, 1.0, character.com_height)
    stiff = (damping > 0) & (springs > SPRING_HOLDS * loads)
    if 2 * stiff.sum() < len(joints):
        stiff &= springs > SPRING_LARGE * scale
    for i, joint in enumerate(joints):
        name, unit = character.joint_names[joint], "N/m" if sliding[i] else "N m/rad"
        limit, brake = SPRING_HOLDS * float(loads[i]), DAMPER_BRAKES * float(scale[i])
        if stiff[i]:
            load = f"{loads[i]:.3g} {'N' if sliding[i] else 'N m'}"
            why = (
                f"stiffness {springs[i]:.3g} {unit} with damping {damping[i]:.3g} where the limb's "
                f"weight asks for {load}: the gains of a controller"
            )
            yield AuditFact("pd_gains", "joint", name, float(springs[i]), limit, unit, why)
        elif damping[i] > brake:
            why = f"damping {damping[i]:.3g} {unit} s is a controller's, above {brake:.3g}"
            yield AuditFact("pd_gains", "joint", name, float(damping[i]), brake, f"{unit} s", why)


def _limb_loads(character: Character, joints: list[int]) -> Array:
    """What each joint's limb weighs on it when held out level: N m, or N on a slide."""
    model = character.model
    data = mujoco.MjData(model)
    data.qpos[:] = character.reference_qpos
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    bodies = model.jnt_bodyid[joints]
    arm = np.linalg.norm(data.subtree_com[bodies] - data.xanchor[joints], axis=1)
    arm[model.jnt_type[joints] == mujoco.mjtJoint.mjJNT_SLIDE] = 1.0
    gravity = float(np.linalg.norm(model.opt.gravity))
    loads: Array = model.body_subtreemass[bodies] * gravity * arm
    return loads


def _name(model: mujoco.MjModel, kind: mujoco.mjtObj, index: int) -> str:
    label = kind.name.removeprefix("mjOBJ_").lower()
    return mujoco.mj_id2name(model, kind, index) or f"{label}{index}"
