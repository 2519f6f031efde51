"""A character from a robot's file: URDF or MJCF in, one annotated MJCF out.

What a character needs and such files lack is guessed from the geometry, and every guess is said: a
free root, a floor, where the front is, what stands on the floor and for which of the actor's feet,
the face, limits of joints, masses.
"""

from __future__ import annotations

import re
import shutil
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from physretarget.errors import InputError
from physretarget.files import write_file
from physretarget.ground.undersides import lowest_heights, solids, undersides
from physretarget.ground.wrench import centre_of_mass
from physretarget.kinematics import Pose, forward, matrix_to_quat
from physretarget.mjcf.character import Character, character_of
from physretarget.mjcf.reference import tree_bodies
from physretarget.mjcf.source import Source, read_source

__all__ = ["NewCharacter", "make_character"]

Array = NDArray[np.float64]

_FACE = re.compile(r"head|face|eye|camera|beak|snout", re.IGNORECASE)
# These turn without end.
_TURNS_ON = re.compile(r"wheel|roller|caster|propeller|rotor", re.IGNORECASE)
# A joint without limits gets these: most of what joints of creatures do.
_HINGE_DEG, _SLIDE_M = 60.0, 0.1
# What reaches down to this share of the height from the lowest point stands on the floor.
_STANDS = 0.03
# A body that is wider than this share of the height stands on four corners or two sides; one that
# is longer than that on a toe and a heel, else on one point.
_WIDE, _LONG = 0.15, 0.04
# A head this far before the middle, as a share of the height, says where the front is.
_BEFORE = 0.05
_DENSITY = 500.0  # kg/m3: half of water, plastic shells and light metal


@dataclass(frozen=True)
class NewCharacter:
    """The file that was written, and what was guessed, a sentence each."""

    path: Path
    notes: tuple[str, ...]


@dataclass
class _Draft:
    """A model under way."""

    spec: mujoco.MjSpec
    path: Path
    source: Source
    notes: list[str] = field(default_factory=list)

    def character(self) -> Character:
        """The model so far."""
        try:
            return character_of(self.source, self.spec.compile(), self.path.stem)
        except (ValueError, mujoco.FatalError) as error:
            raise InputError(
                f"MuJoCo cannot compile it: {' '.join(str(error).split())}", path=self.path
            ) from error


def make_character(
    path: str | Path, out: str | Path, *, front: str | None = None, up: str = "+z"
) -> NewCharacter:
    """Write a character of a URDF or MJCF file.

    Args:
        path: the robot's file. Its meshes are copied into a folder beside ``out``.
        out: the MJCF to write.
        front: ``+x``, ``-x``, ``+y``, ``-y``, ``+z`` or ``-z`` in the frame of its root; guessed if
            None.
        up: ``+z`` or ``+y``, in the frame of its root.

    Raises:
        InputError: the file cannot be read, or has no part that could be a root.
    """
    path, out = Path(path), Path(out)
    draft = _read(path)
    root = _free_root(draft)
    _add_masses(draft)
    if up != "+z":
        root.quat = _UPRIGHT[up]
    _limit_joints(draft)
    heading = _front(draft, front)
    _put_on_floor(draft, root)
    _contact_points(draft, heading)
    _face(draft, heading)
    assets = out.with_name(f"{out.stem}-assets")
    _copy_meshes(draft, assets)
    write_file(out, _text(draft, out, assets).encode())
    return NewCharacter(out, (*draft.notes, *Character.load(out).notes))


def _read(path: Path) -> _Draft:
    if path.suffix.lower() not in (".urdf", ".xml", ".mjcf"):
        raise InputError("is no URDF (.urdf) and no MJCF (.xml)", path=path)
    source = read_source(path, untrusted=path.suffix.lower() != ".urdf")
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
    return _Draft(spec, path, source)


