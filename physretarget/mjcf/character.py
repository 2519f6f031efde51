"""A character: one MJCF model with what the stages need to know about it."""

from __future__ import annotations

import copy
import re
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from physretarget.capture.actor import CONTACT_POINTS
from physretarget.errors import InputError
from physretarget.kinematics import Tree
from physretarget.mjcf.convert import tree_of
from physretarget.mjcf.floor import find_floor
from physretarget.mjcf.points import Points, declared_points, generated_markers
from physretarget.mjcf.reference import lowest_and_highest, tree_bodies
from physretarget.mjcf.source import Source, read_source, source_of_text

__all__ = ["Character", "Points"]

Array = NDArray[np.float64]

REFERENCE_KEYFRAMES = ("home", "stand")


@dataclass(frozen=True, eq=False)
class Character:
    """A character as loaded from one MJCF file; see docs/characters.md for the annotations.

    Attributes:
        name: the model's name, or the file's.
        path: the file, None for a text.
        sha256: of the MJCF text, included files and assets.
        model: the compiled model. It is shared: read it, never write to it.
        tree: the same kinematic tree in plain NumPy.
        front, up: (3,) unit vectors in the root body's frame.
        floor_height: z of the floor (m); 0 where the file has none.
        has_floor: whether the file declares a floor: a plane, or the flat top of a box or of a
            height field.
        markers: virtual markers, declared as sites ``marker_*`` or three per moving body.
        contacts: declared contact points, sites ``contact_*``; may be empty.
        tied: for each contact point the actor's contact point it follows, or None.
        friction: sliding friction coefficient of the floor: what motion is made for.
        foot_friction: the same mixed with that of the geoms stood on, as MuJoCo does: what motion
            is judged by. At least ``friction``, but where priorities say otherwise.
        mass: of the root's tree (kg).
        height: vertical extent of its geometry in the reference pose (m).
        com_height: height of the centre of mass above the lowest point of the geometry in the
            reference pose (m).
        reference_qpos: (nq,) keyframe ``home`` or ``stand``, else the first, else qpos0.
        joint_names: (njnt) names, ``joint<i>`` where the file gives none.
        root_body: id of the tree's first body, a child of the world.
        has_root: whether the root moves on a free joint.
        lower, upper: (nq,) limits of hinges and slides, infinite where there are none.
        notes: what was assumed, one sentence each.
        source: the MJCF text it was compiled from.
    """

    name: str
    path: Path | None
    sha256: str
    model: mujoco.MjModel
    tree: Tree
    front: Array
    up: Array
    floor_height: float
    has_floor: bool
    markers: Points
    contacts: Points
    tied: tuple[str | None, ...]
    friction: float
    foot_friction: float
    mass: float
    height: float
    com_height: float
    reference_qpos: Array
    joint_names: tuple[str, ...]
    root_body: int
    has_root: bool
    lower: Array
    upper: Array
    notes: tuple[str, ...] = ()
    source: Source | None = field(default=None, repr=False)

    @classmethod
    def load(cls, path: str | PathLike[str], *, untrusted: bool = False) -> Character:
        """Read an MJCF file.

        ``untrusted`` refuses everything in the file that could run code, read outside the
        file's folder or take memory beyond any sensible model, by the checks of uploads.

        Args:
            path: The MJCF file.
            untrusted: Refuse what an upload may not contain.

        Returns:
            The character.

        Raises:
            InputError: the file cannot be read or compiled; names the line where one is known.
            UnsafeInputError: refused because untrusted.
        """
        file = Path(path)
        source = read_source(file, untrusted=untrusted)
        return character_of(source, _compiled(source), file.stem)

    @classmethod
    def from_xml(cls, text: str, *, name: str = "model") -> Character:
        """The same from a text. Assets are then found relative to the working directory.

        Args:
            text: The MJCF text.
            name: Name of a model that has none.

        Returns:
            The character.
        """
        source = source_of_text(text)
        return character_of(source, _compiled(source), name)

    @property
    def weight(self) -> float:
        """One body weight BW = m g (N)."""
        return self.mass * float(np.linalg.norm(self.model.opt.gravity))

    @property
    def root_dof(self) -> int:
        """The first degree of freedom of the root's free joint; meaningless without one."""
        return int(self.model.body_dofadr[self.root_body])

    @property
    def root_qpos(self) -> int:
        """Where the root's free joint begins in qpos; meaningless without one."""
        return int(self.model.jnt_qposadr[self.model.body_jntadr[self.root_body]])

    @cached_property
    def bodies(self) -> NDArray[np.int64]:
        """Ids of the bodies in the root's tree, the root first."""
        return tree_bodies(self.model, self.root_body)

    @cached_property
    def unconstrained(self) -> mujoco.MjModel:
        """A copy of the model without contacts, limits, equalities and joint friction.

        Inverse dynamics of recorded motion must not see them: 2 mm of penetration alone would
        make a dozen body weights of "contact". The copy is never written to afterwards.
        """
        model = copy.copy(self.model)
        off = mujoco.mjtDisableBit
        model.opt.disableflags |= (
            off.mjDSBL_CONSTRAINT
            | off.mjDSBL_CONTACT
            | off.mjDSBL_LIMIT
            | off.mjDSBL_EQUALITY
            | off.mjDSBL_FRICTIONLOSS
            | off.mjDSBL_SENSOR
        )
        model.opt.enableflags &= ~(
            mujoco.mjtEnableBit.mjENBL_INVDISCRETE | mujoco.mjtEnableBit.mjENBL_FWDINV
        )
        return model


