"""Local frame of a body and the feature vectors that a mapper works on.

Horizontal position and heading are taken out of a pose; height, roll and pitch stay
(Yamane 2010, section 4.1). Actor and character go through the same code.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from physretarget import kinematics
from physretarget.errors import InputError

if TYPE_CHECKING:
    from physretarget.mjcf import Character

Array = NDArray[np.float64]

INVERTED_COSINE = -np.sqrt(0.5)
"""Below this cosine between the body's up axis and the vertical (tilt over 135 degrees) the
heading is carried along instead of computed: the minimal rotation to upright amplifies changes
of orientation by ``1 / cos(tilt / 2)``, 2.6 here and without bound towards upside down."""

CHUNK = 1024
"""Frames whose kinematics are held in memory at once."""


@dataclass(frozen=True)
class LocalFrame:
    """Heading frame under the root, one per frame of a clip.

    ``origin`` (T, 3): the root projected to the floor, metres, world.
    ``yaw`` (T,): heading about the vertical, rad, unwrapped (continuous in time).
    ``basis`` (T, 3, 3): columns are the local x (heading), y (left), z (up) in world axes.
    """

    origin: Array
    yaw: Array
    basis: Array

    def to_local(self, points: Array) -> Array:
        """Coordinates of world ``points`` (T, K, 3) in the local frame, metres."""
        local: Array = np.einsum("tji,tkj->tki", self.basis, points - self.origin[:, None, :])
        return local

    def to_world(self, points: Array) -> Array:
        """World coordinates of local ``points`` (T, K, 3), metres."""
        world: Array = np.einsum("tij,tkj->tki", self.basis, points) + self.origin[:, None, :]
        return world


def local_frame(position: Array, rotation: Array, front: ArrayLike, up: ArrayLike) -> LocalFrame:
    """Local frame of a root at ``position`` (T, 3) with ``rotation`` (T, 3, 3), world.

    ``front`` and ``up`` (3,) are fixed in the root. The heading is the horizontal direction of
    ``Q R front``, where ``Q`` is the smallest rotation that takes ``R up`` to the vertical
    (Yamane 2010, section 4.1). No continuous heading exists on all rotations: ``Q`` is undefined
    upside down. While the body is tilted by more than 135 degrees the heading therefore follows
    the rotation about the vertical from frame to frame, and what then remains between it and
    the definition where the body comes out is spread evenly over those frames. Elsewhere the
    result is the definition itself, each frame on its own.
    """
    forward, upward = _axes(front, up)
    f = rotation @ forward
    u = rotation @ upward
    raw = _definition(f, u)
    yaw = _carry(raw, u[:, 2] < INVERTED_COSINE, rotation, f)
    origin = position.copy()
    origin[:, 2] = 0.0
    return LocalFrame(origin, yaw, _about_vertical(yaw))


def stack(points: Array) -> Array:
    """Feature vectors (T, 3K) of points (T, K, 3)."""
    return points.reshape(points.shape[0], -1)


def unstack(features: Array) -> Array:
    """Points (T, K, 3) of feature vectors (T, 3K)."""
    return features.reshape(features.shape[0], -1, 3)


def features(character: Character, qpos: Array) -> Array:
    """Local coordinates of all markers of ``character``, stacked: (T, 3K), metres.

    ``qpos`` (T, nq). Horizontal position and heading do not matter to the result.
    """
    markers = character.markers
    frame, points = _framed(character, qpos, markers.body, markers.local)
    return stack(frame.to_local(points))


def frame_of(character: Character, qpos: Array) -> LocalFrame:
    """Local frame of ``character`` in every frame of a clip ``qpos`` (T, nq)."""
    return _framed(character, qpos, np.zeros(0, dtype=np.int64), np.zeros((0, 3)))[0]


def _framed(
    character: Character, qpos: Array, body: NDArray[np.int64], local: Array
) -> tuple[LocalFrame, Array]:
    """The local frame, and the world positions (T, K, 3) of points of bodies.

    Kinematics of all bodies are known for :data:`CHUNK` frames at a time: for a long clip they
    take more memory than the clip.
    """
    root = character.root_body
    position, rotation = np.empty((len(qpos), 3)), np.empty((len(qpos), 3, 3))
    points = np.empty((len(qpos), len(body), 3))
    for at in range(0, len(qpos), CHUNK):
        part = slice(at, at + CHUNK)
        pose = kinematics.forward(character.tree, qpos[part])
        position[part], rotation[part] = pose.position[:, root], pose.rotation[:, root]
        points[part] = kinematics.points(pose, body, local)
    return local_frame(position, rotation, character.front, character.up), points


def _axes(front: ArrayLike, up: ArrayLike) -> tuple[Array, Array]:
    upward = np.asarray(up, dtype=np.float64)
    upward = upward / np.linalg.norm(upward)
    forward = np.asarray(front, dtype=np.float64)
    forward = forward - (forward @ upward) * upward
    length = np.linalg.norm(forward)
    if length < 1e-6:
        raise InputError("front and up of a root point the same way; they must differ")
    return forward / length, upward


def _definition(f: Array, u: Array) -> Array:
    """Yaw (T,) of Q f, Q the smallest rotation from u to the vertical; -f where upside down."""
    # Q f = f - f_z u... for unit u, f with f.u = 0:  Q f = f - f_z (u + z) / (1 + u_z)
    rest = 1.0 + u[:, 2]
    upside_down = rest < 1e-9
    share = f[:, 2] / np.where(upside_down, 1.0, rest)
    x = np.where(upside_down, -f[:, 0], f[:, 0] - share * u[:, 0])
    y = np.where(upside_down, -f[:, 1], f[:, 1] - share * u[:, 1])
    return np.asarray(np.arctan2(y, x))


def _carry(raw: Array, inverted: NDArray[np.bool_], rotation: Array, f: Array) -> Array:
    """Yaw (T,), unwrapped: ``raw`` where upright, carried through runs of ``inverted``."""
    upright = np.flatnonzero(~inverted)
    if upright.size == raw.size:
        return np.unwrap(raw)
    step = _vertical_turn(rotation)
    turned = np.concatenate([[0.0], np.cumsum(step)])
    if upright.size == 0:  # as if pitched all the way over, then carried
        start: float = np.arctan2(-f[0, 1], -f[0, 0])
        return start + turned
    # offset of the definition from the carried heading, continuous over upright frames;
    # between two of them it is interpolated, which spreads what remains over the run
    offset = np.unwrap(raw[upright] - turned[upright])
    frames = np.arange(raw.size)
    yaw: Array = turned + np.interp(frames, upright, offset)
    yaw[upright] = turned[upright] + offset
    return yaw


def _vertical_turn(rotation: Array) -> Array:
    """Rotation about the vertical from each frame to the next (T-1,), rad."""
    relative = rotation[1:] @ np.swapaxes(rotation[:-1], 1, 2)
    if relative.shape[0] == 0:
        return np.zeros(0)
    return np.asarray(Rotation.from_matrix(relative).as_rotvec()[:, 2])


def _about_vertical(yaw: Array) -> Array:
    basis = np.zeros((yaw.size, 3, 3))
    cosine, sine = np.cos(yaw), np.sin(yaw)
    basis[:, 0, 0] = cosine
    basis[:, 0, 1] = -sine
    basis[:, 1, 0] = sine
    basis[:, 1, 1] = cosine
    basis[:, 2, 2] = 1.0
    return basis
