"""How low a character's bodies reach, and with what they can touch the floor.

Every primitive is a few points, each grown by one ellipsoid (a Minkowski sum): a sphere is a
point and a ball, a capsule two, a cylinder two and a flat disc, an ellipsoid one, a box eight
bare corners, a mesh its vertices. The lowest point of a sum is the sum of the lowest points: a
:class:`Solid` says exactly how low a geom reaches.

What stands flat on a disc bears on its whole rim, of which a lowest point knows nothing:
:class:`Undersides` has points on the rim besides, and holds all that may touch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

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


@lru_cache(maxsize=8)
def bearing_solids(character: Character) -> tuple[Solid, ...]:
    """The geoms that can collide with the floor, all of them where none can."""
    model, found = character.model, solids(character)
    geoms = [
        g
        for g in np.flatnonzero(np.isin(model.geom_bodyid, character.bodies))
        if _shape(model, int(g)) is not None
    ]
    bears = np.isin(geoms, colliding_geoms(character))
    return tuple(s for s, b in zip(found, bears, strict=True) if b) or found


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


@dataclass(frozen=True, eq=False)
class Undersides:
    """Points that may touch the floor: body (K,), local (K, 3) m in the body frame.

    ``radius`` (K,) m of a ball around the point, ``axes`` (K, 3) an ellipsoid's semi-axes and
    zero elsewhere, ``frame`` (K, 3, 3) its rotation in the body. ``friction`` (K,) is the
    coefficient between geom and floor. ``twist`` (bodies of the model, 2) m says how far about the
    vertical, and about what lies along the floor, a body's contacts resist turning: see
    :func:`_twist`. ``source`` says where the points came from. Points stand in the order of their
    bodies.
    """

    body: Ints
    local: Floats
    radius: Floats
    axes: Floats
    frame: Floats
    friction: Floats
    twist: Floats
    source: str

    def __len__(self) -> int:
        return len(self.body)

    @property
    def bodies(self) -> Ints:
        """Distinct bodies, ascending."""
        return np.unique(self.body)

    def of_body(self, body: int) -> Undersides:
        """The points of one body."""
        rows = self.body == body
        return Undersides(
            self.body[rows], self.local[rows], self.radius[rows], self.axes[rows],
            self.frame[rows], self.friction[rows], self.twist, self.source,
        )  # fmt: skip

    def heights(self, pose: kinematics.Pose) -> Floats:
        """(T, K) z of the lowest points, m, of points that all belong to one body: cheap."""
        body = int(self.body[0])
        upward = pose.rotation[:, body, 2]
        height: Floats = pose.position[:, body, 2, None] + upward @ self.local.T - self.radius
        for k in np.flatnonzero(self.axes.any(axis=1)):
            height[:, k] -= np.linalg.norm(self.axes[k] * (upward @ self.frame[k]), axis=1)
        return height

    def lowest(self, pose: kinematics.Pose) -> Floats:
        """(T, K, 3) world position of the lowest point around every point, m."""
        place = pose.position[:, self.body]
        turn = pose.rotation[:, self.body]
        world: Floats = place + np.einsum("tkij,kj->tki", turn, self.local)
        world[..., 2] -= self.radius
        for k in np.flatnonzero(self.axes.any(axis=1)):
            # Lowest point of an ellipsoid: centre - A^2 n / |A n|, n = up in its frame.
            axes = pose.rotation[:, self.body[k]] @ self.frame[k]
            scaled = self.axes[k] * axes[:, 2, :]
            reach = np.maximum(np.linalg.norm(scaled, axis=1, keepdims=True), _FLAT)
            world[:, k] -= np.einsum("tij,tj->ti", axes, self.axes[k] * scaled / reach)
        return world


# A rim of 24 points is within 0.9 % of the radius of a circle.
_RIM = 24
# m: a disc that lies as flat as this has no lowest point.
_FLAT = 1e-12


def undersides(character: Character) -> Undersides:
    """All that may bear load: every geom that can collide with the floor, by the model's masks.

    A declared contact point is geometry only where its body has none that collides: elsewhere it
    names a contact, and the geometry says where it is.
    """
    model = character.model
    geoms = colliding_geoms(character)
    declared = character.contacts
    bare = ~np.isin(declared.body, model.geom_bodyid[geoms])
    found = [_points(model, int(geom)) for geom in geoms]
    each = [len(points) for points, *_ in found]
    body = np.repeat(model.geom_bodyid[geoms], each)
    source = f"{len(geoms)} collision geoms" if len(geoms) else "nothing"
    if bare.any():
        named = f"{np.count_nonzero(bare)} declared contact points"
        source = f"{source} and {named}" if len(geoms) else named
    count = int(bare.sum())
    owner = np.concatenate([body, declared.body[bare]]).astype(np.int64)
    local = np.concatenate([*(points for points, *_ in found), declared.local[bare]])
    radius = np.concatenate([*(ball for _, ball, *_ in found), np.zeros(count)])
    axes = np.concatenate([*(axes for *_, axes, _ in found), np.zeros((count, 3))])
    frame = np.concatenate([*(turn for *_, turn in found), np.tile(np.eye(3), (count, 1, 1))])
    rough = np.repeat(_friction(character, geoms), each)
    friction = np.concatenate([rough, np.full(count, character.foot_friction)])
    order = np.argsort(owner, kind="stable")
    return Undersides(
        owner[order], local[order], radius[order], axes[order], frame[order], friction[order],
        _twist(model, geoms), source,
    )  # fmt: skip


def colliding_geoms(character: Character) -> Ints:
    """Geoms of the character's tree that can collide with the floor by the model's masks, or as
    one of its pairs."""
    model = character.model
    floor = _floors(model)
    mine = np.isin(model.geom_bodyid, character.bodies)
    kind, affinity = model.geom_contype, model.geom_conaffinity
    touches = (kind | affinity) != 0
    if len(floor):
        touches = np.any([(kind & affinity[g]) | (kind[g] & affinity) for g in floor], axis=0)
        for pair in zip(model.pair_geom1, model.pair_geom2, strict=True):
            for one, other in (pair, pair[::-1]):
                touches[one] |= other in floor
    flat = (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD)
    solid = ~np.isin(model.geom_type, flat)
    return np.flatnonzero(mine & touches & solid).astype(np.int64)


def _floors(model: mujoco.MjModel) -> Ints:
    plane = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
    return np.flatnonzero(plane & (model.geom_bodyid == 0)).astype(np.int64)


def _friction(character: Character, geoms: Ints) -> Floats:
    """(G,) sliding friction between geoms and floor: that of the geom of higher priority, of
    equal ones the larger, as MuJoCo has it. A coefficient told for the character goes first."""
    model, floors = character.model, _floors(character.model)
    told = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, "friction") >= 0
    if told or len(floors) == 0:
        return np.full(len(geoms), character.foot_friction)
    floor = floors[0]
    own, below = model.geom_friction[geoms, 0], model.geom_friction[floor, 0]
    ahead = model.geom_priority[geoms].astype(np.int64) - int(model.geom_priority[floor])
    mixed: Floats = np.where(ahead == 0, np.maximum(own, below), np.where(ahead > 0, own, below))
    return mixed


def _twist(model: mujoco.MjModel, geoms: Ints) -> Floats:
    """(nbody, 2) m of torsional and rolling friction with the floor: times the normal force, the
    moment that a contact of a body takes besides that of its force.

    A contact has the first from MuJoCo's ``condim`` 4 on, the second from 6 on; ``condim`` and
    coefficients are those of the geom of higher priority, of equal ones the larger.
    """
    found = np.zeros((model.nbody, 2))
    floors = _floors(model)
    for geom in geoms:
        pair = [geom, *floors[:1]]
        ahead = model.geom_priority[pair]
        pair = [g for g, p in zip(pair, ahead, strict=True) if p == ahead.max()]
        dimensions = model.geom_condim[pair].max()
        rubs = np.where([dimensions > 3, dimensions > 4], model.geom_friction[pair, 1:].max(0), 0.0)
        body = model.geom_bodyid[geom]
        found[body] = np.maximum(found[body], rubs)
    return found


def _points(model: mujoco.MjModel, geom: int) -> tuple[Floats, Floats, Floats, Floats]:
    """Points (n, 3) of a geom in its body's frame, radius (n,), axes (n, 3), frame (n, 3, 3)."""
    shape = _shape(model, geom)
    if shape is None:  # of no known shape: what its bounding sphere says
        shape = np.zeros((1, 3)), np.full(3, float(model.geom_rbound[geom]))
    points, axes = shape
    turn = kinematics.quat_to_matrix(np.array(model.geom_quat[geom]))
    ball = 0.0
    grown = np.tile(axes, (len(points), 1))
    if axes[2] == 0 and axes[0] > 0:  # a disc: its lowest point, and its rim
        angle = np.arange(_RIM) * 2 * np.pi / _RIM
        rim = np.c_[axes[0] * np.cos(angle), axes[0] * np.sin(angle), np.zeros(_RIM)]
        around = (points[:, None] + rim).reshape(-1, 3)
        points = np.concatenate([points, around])
        grown = np.concatenate([grown, np.zeros((len(around), 3))])
    elif axes[0] == axes[1] == axes[2]:
        ball, grown = float(axes[0]), np.zeros_like(grown)
    count = len(points)
    return (
        points @ turn.T + model.geom_pos[geom], np.full(count, ball), grown,
        np.tile(turn, (count, 1, 1)),
    )  # fmt: skip


def _hull(model: mujoco.MjModel, mesh: int) -> Floats:
    start = int(model.mesh_vertadr[mesh])
    vertices: Floats = np.array(
        model.mesh_vert[start : start + int(model.mesh_vertnum[mesh])], dtype=np.float64
    )
    try:
        return vertices[np.sort(ConvexHull(vertices).vertices)]
    except QhullError:  # a flat mesh spans no volume
        return vertices