def _compiled(source: Source) -> mujoco.MjModel:
    if source.assets:
        # MuJoCo keeps assets by path and second of change: one rewritten quickly would come
        # back as it was, against the hash.
        mujoco.mj_clearCache(mujoco.mj_getCache())
    try:
        if source.path is not None:
            return mujoco.MjModel.from_xml_path(str(source.path))
        return mujoco.MjModel.from_xml_string(source.text)
    except (ValueError, mujoco.FatalError) as error:
        text = " ".join(str(error).split())
        line = re.search(r"[Ll]ine(?: number)?[ =](\d+)", text)
        text = re.sub(r"^(XML )?Error: ", "", text)
        raise InputError(
            f"MuJoCo cannot build the model: {text}",
            path=source.path,
            line=int(line.group(1)) if line else None,
        ) from error


def character_of(source: Source, model: mujoco.MjModel, fallback: str) -> Character:
    """A character of a compiled model; ``fallback`` names one that names itself nothing."""
    notes = list(source.notes)
    try:
        root, has_root = _root(model, notes)
        data = mujoco.MjData(model)
        data.qpos[:] = _reference_qpos(model)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        bodies = tree_bodies(model, root)
        low, high = lowest_and_highest(model, data, bodies)
        told = _numeric(model, "friction", 1)
        floor, friction, mixed = find_floor(model, data, bodies, told, notes)
        markers = declared_points(model, "marker_")
        if not len(markers):
            moving = bodies[model.body_jntnum[bodies] > 0]
            markers = generated_markers(model, moving, max(high - low, 1e-3))
        contacts = declared_points(model, "contact_")
        lower, upper = _bounds(model)
        return Character(
            name=_name(model) or fallback,
            path=source.path,
            sha256=source.sha256,
            model=model,
            tree=tree_of(model),
            front=_direction(model, "front", (1.0, 0.0, 0.0)),
            up=_direction(model, "up", (0.0, 0.0, 1.0)),
            floor_height=0.0 if floor is None else floor,
            has_floor=floor is not None,
            markers=markers,
            contacts=contacts,
            tied=_tied(model, contacts),
            friction=friction,
            foot_friction=mixed,
            mass=float(model.body_mass[bodies].sum()),
            height=high - low,
            com_height=float(data.subtree_com[root, 2]) - low,
            reference_qpos=_fixed(data.qpos),
            joint_names=tuple(model.joint(i).name or f"joint{i}" for i in range(model.njnt)),
            root_body=root,
            has_root=has_root,
            lower=lower,
            upper=upper,
            notes=tuple(notes),
            source=source,
        )
    except InputError as error:
        raise InputError(error.message, path=source.path) from error