def _add_masses(draft: _Draft) -> None:
    """Bodies that move and have no mass of their own get it from their geometry."""
    bare = [body for body in draft.spec.bodies if body.id != 0 and not body.mass > 0 and body.geoms]
    # In MJCF a geom's density is the author's word; URDF knows none.
    if not bare or (draft.path.suffix.lower() != ".urdf" and _compiles(draft.spec)):
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
        raise InputError("has no moving part, so no character can be made of it", path=draft.path)
    if len(tops) > 1:
        names = ", ".join(repr(body.name) for body in tops)
        raise InputError(
            f"has {len(tops)} moving parts side by side ({names}); a character has one root",
            path=draft.path,
        )
    root = tops[0]
    joints = list(root.joints)
    if any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in joints):
        return root
    if joints:
        raise InputError(
            f"its first joint {joints[0].name!r} hangs in the world: give what stands on the floor "
            "a body with a geom, above that joint",
            path=draft.path,
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


def _front(draft: _Draft, told: str | None) -> Array:
    """The front in the root's frame: where the head is before the middle, else +x."""
    if any(each.name == "front" for each in draft.spec.numerics):
        return np.asarray(draft.character().front)
    if told is not None:
        front = _FRONTS[told]
    else:
        front, why = _guessed_front(draft.character())
        draft.notes.append(f"the front is taken to be {why}; --front says otherwise")
    draft.spec.add_numeric(name="front", data=front.tolist(), size=3)
    return front


def _guessed_front(character: Character) -> tuple[Array, str]:
    pose = _first_pose(character)
    turn = pose.rotation[0, character.root_body]
    level = {name: axis for name, axis in _FRONTS.items() if abs((turn @ axis)[2]) < 0.5}
    head = _head(character)
    if head is not None:
        place = pose.position[0, head] + pose.rotation[0, head] @ character.model.body_ipos[head]
        way = turn.T @ (place - centre_of_mass(character, pose)[0])
        best = max(level, key=lambda name: float(level[name] @ way))
        if float(level[best] @ way) > _BEFORE * character.height:
            return level[best], f"{best}, where {character.model.body(head).name!r} is"
    first = next(iter(level))
    return level[first], first


def _first_pose(character: Character) -> Pose:
    return forward(character.tree, character.reference_qpos[None])


def _head(character: Character) -> int | None:
    """The last body that is called a head."""
    named = [b for b in character.bodies.tolist() if _FACE.search(character.model.body(b).name)]
    return named[-1] if named else None


def _put_on_floor(draft: _Draft, root: mujoco.MjsBody) -> None:
    """A floor at z = 0 where there is none, and the lowest point on the floor at first."""
    if not any(g.type == mujoco.mjtGeom.mjGEOM_PLANE for g in draft.spec.worldbody.geoms):
        draft.spec.worldbody.add_geom(
            name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1]
        )
        draft.notes.append("it had no floor: a plane at z = 0")
    character = draft.character()
    lowest = lowest_heights(solids(character), _first_pose(character)).min()
    root.pos = np.asarray(root.pos) + np.array([0.0, 0.0, character.floor_height - lowest])


def _contact_points(draft: _Draft, front: Array) -> None:
    """Sites where bodies stand, tied to the actor's toes and heels by side and by front."""
    if any(site.name.startswith("contact_") for site in draft.spec.sites):
        return
    character = draft.character()
    model, pose = character.model, _first_pose(character)
    ahead = pose.rotation[0, character.root_body] @ front
    left = np.cross([0.0, 0.0, 1.0], ahead)
    under = undersides(character)
    places = under.lowest(pose)[0]
    found = {
        body: _standing(character, places[under.body == body], ahead, left)
        for body in under.bodies.tolist()
    }
    made = [
        (body, place)
        for body in found
        if not _stands_on_another(model, body, found)
        for place in found[body]
    ]
    middle = centre_of_mass(character, pose)[0]
    by_name = {body.name: body for body in draft.spec.bodies}
    counts: Counter[str] = Counter()
    for body, place in made:
        on_left = (place - middle) @ left >= 0
        mine = [p @ ahead for _, p in made if ((p - middle) @ left >= 0) == on_left]
        part = "toe" if place @ ahead >= np.mean(mine) - 1e-9 else "heel"
        tie = f"{'left' if on_left else 'right'}_{part}"
        counts[tie] += 1
        name = f"contact_{tie}" + ("" if counts[tie] == 1 else f"_{counts[tie]}")
        local = pose.rotation[0, body].T @ (place - pose.position[0, body])
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
    below = tree_bodies(model, body).tolist()
    return any(other != body and bool(found.get(other)) for other in below)


def _standing(character: Character, points: Array, ahead: Array, left: Array) -> list[Array]:
    """Where a body stands: the outermost of its lowest points (n, 3); none if it does not."""
    height = character.height
    points = points[points[:, 2] < character.floor_height + _STANDS * height]
    if not len(points):
        return []
    long, wide = np.ptp(points @ ahead), np.ptp(points @ left)
    if wide > _WIDE * height:
        across = [left, -left]
        ways = [a + b for a in (ahead, -ahead) for b in across] if long > _WIDE * height else across
    else:
        ways = [ahead, -ahead] if long > _LONG * height else [ahead]
    return [points[int(np.argmax(points @ way))] for way in ways]


def _face(draft: _Draft, front: Array) -> None:
    """A site that looks ahead on what is called a head, and the text that names it."""
    if any(text.name == "face" for text in draft.spec.texts):
        return
    character = draft.character()
    body = _head(character)
    if body is None:
        draft.notes.append(
            "nothing is called a head: without a face (docs/characters.md) the gaze is the root's"
        )
        return
    pose = _first_pose(character)
    ahead = pose.rotation[0, character.root_body] @ front
    up = np.array([0.0, 0.0, 1.0])
    frame = pose.rotation[0, body].T @ np.stack([ahead, np.cross(up, ahead), up], axis=1)
    name = character.model.body(body).name
    owner = next(each for each in draft.spec.bodies if each.name == name)
    owner.add_site(
        name="gaze", pos=np.array(character.model.body_ipos[body]).tolist(),
        quat=matrix_to_quat(frame).tolist(), group=3,
    )  # fmt: skip
    draft.spec.add_text(name="face", data="gaze")
    draft.notes.append(f"the face is {name!r}, looking to the front in the first pose")


def _copy_meshes(draft: _Draft, folder: Path) -> None:
    """Copy mesh and texture files beside the character, under names without folders."""
    base = draft.path.parent / (draft.spec.meshdir or "")
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
            f"MuJoCo cannot write it: {' '.join(str(error).split())}", path=draft.path
        ) from error
    return text
