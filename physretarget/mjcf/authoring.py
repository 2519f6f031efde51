"""A character from a robot's file: URDF or MJCF in, one annotated MJCF out.

What a character needs and such files lack is guessed from the geometry, and every guess is said: a
free root, a floor, where the front is, what stands on the floor and for which of the actor's feet,
the face, limits of joints, masses.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from physretarget.errors import InputError
from physretarget.files import write_file
from physretarget.mjcf.character import Character
from physretarget.mjcf.reference import lowest_and_highest, tree_bodies
from physretarget.mjcf.source import read_source

__all__ = ["Authored", "author_character"]

Array = NDArray[np.float64]

_FACE = re.compile(r"head|face|eye|camera|beak|snout", re.IGNORECASE)
# These turn without end.
_TURNS_ON = re.compile(r"wheel|roller|caster|propeller|rotor", re.IGNORECASE)
# A joint without limits gets these: most of what joints of creatures do.
_HINGE_DEG, _SLIDE_M = 60.0, 0.1
# What reaches down to this share of the height from the lowest point stands on the floor.
_STANDS = 0.03
# A body that stands and is wider than this share of the height stands on four corners, else on two.
_WIDE = 0.15
_DENSITY = 500.0  # kg/m3: half of water, plastic shells and light metal


@dataclass(frozen=True)
class Authored:
    """The file that was written, and what was guessed, a sentence each."""

    path: Path
    notes: tuple[str, ...]


@dataclass
class _Draft:
    """A model under way."""

    spec: mujoco.MjSpec
    source: Path
    notes: list[str] = field(default_factory=list)

    def compiled(self) -> tuple[mujoco.MjModel, mujoco.MjData]:
        """The model so far, in its first pose."""
        try:
            model = self.spec.compile()
        except (ValueError, mujoco.FatalError) as error:
            raise InputError(
                f"MuJoCo cannot compile it: {' '.join(str(error).split())}", path=self.source
            ) from error
        data = mujoco.MjData(model)
        mujoco.mj_resetData(model, data)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        return model, data


def author_character(
    source: str | Path, out: str | Path, *, front: str | None = None, up: str = "+z"
) -> Authored:
    """Write a character of a URDF or MJCF file.

    Args:
        source: the robot's file. Its meshes are copied into a folder beside ``out``.
        out: the MJCF to write.
        front: ``+x``, ``-x``, ``+y``, ``-y``, ``+z`` or ``-z`` in the frame of its root; guessed if
            None.
        up: ``+z`` or ``+y``, in the frame of its root.

    Raises:
        InputError: the file cannot be read, or has no part that could be a root.
    """
    source, out = Path(source), Path(out)
    draft = _Draft(_read(source), source)
    root = _free_root(draft)
    _add_masses(draft)
    if up != "+z":
        root.quat = _UPRIGHT[up]
    _limit_joints(draft)
    heading = _front(draft, root, front)
    _put_on_floor(draft, root)
    _contact_points(draft, root, heading)
    _face(draft, root, heading)
    assets = out.with_name(f"{out.stem}-assets")
    _copy_meshes(draft, assets)
    text = _text(draft, out, assets)
    write_file(out, text.encode())
    character = Character.load(out)
    return Authored(out, (*draft.notes, *character.notes))


def _read(path: Path) -> mujoco.MjSpec:
    if path.suffix.lower() not in (".urdf", ".xml", ".mjcf"):
        raise InputError("is no URDF (.urdf) and no MJCF (.xml)", path=path)
    read_source(path, untrusted=path.suffix.lower() != ".urdf")
    try:
        spec = mujoco.MjSpec.from_file(str(path))
    except (ValueError, mujoco.FatalError) as error:
        raise InputError(
            f"MuJoCo cannot read it: {' '.join(str(error).split())}", path=path
        ) from error
    # A base that is fused with the world can stand on no floor; URDF's default is to fuse.
    spec.compiler.fusestatic = False
    spec.compiler.discardvisual = False
    spec.compiler.balanceinertia = True
    return spec


def _add_masses(draft: _Draft) -> None:
    """Bodies that move and have no mass of their own get it from their geometry."""
    bare = [body for body in draft.spec.bodies if body.id != 0 and not body.mass > 0 and body.geoms]
    # In MJCF a geom's density is the author's word; URDF knows none.
    if not bare or (draft.source.suffix.lower() != ".urdf" and _compiles(draft.spec)):
        return
    for body in bare:
        # What the compiler finds to be no number it takes from the geometry.
        body.explicitinertial = False
        body.mass, body.ipos, body.fullinertia = np.nan, [np.nan, 0, 0], [np.nan] * 6
        collides = [bool(geom.contype or geom.conaffinity) for geom in body.geoms]
        for geom, counts in zip(body.geoms, collides, strict=True):
            # What is drawn besides has no mass of its own.
            geom.mass, geom.density = np.nan, _DENSITY if counts or not any(collides) else 0.0
    draft.spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
    draft.notes.append(
        f"{', '.join(body.name for body in bare)} had no mass: it is that of the geometry at "
        f"{_DENSITY:g} kg/m³"
    )


def _compiles(spec: mujoco.MjSpec) -> bool:
    try:
        spec.compile()
    except (ValueError, mujoco.FatalError):
        return False
    return True


def _free_root(draft: _Draft) -> mujoco.MjsBody:
    """The root's body, on a free joint."""
    tops = [body for body in _children(draft.spec.worldbody) if _joints_below(body)]
    if not tops:
        raise InputError("has no moving part, so no character can be made of it", path=draft.source)
    if len(tops) > 1:
        names = ", ".join(repr(body.name) for body in tops)
        raise InputError(
            f"has {len(tops)} moving parts side by side ({names}); a character has one root",
            path=draft.source,
        )
    root = tops[0]
    joints = list(root.joints)
    if any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in joints):
        return root
    if joints:
        raise InputError(
            f"its first joint {joints[0].name!r} hangs in the world: give what stands on the floor "
            "a body with a geom, above that joint",
            path=draft.source,
        )
    root.add_freejoint(name="root")
    draft.notes.append(f"{root.name!r} was fixed to the world: it is the free root now")
    return root