def _fixed(values: Array) -> Array:
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


def _name(model: mujoco.MjModel) -> str:
    name = model.names.split(b"\0", 1)[0].decode()
    return "" if name == "MuJoCo Model" else name


def _root(model: mujoco.MjModel, notes: list[str]) -> tuple[int, bool]:
    """The tree to act: the heaviest on a free joint, else the one with most joints."""
    if model.njnt == 0:
        raise InputError("the model has no joint, so there is nothing to animate")
    roots = [int(i) for i in np.flatnonzero(model.body_parentid == 0) if i > 0]
    dofs = {i: sum(model.body_dofnum[tree_bodies(model, i)]) for i in roots}
    moving = [i for i in roots if dofs[i] > 0]
    free = [
        i
        for i in moving
        if model.body_jntnum[i]
        and model.jnt_type[model.body_jntadr[i]] == mujoco.mjtJoint.mjJNT_FREE
    ]
    # A prop on a free joint has no joints of its own: the character is the tree that has most.
    root = max(free or moving, key=lambda i: (dofs[i], model.body_subtreemass[i], -i))
    if not free:
        joints = model.jnt_type[model.jnt_bodyid == root]
        moves = bool((joints == mujoco.mjtJoint.mjJNT_SLIDE).any())
        held = "moves on slides that the world holds" if moves else "stands fixed in the world"
        notes.append(f"no free joint: body {model.body(root).name!r} {held}")
    others = [model.body(i).name or f"body{i}" for i in moving if i != root]
    if others:
        notes.append(f"other moving trees are not counted to the character: {', '.join(others)}")
    return root, bool(free)


def _reference_qpos(model: mujoco.MjModel) -> Array:
    names = [model.key(i).name for i in range(model.nkey)]
    for name in REFERENCE_KEYFRAMES:
        if name in names:
            return np.array(model.key_qpos[names.index(name)])
    return np.array(model.key_qpos[0] if names else model.qpos0)


def _bounds(model: mujoco.MjModel) -> tuple[Array, Array]:
    lower, upper = np.full(model.nq, -np.inf), np.full(model.nq, np.inf)
    kinds = mujoco.mjtJoint
    scalar = (model.jnt_type == kinds.mjJNT_HINGE) | (model.jnt_type == kinds.mjJNT_SLIDE)
    limited = np.flatnonzero(scalar & model.jnt_limited.astype(bool))
    at = model.jnt_qposadr[limited]
    lower[at], upper[at] = model.jnt_range[limited].T
    return _fixed(lower), _fixed(upper)


def _numeric(model: mujoco.MjModel, name: str, size: int) -> Array | None:
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, name)
    if index < 0:
        return None
    start, count = model.numeric_adr[index], model.numeric_size[index]
    if count != size:
        raise InputError(f"custom numeric {name!r} has {count} values, {size} are needed")
    return np.array(model.numeric_data[start : start + count])


def _direction(model: mujoco.MjModel, name: str, default: tuple[float, float, float]) -> Array:
    told = _numeric(model, name, 3)
    vector = np.array(default) if told is None else told
    length = np.linalg.norm(vector)
    if not 1e-6 < length < np.inf:
        raise InputError(f"custom numeric {name!r} is no direction: {vector.tolist()}")
    return _fixed(vector / length)


def _tied(model: mujoco.MjModel, contacts: Points) -> tuple[str | None, ...]:
    tied: list[str | None] = []
    for name in contacts.names:
        index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TEXT, name)
        if index < 0:
            tied.append(None)
            continue
        start, size = model.text_adr[index], model.text_size[index]
        point = bytes(model.text_data[start : start + size]).rstrip(b"\0").decode().strip()
        if point not in CONTACT_POINTS:
            raise InputError(
                f"{name!r} is tied to {point!r}, which is no contact point of the actor: "
                f"{', '.join(CONTACT_POINTS)}"
            )
        tied.append(point)
    return tuple(tied)
