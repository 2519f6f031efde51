"""Bodies that do not stand on the floor stay above it.

Bringing a base to the floor can take what it carries below: a lamp that bows deeply, or a
pose far from every key pose. Points on the surface of the carried bodies that end below the
floor are lifted onto it by inverse kinematics, over the stretches of time concerned.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.contact.carry import lifted
from physretarget.contact.foot import Foot
from physretarget.contact.leg import SOLE_SLACK
from physretarget.contact.settings import ContactSettings
from physretarget.kinematics import PointTargets, runs
from physretarget.mjcf import Character

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

DIRECTIONS = 40
"""A body is represented by its farthest points in so many directions."""
FLOOR_SLACK = 1e-4
"""Carried bodies may be this far below the floor (m) without being lifted."""
AROUND = 0.15
"""So long before and after it is lifted a limb may make way (s)."""
ROUNDS = 6
"""Lifting a body moves its neighbours: so often is looked again."""


def above_floor(
    character: Character, qpos: Floats, time: Floats, feet: list[Foot], settings: ContactSettings
) -> Floats:
    """Lift what is carried below the floor onto it; only frames near such a one change.

    A body is lifted as a whole by the depth of its lowest point, as far as it is deeper than in
    the reference pose. That moves its neighbours: a few rounds. Each solves whole stretches of
    time, so that a limb that can be lifted in two ways does not leap from one to the other.
    """
    exact = [foot.sole.body for foot in feet if foot.sole.two_sided]
    bodies = np.setdiff1d(character.bodies, exact)
    frames = _near_floor(character, qpos, bodies)
    if not len(frames):
        return qpos
    body, local = surface_points(character, bodies)
    standing = np.isin(body, [foot.sole.body for foot in feet])
    slack = np.where(standing, SOLE_SLACK, FLOOR_SLACK)
    slack = slack + _depth(character, character.reference_qpos[None], body, local, standing)[0]
    weight = np.where(standing, settings.stance_weight, settings.clearance_weight)
    share = weight / np.array([(body == one).sum() for one in body])
    moved = qpos.copy()
    step_s = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    for _ in range(ROUNDS):
        depth = _depth(character, moved[frames], body, local, standing)
        low = depth > slack
        frames, depth, low = (each[low.any(axis=1)] for each in (frames, depth, low))
        if not len(frames):
            break
        some = low.any(axis=0)
        rise = np.full((len(qpos), int(some.sum())), np.nan)
        rise[frames] = np.where(low, depth - slack, np.nan)[:, some]
        for part in _stretches(frames, len(qpos), step_s):
            pose = kinematics.forward(character.tree, moved[part])
            target = kinematics.points(pose, body[some], local[some])
            target[..., 2] += rise[part]
            lift = PointTargets(body[some], local[some], target, share[some])
            moved[part] = lifted(character, moved[part], feet, settings, step_s, part, lift)
    return moved


def _stretches(frames: Ints, count: int, step_s: float) -> list[Ints]:
    """Frames near the given ones, each run of them apart."""
    near, around = np.zeros(count, dtype=bool), round(AROUND / step_s)
    for frame in frames.tolist():
        near[max(frame - around, 0) : frame + around + 1] = True
    return [np.arange(first, last + 1) for first, last in runs(near)]


def on_the_floor(
    character: Character, qpos: Floats, time: Floats, feet: list[Foot], settings: ContactSettings
) -> Floats:
    """Set down what floats: no stance for longer than any flight lasts, for all were given up.

    The whole pose sinks until its feet's lowest point is on the floor. Next to a stance that is
    where it is, so that nothing jumps.
    """
    stands = np.any([foot.track.standing for foot in feet], axis=0)
    floats = [
        np.arange(first, last + 1)
        for first, last in runs(~stands)
        if time[last] - time[first] > settings.longest_flight
    ]
    if not floats or not character.has_root:
        return qpos
    meant = np.any([foot.active.any(axis=1) for foot in feet], axis=0)
    frames = np.concatenate(floats)
    frames = frames[meant[frames]]
    pose = kinematics.forward(character.tree, qpos[frames])
    body, local = surface_points(character, np.array([foot.sole.body for foot in feet]))
    lowest = kinematics.points(pose, body, local)[..., 2].min(axis=1) - character.floor_height
    set_down = qpos.copy()
    set_down[frames, character.root_qpos + 2] -= np.maximum(lowest, 0.0)
    return set_down


def _near_floor(character: Character, qpos: Floats, bodies: Ints) -> Ints:
    """Frames in which the bounding sphere of any geom of ``bodies`` reaches below the floor."""
    model = character.model
    geoms = np.flatnonzero(np.isin(model.geom_bodyid, bodies))
    pose = kinematics.forward(character.tree, qpos)
    centre = kinematics.points(pose, model.geom_bodyid[geoms], np.array(model.geom_pos[geoms]))
    low = centre[..., 2] - model.geom_rbound[geoms] < character.floor_height
    return np.flatnonzero(low.any(axis=1))


def _depth(character: Character, qpos: Floats, body: Ints, local: Floats, alone: Bools) -> Floats:
    """(T, K) for each point how deep the lowest point of its body is below the floor, m.

    Points ``alone`` (K,) speak for themselves.
    """
    where = kinematics.points(kinematics.forward(character.tree, qpos), body, local)
    depth: Floats = np.maximum(character.floor_height - where[..., 2], 0.0)
    for one in np.unique(body[~alone]):
        mine = body == one
        below = character.floor_height - where[:, mine, 2].min(axis=1, keepdims=True)
        depth[:, mine] = np.maximum(below, 0.0)
    return depth


def surface_points(character: Character, bodies: Ints) -> tuple[Ints, Floats]:
    """Bodies (K,) and local positions (K, 3) of points that span the hulls of ``bodies``."""
    every_body: list[int] = []
    every_point: list[Floats] = []
    for body in bodies:
        cloud = _cloud(character.model, int(body))
        if len(cloud):
            farthest = np.unique(np.argmax(cloud @ _sphere(DIRECTIONS).T, axis=0))
            every_body += [int(body)] * len(farthest)
            every_point.append(cloud[farthest])
    if not every_point:
        return np.zeros(0, dtype=np.int64), np.zeros((0, 3))
    return np.array(every_body, dtype=np.int64), np.concatenate(every_point)


def _cloud(model: mujoco.MjModel, body: int) -> Floats:
    """Points (N, 3) on the surfaces of a body's geoms, in the body's frame."""
    first = int(model.body_geomadr[body])
    clouds = []
    for geom in range(first, first + int(model.body_geomnum[body])):
        turn = kinematics.quat_to_matrix(np.array(model.geom_quat[geom]))
        clouds.append(_geom_cloud(model, geom) @ turn.T + model.geom_pos[geom])
    return np.concatenate(clouds) if clouds else np.zeros((0, 3))


def _geom_cloud(model: mujoco.MjModel, geom: int) -> Floats:
    kind = int(model.geom_type[geom])
    size: Floats = np.array(model.geom_size[geom], dtype=np.float64)
    ball = _sphere(DIRECTIONS)
    shapes = mujoco.mjtGeom
    if kind == shapes.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        start = int(model.mesh_vertadr[mesh])
        return np.array(model.mesh_vert[start : start + int(model.mesh_vertnum[mesh])], dtype=float)
    if kind == shapes.mjGEOM_SPHERE:
        return np.asarray(size[0] * ball)
    if kind == shapes.mjGEOM_CAPSULE:
        ends = np.array([[0.0, 0.0, size[1]], [0.0, 0.0, -size[1]]])
        return np.asarray((size[0] * ball + ends[:, None]).reshape(-1, 3))
    if kind == shapes.mjGEOM_ELLIPSOID:
        return size * ball
    if kind == shapes.mjGEOM_CYLINDER:
        angle = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
        rim = size[0] * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
        up = np.array([0.0, 0.0, size[1]])
        return np.concatenate([rim + up, rim - up])
    if kind == shapes.mjGEOM_BOX:
        corners = np.array(np.meshgrid([-1.0, 1.0], [-1.0, 1.0], [-1.0, 1.0]))
        return np.asarray(size * corners.reshape(3, 8).T)
    return np.zeros((0, 3))


def _sphere(count: int) -> Floats:
    """Directions (count + 6, 3) spread evenly (a Fibonacci lattice), and the axes."""
    k = np.arange(count) + 0.5
    height, angle = 1.0 - 2.0 * k / count, np.pi * (1.0 + 5.0**0.5) * k
    radius = np.sqrt(1.0 - height**2)
    spread = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)
    return np.concatenate([spread, np.eye(3), -np.eye(3)])
