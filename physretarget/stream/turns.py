"""Turns of one body at a time: quaternions ``w x y z`` as four plain numbers.

Scalar, since a stream turns one body per frame: on single quaternions NumPy and SciPy take longer
to be called than the work takes. :mod:`physretarget.kinematics` has the same for batches.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Quat",
    "about",
    "matrix_quat",
    "quat_matrix",
    "quat_product",
    "quat_rotvec",
    "rotvec_quat",
    "turned",
    "twist",
]

Array = NDArray[np.float64]
Quat = tuple[float, float, float, float]


def about(yaw: float) -> Quat:
    """The turn by an angle about the vertical."""
    return (math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw))


def twist(quat: Quat) -> float:
    """The angle about the vertical, -2π to 2π, of what is such a turn and a tilt after it."""
    return 2.0 * math.atan2(quat[3], quat[0])


def quat_product(left: Quat, right: Quat) -> Quat:
    """Hamilton product: the turn ``right`` first, then ``left``."""
    w, x, y, z = left
    p, q, r, s = right
    return (
        w * p - x * q - y * r - z * s,
        w * q + x * p + y * s - z * r,
        w * r - x * s + y * p + z * q,
        w * s + x * r - y * q + z * p,
    )


def rotvec_quat(vector: Array) -> Quat:
    """The turn by a rotation vector (3,)."""
    x, y, z = vector.tolist()
    angle = math.sqrt(x * x + y * y + z * z)
    half = math.sin(0.5 * angle) / angle if angle > 1e-12 else 0.5
    return (math.cos(0.5 * angle), half * x, half * y, half * z)


def quat_rotvec(quat: Quat) -> tuple[float, float, float]:
    """The rotation vector of a turn, no longer than π."""
    w, x, y, z = quat
    size = math.sqrt(x * x + y * y + z * z)
    angle = math.remainder(2.0 * math.atan2(size, w), 2.0 * math.pi)
    share = angle / size if size > 1e-15 else 0.0
    return (share * x, share * y, share * z)


def matrix_quat(matrix: Array) -> Quat:
    """The turn of a rotation matrix (3, 3)."""
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, matrix.reshape(9))
    w, x, y, z = quat.tolist()
    return (w, x, y, z)


def quat_matrix(quat: Quat) -> Array:
    """The rotation matrix (3, 3) of a turn."""
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, quat)
    return matrix.reshape(3, 3)


def turned(vector: Array, yaw: float) -> Array:
    """A vector (2,) or (3,) turned about the vertical."""
    c, s = math.cos(yaw), math.sin(yaw)
    x, y, *up = vector.tolist()
    return np.array([c * x - s * y, s * x + c * y, *up])