def _children(body: mujoco.MjsBody) -> Iterator[mujoco.MjsBody]:
    each = body.first_body()
    while each is not None:
        yield each
        each = body.next_body(each)


def _joints_below(body: mujoco.MjsBody) -> bool:
    return bool(body.joints) or any(_joints_below(each) for each in _children(body))


def _limit_joints(draft: _Draft) -> None:
    guessed = []
    for joint in draft.spec.joints:
        hinge = joint.type == mujoco.mjtJoint.mjJNT_HINGE
        moves = hinge or joint.type == mujoco.mjtJoint.mjJNT_SLIDE
        if not moves or _TURNS_ON.search(joint.name):
            continue
        low, high = (float(value) for value in joint.range)
        off = joint.limited == mujoco.mjtLimited.mjLIMITED_FALSE
        if high > low and not off:
            continue
        reach = _HINGE_DEG if hinge else _SLIDE_M
        # MjSpec keeps angles as the file has them.
        scale = 1.0 if draft.spec.compiler.degree or not hinge else np.pi / 180
        joint.range = [-reach * scale, reach * scale]
        joint.limited = mujoco.mjtLimited.mjLIMITED_TRUE
        guessed.append(joint.name)
    if guessed:
        draft.notes.append(
            f"{', '.join(guessed)} had no limits: ±{_HINGE_DEG:g} degrees for hinges and "
            f"±{_SLIDE_M:g} m for slides are a guess"
        )


_FRONTS = {
    "+x": np.array([1.0, 0, 0]), "-x": np.array([-1.0, 0, 0]), "+y": np.array([0, 1.0, 0]),
    "-y": np.array([0, -1.0, 0]), "+z": np.array([0, 0, 1.0]), "-z": np.array([0, 0, -1.0]),
}  # fmt: skip


# (w, x, y, z) of a root that stands, by the axis of its frame that points up.
_UPRIGHT = {"+y": [0.5**0.5, 0.5**0.5, 0.0, 0.0]}


def _front(draft: _Draft, root: mujoco.MjsBody, told: str | None) -> Array:
    """The front in the root's frame: where the head is before the middle, else +x."""
    known = next((each for each in draft.spec.numerics if each.name == "front"), None)
    if known is not None:
        return np.asarray(known.data, dtype=np.float64)[:3]
    if told is not None:
        front = _FRONTS[told]
    else:
        model, data = draft.compiled()
        front, why = _guessed_front(model, data, root.name)
        draft.notes.append(f"the front is taken to be {why}; --front says otherwise")
    draft.spec.add_numeric(name="front", data=front.tolist(), size=3)
    return front


