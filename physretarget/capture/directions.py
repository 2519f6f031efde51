"""Unit vectors and rotations over a clip: their means, and frames built from them."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from physretarget.capture.measure import unit
from physretarget.capture.recording import Floats


def mean_direction(vectors: Floats, weight: Floats | None = None) -> Floats:
    """Mean unit vector of (T, 3), trimmed once: vectors beyond twice the median angle go."""
    weight = np.ones(len(vectors)) if weight is None else weight
    mean = unit(weight @ vectors)
    angle = np.arccos(np.clip(unit(vectors) @ mean, -1, 1))
    used = weight > 0
    if used.any():
        keep = angle <= 2 * np.median(angle[used]) + 1e-9
        mean = unit((weight * keep) @ vectors)
    return mean


def mean_rotation(rotations: Floats) -> Floats:
    """The chordal mean of rotations (T, 3, 3), trimmed once at twice the median angle."""
    mean = _nearest_rotation(rotations.mean(axis=0))
    cosine = (np.einsum("tij,ij->t", rotations, mean) - 1) / 2
    angle = np.arccos(np.clip(cosine, -1, 1))
    return _nearest_rotation(rotations[angle <= 2 * np.median(angle) + 1e-9].mean(axis=0))


def _nearest_rotation(matrix: Floats) -> Floats:
    u, _, vt = np.linalg.svd(matrix)
    flip = np.diag([1.0, 1.0, float(np.sign(np.linalg.det(u @ vt)))])
    return np.asarray(u @ flip @ vt)


def swing(start: Floats, end: Floats) -> Floats:
    """The smallest rotations (T, 3, 3) that take unit vectors ``start`` to ``end`` (T, 3)."""
    axis = np.cross(start, end)
    sine = np.linalg.norm(axis, axis=-1)
    angle = np.arctan2(sine, np.sum(start * end, axis=-1))
    other = np.cross(start, np.eye(3)[np.argmin(np.abs(start), axis=-1)])  # for half turns
    axis = np.where((sine > 1e-9)[:, None], axis, other)
    turned: Floats = Rotation.from_rotvec(unit(axis) * angle[:, None]).as_matrix()
    return turned


def frame(left: Floats, up: Floats) -> Floats:
    """Columns forward, left, up; ``up`` is kept, ``left`` made orthogonal to it."""
    up = unit(up)
    left = unit(left - (left @ up) * up)
    return np.column_stack([np.cross(left, up), left, up])


def in_frames(turn: Floats, world: Floats) -> Floats:
    """World vectors (T, 3) in the frames (T, 3, 3)."""
    return np.asarray(np.einsum("tji,tj->ti", turn, world))
