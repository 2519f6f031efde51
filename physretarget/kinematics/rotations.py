"""Rotations in batches: unit quaternions ``w x y z``, matrices and rotation vectors.

Every function broadcasts over leading axes. They are written out because SciPy's
``Rotation`` copies, checks and reorders its input on every call, which dominates the inner
loop of a batched solver.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_TINY = 1e-12


def normalized(vector: Floats) -> Floats:
    """Unit vectors along the last axis; a vector of zero length stays zero."""
    length = np.linalg.norm(vector, axis=-1, keepdims=True)
    unit: Floats = vector / np.maximum(length, _TINY)
    return unit


def quat_normalized(quat: Floats) -> Floats:
    """Unit quaternions (..., 4); a zero quaternion becomes the identity, as in MuJoCo."""
    length = np.linalg.norm(quat, axis=-1, keepdims=True)
    identity = np.array([1.0, 0.0, 0.0, 0.0])
    return np.where(length < _TINY, identity, quat / np.maximum(length, _TINY))


def quat_multiply(left: Floats, right: Floats) -> Floats:
    """Hamilton product (..., 4): the rotation ``right`` first, then ``left``."""
    a, b, c, d = (left[..., i] for i in range(4))
    e, f, g, h = (right[..., i] for i in range(4))
    return np.stack(
        [
            a * e - b * f - c * g - d * h,
            a * f + b * e + c * h - d * g,
            a * g - b * h + c * e + d * f,
            a * h + b * g - c * f + d * e,
        ],
        axis=-1,
    )


def quat_conjugate(quat: Floats) -> Floats:
    """The inverse rotation of unit quaternions (..., 4)."""
    inverse: Floats = quat * np.array([1.0, -1.0, -1.0, -1.0])
    return inverse


def quat_rotate(quat: Floats, vector: Floats) -> Floats:
    """Rotate vectors (..., 3) by unit quaternions (..., 4)."""
    twice = 2.0 * np.cross(quat[..., 1:], vector)
    rotated: Floats = vector + quat[..., :1] * twice + np.cross(quat[..., 1:], twice)
    return rotated


def quat_to_matrix(quat: Floats) -> Floats:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4)."""
    w, x, y, z = (quat[..., i] for i in range(4))
    matrix = np.empty((*quat.shape[:-1], 3, 3))
    matrix[..., 0, 0] = 1 - 2 * (y * y + z * z)
    matrix[..., 0, 1] = 2 * (x * y - w * z)
    matrix[..., 0, 2] = 2 * (x * z + w * y)
    matrix[..., 1, 0] = 2 * (x * y + w * z)
    matrix[..., 1, 1] = 1 - 2 * (x * x + z * z)
    matrix[..., 1, 2] = 2 * (y * z - w * x)
    matrix[..., 2, 0] = 2 * (x * z - w * y)
    matrix[..., 2, 1] = 2 * (y * z + w * x)
    matrix[..., 2, 2] = 1 - 2 * (x * x + y * y)
    return matrix


def matrix_to_quat(matrix: Floats) -> Floats:
    """Unit quaternions (..., 4) with ``w >= 0`` of rotation matrices (..., 3, 3).

    The largest of the four components is taken from the diagonal and the others are divided
    by it, which stays accurate at every angle (Shepperd 1978).
    """
    m = matrix.reshape(-1, 3, 3)
    diagonal = np.einsum("nii->ni", m)
    trace = diagonal.sum(axis=1)
    fourfold = np.concatenate([(1 + trace)[:, None], 1 - trace[:, None] + 2 * diagonal], axis=1)
    table = np.empty((len(m), 4, 4))  # 4 q qᵀ
    table[:, np.arange(4), np.arange(4)] = fourfold
    for i, j, value in (
        (0, 1, m[:, 2, 1] - m[:, 1, 2]),
        (0, 2, m[:, 0, 2] - m[:, 2, 0]),
        (0, 3, m[:, 1, 0] - m[:, 0, 1]),
        (1, 2, m[:, 1, 0] + m[:, 0, 1]),
        (1, 3, m[:, 0, 2] + m[:, 2, 0]),
        (2, 3, m[:, 2, 1] + m[:, 1, 2]),
    ):
        table[:, i, j] = table[:, j, i] = value
    quat = quat_normalized(table[np.arange(len(m)), np.argmax(fourfold, axis=1)])
    quat *= np.where(quat[:, :1] < 0, -1.0, 1.0)
    return quat.reshape(*matrix.shape[:-2], 4)


def rotvec_to_quat(rotvec: Floats) -> Floats:
    """Unit quaternions (..., 4) of rotation vectors (..., 3) in radians."""
    angle = np.linalg.norm(rotvec, axis=-1, keepdims=True)
    half = 0.5 * angle
    scale = 0.5 * np.sinc(half / np.pi)  # sin(angle/2)/angle, finite at zero
    return np.concatenate([np.cos(half), scale * rotvec], axis=-1)


def quat_to_rotvec(quat: Floats) -> Floats:
    """The shortest rotation vectors (..., 3), at most pi long, of unit quaternions (..., 4)."""
    quat = np.where(quat[..., :1] < 0, -quat, quat)
    sine = np.linalg.norm(quat[..., 1:], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, quat[..., :1])
    small = sine < _TINY
    scale: Floats = np.where(small, 2.0, angle / np.where(small, 1.0, sine))
    return scale * quat[..., 1:]


def rotvec_slope(rotvec: Floats) -> Floats:
    """Derivatives (..., 3, 3) of a rotation vector by a small further turn in its own frame.

    The inverse of the right Jacobian of SO(3) (Chirikjian 2012, vol. 2, eq. 10.86).
    """
    angle = np.linalg.norm(rotvec, axis=-1)
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    factor = np.where(small, 1 / 12, 1 / safe**2 - 1 / (2 * safe * np.tan(safe / 2)))
    x, y, z = (rotvec[..., i] for i in range(3))
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1)
    cross = cross.reshape(*rotvec.shape, 3)
    slope: Floats = np.eye(3) + 0.5 * cross + factor[..., None, None] * (cross @ cross)
    return slope


def continuous(quat: Floats) -> Floats:
    """Quaternions (T, ..., 4) with signs chosen so that no frame flips against the last one."""
    dots = np.sum(quat[1:] * quat[:-1], axis=-1)
    signs = np.cumprod(np.where(dots < 0, -1.0, 1.0), axis=0)
    return np.concatenate([quat[:1], quat[1:] * signs[..., None]], axis=0)


def slerp(start: Floats, end: Floats, share: Floats) -> Floats:
    """Spherical interpolation from ``start`` to ``end`` (..., 4), ``share`` (...) in [0, 1]."""
    step = quat_to_rotvec(quat_multiply(quat_conjugate(start), end))
    return quat_multiply(start, rotvec_to_quat(share[..., None] * step))