def _guessed_front(model: mujoco.MjModel, data: mujoco.MjData, root: str) -> tuple[Array, str]:
    number = model.body(root).id
    bodies = tree_bodies(model, number)
    heads = [b for b in bodies.tolist() if _FACE.search(model.body(b).name)]
    turn = data.xmat[number].reshape(3, 3)
    level = {name: axis for name, axis in _FRONTS.items() if abs((turn @ axis)[2]) < 0.5}
    if heads:
        way = turn.T @ (data.xipos[heads[-1]] - data.subtree_com[number])
        best = max(level, key=lambda name: float(level[name] @ way))
        low, high = lowest_and_highest(model, data, bodies)
        if float(_FRONTS[best] @ way) > 0.05 * (high - low):
            return _FRONTS[best], f"{best}, where {model.body(heads[-1]).name!r} is"
    first = next(iter(level))
    return level[first], first


def _put_on_floor(draft: _Draft, root: mujoco.MjsBody) -> None:
    """A floor at z = 0, and the lowest point on it in the first pose."""
    planes = [g for g in draft.spec.worldbody.geoms if g.type == mujoco.mjtGeom.mjGEOM_PLANE]
    if not planes:
        draft.spec.worldbody.add_geom(
            name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1]
        )
        draft.notes.append("it had no floor: a plane at z = 0")
    model, data = draft.compiled()
    low, _ = lowest_and_highest(model, data, tree_bodies(model, model.body(root.name).id))
    floor = float(planes[0].pos[2]) if planes else 0.0
    root.pos = np.asarray(root.pos) + np.array([0.0, 0.0, floor - low])


def _contact_points(draft: _Draft, root: mujoco.MjsBody, front: Array) -> None:
    """Sites where bodies stand, tied to the actor's toes and heels by side and by front."""
    if any(site.name.startswith("contact_") for site in draft.spec.sites):
        return
    model, data = draft.compiled()
    number = model.body(root.name).id
    turn = data.xmat[number].reshape(3, 3)
    ahead = turn @ front
    left = np.cross([0.0, 0.0, 1.0], ahead)
    bodies = tree_bodies(model, number)
    low, high = lowest_and_highest(model, data, bodies)
    height = high - low
    middle = data.subtree_com[number]
    found = {
        body: _standing(model, data, body, low, height, ahead, left) for body in bodies.tolist()
    }
    made = [
        (body, place)
        for body in found
        if not _stands_on_another(model, body, found)
        for place in found[body]
    ]
    by_name = {body.name: body for body in draft.spec.bodies}
    counts: dict[str, int] = {}
    for body, place in made:
        side = "left" if (place - middle) @ left >= 0 else "right"
        mine = [p @ ahead for b, p in made if ((p - middle) @ left >= 0) == (side == "left")]
        part = "toe" if place @ ahead >= np.mean(mine) - 1e-9 else "heel"
        tie = f"{side}_{part}"
        counts[tie] = counts.get(tie, 0) + 1
        name = f"contact_{tie}" + ("" if counts[tie] == 1 else f"_{counts[tie]}")
        local = data.xmat[body].reshape(3, 3).T @ (place - data.xpos[body])
        by_name[model.body(body).name].add_site(name=name, pos=local.tolist(), group=3)
        draft.spec.add_text(name=name, data=tie)
    if made:
        draft.notes.append(
            f"{len(made)} contact points on "
            f"{', '.join(dict.fromkeys(model.body(b).name for b, _ in made))}: what is lowest in "
            "the first pose stands for the actor's toes in front, for its heels behind"
        )


def _stands_on_another(model: mujoco.MjModel, body: int, found: dict[int, list[Array]]) -> bool:
    """Whether a body below it in its limb reaches as low: a shank behind its toe."""
    return any(
        other != body and found[other] and body in _ancestors(model, other) for other in found
    )


def _ancestors(model: mujoco.MjModel, body: int) -> set[int]:
    above = set()
    while body:
        body = int(model.body_parentid[body])
        above.add(body)
    return above


def _standing(
    model: mujoco.MjModel, data: mujoco.MjData, body: int, low: float, height: float,
    ahead: Array, left: Array,
) -> list[Array]:  # fmt: skip
    """Where a body stands: the outermost of its lowest points; none if it does not."""
    points = np.concatenate([*_surface(model, data, body), np.zeros((0, 3))])
    points = points[points[:, 2] < low + _STANDS * height] if len(points) else points
    if not len(points):
        return []
    x, y = points @ ahead, points @ left
    long, wide = np.ptp(x) > _WIDE * height, np.ptp(y) > _WIDE * height
    ways = [ahead + left, ahead - left, -ahead + left, -ahead - left]
    if not wide:
        ways = [ahead, -ahead] if np.ptp(x) > 0.25 * _WIDE * height else [ahead]
    elif not long:
        ways = [left, -left]
    return [points[int(np.argmax(points @ way))] for way in ways]


