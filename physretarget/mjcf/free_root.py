"""A model whose root does not move on a free joint, made into one whose root does.

Two kinds of models have a root that moves freely, or could, and no free joint: one moves on three
slides and three hinges or a ball, a free joint in pieces; another is fixed to the world, though the
thing that it models only stands on its floor. Both are rewritten in XML, as MuJoCo writes it, and
compiled anew; poses of the one become poses of the other.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from xml.etree import ElementTree as Xml

import mujoco
import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.errors import InputError
from physretarget.kinematics import continuous, matrix_to_quat
from physretarget.mjcf.character import Character, character_of
from physretarget.mjcf.reference import lowest_and_highest, tree_bodies

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_FREE = "free_root"
_WIDTH = {"free": 7, "ball": 4, "hinge": 1, "slide": 1}
# What is fixed in the world and reaches further than this many heights of the character is a floor,
# a table or a wall, no base of its.
_BASE_HEIGHTS = 1.5


@dataclass(frozen=True, eq=False)
class FreeRoot:
    """A character with a free root, and how poses of the original become its own.

    Attributes:
        character: named, hashed and placed as the original.
        tree: the original's.
        body: the original's body that became the root; 0: the world, to which it is fixed.
        columns: for each coordinate behind the free joint the original's column.
    """

    character: Character
    tree: kinematics.Tree
    body: int
    columns: Ints

    def lift(self, qpos: Floats) -> Floats:
        """(T, nq) poses of the original as (T, nq') poses of the character."""
        root = np.zeros((len(qpos), 7))
        root[:, 3] = 1.0
        if self.body:
            pose = kinematics.forward(self.tree, qpos)
            root[:, :3] = pose.position[:, self.body]
            root[:, 3:] = continuous(matrix_to_quat(pose.rotation[:, self.body]))
        lifted: Floats = np.hstack([root, qpos[:, self.columns]])
        return lifted


@lru_cache(maxsize=8)
def free_root(character: Character, *, stands: bool) -> FreeRoot | None:
    """The character with a free root.

    Args:
        character: any.
        stands: whether one that is fixed to the world only stands on its floor.

    Returns:
        None where the root is free already, or held by the world.

    Raises:
        InputError: it cannot be made free.
    """
    if character.has_root or character.source is None:
        return None
    body = floating_body(character)
    if body is None and not stands:
        return None
    document, names = _document(character)
    if body is None:
        columns = np.arange(character.tree.nq)
        _free_base(document, character, names)
        note = "judged as standing: the base that the model fixes to the world was set free"
    else:
        columns = _free_chain(document, character, names, body)
        note = "the root moves on slides and hinges: judged as the free joint that they make"
    try:
        made = _compiled(document, character, names, columns, body or 0)
    except (ValueError, mujoco.FatalError, InputError) as error:
        raise InputError(
            f"its root cannot be set free: {' '.join(str(error).split())}", path=character.path
        ) from error
    floor = made.character.floor_height
    if body is None and not character.has_floor:
        floor = _lowest(made.character)
    freed = replace(
        made.character, name=character.name, path=character.path, sha256=character.sha256,
        floor_height=floor, notes=(*character.notes, note),
    )  # fmt: skip
    return replace(made, character=freed)


def floating_body(character: Character) -> int | None:
    """The body whose joints, with those of bodies without mass above it, let it move anywhere.

    Three slides and three hinges, or three slides and a ball, that leave no direction out.
    """
    model = character.model
    body, dofs = character.root_body, 0
    kinds: list[int] = []
    while True:
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        kinds += [int(model.jnt_type[first + i]) for i in range(count)]
        dofs += int(model.body_dofnum[body])
        if dofs >= 6:
            break
        children = np.flatnonzero(model.body_parentid == body)
        if len(children) != 1 or model.body_geomnum[body]:
            return None
        body = int(children[0])
    slides = kinds.count(int(mujoco.mjtJoint.mjJNT_SLIDE))
    if dofs != 6 or slides != 3:
        return None
    data = mujoco.MjData(model)
    # Hinges in a row may stand in each other's way in one pose: anywhere but there.
    data.qpos[:] = character.reference_qpos
    start = int(model.body_jntadr[character.root_body])
    at = int(model.jnt_qposadr[start])
    if kinds.count(int(mujoco.mjtJoint.mjJNT_HINGE)) == 3:
        data.qpos[at : at + 6] += 0.3
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    along, about = np.zeros((2, 3, model.nv))
    mujoco.mj_jacBody(model, data, along, about, body)
    own = slice(int(model.jnt_dofadr[start]), int(model.jnt_dofadr[start]) + 6)
    full = np.linalg.matrix_rank(np.vstack([along, about])[:, own], tol=1e-6) == 6
    return body if full else None


@dataclass(frozen=True)
class _Names:
    """Of bodies and joints by id, given to those that had none."""

    bodies: tuple[str, ...]
    joints: tuple[str, ...]


def _document(character: Character) -> tuple[Xml.Element, _Names]:
    """The model as MuJoCo writes it, everything named."""
    source = character.source
    assert source is not None
    if source.path is not None:
        spec = mujoco.MjSpec.from_file(str(source.path))
    else:
        spec = mujoco.MjSpec.from_string(source.text)
    spec.compile()
    for kind, every in (("body", spec.bodies), ("joint", spec.joints)):
        for each in every:
            each.name = each.name or f"unnamed_{kind}_{each.id}"
    bodies = {each.id: each.name for each in spec.bodies}
    joints = {each.id: each.name for each in spec.joints}
    spec.compile()
    document = Xml.fromstring(spec.to_xml())
    # Of the world's own geoms MuJoCo writes no mass.
    own = list(spec.worldbody.geoms)
    for geom, element in zip(own, _world(document).findall("geom"), strict=True):
        if np.isfinite(geom.mass):
            element.set("mass", repr(float(geom.mass)))
    return document, _Names(
        tuple(bodies[i] for i in range(len(bodies))), tuple(joints[i] for i in range(len(joints)))
    )


def _world(document: Xml.Element) -> Xml.Element:
    world = document.find("worldbody")
    assert world is not None
    return world


def _free_chain(document: Xml.Element, character: Character, names: _Names, body: int) -> Ints:
    """Put the chain's last body on a free joint in the world; the columns of all other joints."""
    model, world = character.model, _world(document)
    gone, above = set(), []
    each = body
    while each:
        above.append(each)
        each = int(model.body_parentid[each])
    top = next(e for e in world.iter("body") if e.get("name") == names.bodies[above[-1]])
    moved = next(e for e in world.iter("body") if e.get("name") == names.bodies[body])
    inherited = [e.get("childclass") for e in top.iter("body") if e is not moved]
    for element in list(moved):
        if element.tag in ("joint", "freejoint"):
            moved.remove(element)
    for each in above:
        first = int(model.body_jntadr[each])
        gone |= set(range(first, first + int(model.body_jntnum[each])))
    if "childclass" not in moved.attrib and above[1:] and inherited and inherited[0]:
        moved.set("childclass", inherited[0])
    _set_pose(moved)
    moved.insert(0, Xml.Element("freejoint", name=_FREE))
    world.remove(top)
    world.insert(0, moved)
    _forget(document, {names.joints[j] for j in gone}, {names.bodies[b] for b in above[1:]})
    columns = [
        joint.qpos + i
        for number, joint in enumerate(character.tree.joints)
        if number not in gone
        for i in range(_WIDTH[joint.kind])
    ]
    return np.array(columns, dtype=np.int64)


def _set_pose(element: Xml.Element) -> None:
    """At the world's origin: a free joint's own coordinates say where."""
    for name in ("pos", "quat", "euler", "axisangle", "xyaxes", "zaxis"):
        element.attrib.pop(name, None)


def _free_base(document: Xml.Element, character: Character, names: _Names) -> None:
    """Put all that belongs to the fixed character into one body on a free joint."""
    model, world = character.model, _world(document)
    base = Xml.Element("body", name=_FREE + "_base")
    base.append(Xml.Element("freejoint", name=_FREE))
    mine = _fixed_bodies(character)
    near = iter(_fixed_geoms(character))
    for element in list(world):
        if element.tag == "geom":
            take = next(near)
        else:
            take = element.tag == "body" and names.bodies.index(element.get("name", "")) in mine
        if take:
            world.remove(element)
            base.append(element)
    if len(base) == 2 and model.body_jntnum[character.root_body]:
        raise InputError(
            "it has no base that could stand on the floor: give the body or the world, to which "
            "its first joint is fixed, a geom with a mass"
        )
    world.insert(0, base)


def _fixed_geoms(character: Character) -> list[bool]:
    """Of the world's own geoms, in their order, whether they are a base and no floor."""
    model = character.model
    flat = (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD)
    data = mujoco.MjData(model)
    data.qpos[:] = character.reference_qpos
    mujoco.mj_kinematics(model, data)
    here = data.xpos[character.root_body]
    reach = _BASE_HEIGHTS * max(character.height, 1e-3)
    found = []
    for geom in np.flatnonzero(model.geom_bodyid == 0):
        turn = data.geom_xmat[geom].reshape(3, 3)
        box = model.geom_aabb[geom]
        middle, half = data.geom_xpos[geom] + turn @ box[:3], np.abs(turn) @ box[3:]
        small = half.max() < reach
        above = middle[2] + half[2] > character.floor_height + 1e-3
        near = bool((np.abs(here - middle) < half + reach / 3).all())
        found.append(model.geom_type[geom] not in flat and bool(small and above) and near)
    return found


def _fixed_bodies(character: Character) -> set[int]:
    """The root, and bodies without joints beside it that are near and small enough to be its."""
    model = character.model
    mine = {character.root_body}
    for body in np.flatnonzero(model.body_parentid == 0):
        whole = tree_bodies(model, int(body))
        if body == 0 or model.body_dofnum[whole].sum() or not model.body_geomnum[whole].sum():
            continue
        apart = np.linalg.norm(model.body_pos[body] - model.body_pos[character.root_body])
        size = model.geom_rbound[np.isin(model.geom_bodyid, whole)].max()
        if max(apart, size) < max(character.height, 1e-3):
            mine.add(int(body))
    return mine


def _forget(document: Xml.Element, joints: set[str], bodies: set[str]) -> None:
    """Take out what refers to joints and bodies that are no more."""
    for section in ("actuator", "sensor", "equality", "tendon", "contact"):
        for parent in document.findall(section):
            for element in list(parent):
                own = {element.get(n) for n in ("joint", "joint1", "joint2", "jointinparent")}
                inner = {e.get("joint") for e in element.iter()}
                touched = {element.get(n) for n in ("body", "body1", "body2", "objname")}
                if (own | inner) & joints or touched & bodies:
                    parent.remove(element)


def _compiled(
    document: Xml.Element, character: Character, names: _Names, columns: Ints, body: int
) -> FreeRoot:
    """Compile it, with the original's reference pose as its own."""
    for keys in document.findall("keyframe"):
        document.remove(keys)
    text = Xml.tostring(document, encoding="unicode")
    spec = mujoco.MjSpec.from_string(text)
    if character.path is not None:
        spec.modelfiledir = str(character.path.parent)
    model = spec.compile()
    order = _column_order(model, character, names, columns)
    assert character.source is not None
    made = character_of(character.source, model, character.name)
    freed = FreeRoot(made, character.tree, body, order)
    reference = freed.lift(character.reference_qpos[None])[0]
    spec.add_key(name="home", qpos=reference)
    made = character_of(character.source, spec.compile(), character.name)
    return replace(freed, character=made)


def _column_order(
    model: mujoco.MjModel, character: Character, names: _Names, columns: Ints
) -> Ints:
    """For each coordinate behind the free joint the original's column, by the joints' names."""
    wanted = set(columns.tolist())
    order = np.full(model.nq - 7, -1, dtype=np.int64)
    for number, joint in enumerate(character.tree.joints):
        if joint.qpos not in wanted:
            continue
        at = int(model.joint(names.joints[number]).qposadr[0]) - 7
        width = _WIDTH[joint.kind]
        order[at : at + width] = joint.qpos + np.arange(width)
    if (order < 0).any():
        raise InputError("joints of other moving bodies stand before the root's")
    return order


def _lowest(character: Character) -> float:
    """z (m) of the lowest point of the geometry in the reference pose."""
    data = mujoco.MjData(character.model)
    data.qpos[:] = character.reference_qpos
    mujoco.mj_kinematics(character.model, data)
    return lowest_and_highest(character.model, data, character.bodies)[0]
