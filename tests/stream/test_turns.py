"""One turn at a time against the batched kinematics."""

from __future__ import annotations

import numpy as np
import pytest

from physretarget import kinematics
from physretarget.stream import turns

SOME = np.random.default_rng(7).normal(size=(20, 3))


@pytest.mark.parametrize("vector", [*SOME, np.zeros(3), np.array([0.0, 0.0, 3.1])])
def test_vectors_quaternions_and_matrices_agree(vector: np.ndarray) -> None:
    quat = turns.rotvec_quat(vector)
    assert quat == pytest.approx(kinematics.rotvec_to_quat(vector))
    assert turns.quat_rotvec(quat) == pytest.approx(kinematics.quat_to_rotvec(np.array(quat)))
    matrix = turns.quat_matrix(quat)
    assert matrix == pytest.approx(kinematics.quat_to_matrix(np.array(quat)))
    assert turns.quat_matrix(turns.matrix_quat(matrix.T)) == pytest.approx(matrix.T)


def test_products_are_those_of_the_batch() -> None:
    left, right = turns.rotvec_quat(SOME[0]), turns.rotvec_quat(SOME[1])
    wanted = kinematics.quat_multiply(np.array(left), np.array(right))
    assert turns.quat_product(left, right) == pytest.approx(wanted)


def test_twist_is_the_turn_under_a_tilt() -> None:
    tilt = np.array([0.3, -0.2, 0.0])
    quat = turns.quat_product(turns.rotvec_quat(tilt), turns.about(0.7))
    assert turns.twist(quat) == pytest.approx(0.7)


def test_turning_about_the_vertical() -> None:
    matrix = turns.quat_matrix(turns.about(0.4))
    assert turns.turned(SOME[0], 0.4) == pytest.approx(matrix @ SOME[0])
    assert turns.turned(SOME[0][:2], 0.4) == pytest.approx((matrix @ SOME[0])[:2])
