from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from physretarget.kinematics import (
    continuous,
    matrix_to_quat,
    quat_multiply,
    quat_rotate,
    quat_to_matrix,
    quat_to_rotvec,
    rotvec_to_quat,
    slerp,
)


def random_quats(n: int, seed: int = 0) -> np.ndarray:
    quat = np.random.default_rng(seed).standard_normal((n, 4))
    return quat / np.linalg.norm(quat, axis=1, keepdims=True)


def test_agree_with_scipy():
    a, b = random_quats(200), random_quats(200, 1)
    twin_a = Rotation.from_quat(a, scalar_first=True)
    twin_b = Rotation.from_quat(b, scalar_first=True)
    vector = np.random.default_rng(2).standard_normal((200, 3))
    np.testing.assert_allclose(quat_to_matrix(a), twin_a.as_matrix(), atol=1e-14)
    np.testing.assert_allclose(quat_to_rotvec(a), twin_a.as_rotvec(), atol=1e-12)
    np.testing.assert_allclose(
        quat_to_matrix(quat_multiply(a, b)), (twin_a * twin_b).as_matrix(), atol=1e-14
    )
    np.testing.assert_allclose(quat_rotate(a, vector), twin_a.apply(vector), atol=1e-14)


def test_matrix_and_rotvec_come_back_even_at_half_turns():
    axes = np.concatenate([np.eye(3), np.ones((1, 3)) / np.sqrt(3)])
    rotvec = np.concatenate([axes * angle for angle in (0.0, 1e-9, 1.0, np.pi - 1e-9, np.pi)])
    quat = rotvec_to_quat(rotvec)
    again = matrix_to_quat(quat_to_matrix(quat))
    assert np.abs(np.abs(np.sum(quat * again, axis=1)) - 1).max() < 1e-14
    back = rotvec_to_quat(quat_to_rotvec(quat))
    assert np.abs(np.abs(np.sum(quat * back, axis=1)) - 1).max() < 1e-14


def test_continuous_removes_sign_flips():
    angle = np.linspace(0, 4 * np.pi, 300)
    quat = rotvec_to_quat(np.stack([angle, 0 * angle, 0 * angle], axis=1))
    flipped = quat * np.where(np.random.default_rng(0).random(300) < 0.5, -1, 1)[:, None]
    smooth = continuous(flipped)
    assert np.abs(np.diff(smooth, axis=0)).max() < 0.05


def test_slerp_meets_its_ends_and_goes_the_short_way():
    a, b = random_quats(50), -random_quats(50, 3)
    ends = slerp(a, b, np.ones(50))
    assert np.abs(np.abs(np.sum(ends * b, axis=1)) - 1).max() < 1e-12
    half = slerp(a, b, np.full(50, 0.5))
    np.testing.assert_allclose(
        np.abs(np.sum(half * a, axis=1)), np.abs(np.sum(half * b, axis=1)), atol=1e-12
    )