def _surface(model: mujoco.MjModel, data: mujoco.MjData, body: int) -> Iterator[Array]:
    """(n, 3) points of a body's geoms in the world: corners, rims and undersides."""
    for geom in np.flatnonzero(model.geom_bodyid == body).tolist():
        kind, size = int(model.geom_type[geom]), np.array(model.geom_size[geom])
        turn, place = data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom]
        if kind == mujoco.mjtGeom.mjGEOM_MESH:
            mesh = int(model.geom_dataid[geom])
            first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
            local = np.array(model.mesh_vert[first : first + count], dtype=np.float64)
        elif kind == mujoco.mjtGeom.mjGEOM_BOX:
            local = np.array(np.meshgrid([-1.0, 1], [-1.0, 1], [-1.0, 1])).reshape(3, 8).T * size
        elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
            angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
            ring = np.c_[size[0] * np.cos(angle), size[0] * np.sin(angle)]
            local = np.concatenate([np.c_[ring, np.full(24, end * size[1])] for end in (-1, 1)])
        elif kind in (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_CAPSULE):
            ends = [-size[1], size[1]] if kind == mujoco.mjtGeom.mjGEOM_CAPSULE else [0.0]
            down = turn.T @ [0.0, 0.0, -size[0]]
            local = np.array([down + np.array([0.0, 0.0, end]) for end in ends])
        elif kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            along = turn.T @ [0.0, 0.0, -1.0]
            local = (size**2 * along / np.linalg.norm(size * along))[None]
        else:
            continue
        yield place + local @ turn.T


def _face(draft: _Draft, root: mujoco.MjsBody, front: Array) -> None:
    """A site that looks ahead on what is called a head, and the text that names it."""
    if any(text.name == "face" for text in draft.spec.texts):
        return
    model, data = draft.compiled()
    number = model.body(root.name).id
    bodies = [b for b in tree_bodies(model, number).tolist() if _FACE.search(model.body(b).name)]
    if not bodies:
        draft.notes.append(
            "nothing is called a head: without a face (docs/characters.md) the gaze is the root's"
        )
        return
    body = bodies[-1]
    ahead = data.xmat[number].reshape(3, 3) @ front
    up = np.array([0.0, 0.0, 1.0])
    frame = data.xmat[body].reshape(3, 3).T @ np.stack([ahead, np.cross(up, ahead), up], axis=1)
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, frame.ravel())
    owner = next(b for b in draft.spec.bodies if b.name == model.body(body).name)
    owner.add_site(
        name="gaze", pos=np.array(model.body_ipos[body]).tolist(), quat=quat.tolist(), group=3
    )
    draft.spec.add_text(name="face", data="gaze")
    draft.notes.append(f"the face is {owner.name!r}, looking to the front in the first pose")


def _copy_meshes(draft: _Draft, folder: Path) -> None:
    """Copy mesh and texture files beside the character, under names without folders."""
    base = draft.source.parent / (draft.spec.meshdir or "")
    files = [mesh for mesh in draft.spec.meshes if mesh.file]
    taken: dict[str, Path] = {}
    for mesh in files:
        path = (base / mesh.file).resolve()
        name, number = path.name, 1
        while taken.get(name, path) != path:
            number += 1
            name = f"{path.stem}-{number}{path.suffix}"
        taken[name] = path
        mesh.file = name
    if taken:
        folder.mkdir(parents=True, exist_ok=True)
        for name, path in taken.items():
            shutil.copyfile(path, folder / name)


def _text(draft: _Draft, out: Path, assets: Path) -> str:
    spec = draft.spec
    spec.modelname = out.stem
    if assets.is_dir():
        spec.meshdir = assets.name
        spec.modelfiledir = str(out.parent)
    try:
        spec.compile()
        text: str = spec.to_xml()
    except (ValueError, mujoco.FatalError) as error:
        raise InputError(
            f"MuJoCo cannot write it: {' '.join(str(error).split())}", path=draft.source
        ) from error
    return text
