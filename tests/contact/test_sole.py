from __future__ import annotations

import numpy as np
import pytest

from physretarget import kinematics
from physretarget.contact.sole import Sole, allowed_tilt, make_sole, rolled, sole_motion

LOCAL = np.array([[0.1, 0.08, 0], [-0.1, 0.08, 0], [0.1, -0.08, 0], [-0.1, -0.08, 0.0]])
SIDES = ("left", "left", "right", "right")


@pytest.fixture
def sole() -> Sole:
    return make_sole(1, np.arange(4), LOCAL, SIDES, np.eye(3))


@pytest.mark.parametrize("planted", range(1, 16))
def test_the_allowed_tilt_is_the_nearest_one(sole, planted):
    """Against a search over a grid of tilts: feasible, and none on the grid is nearer."""
    mask = np.array([bool(planted >> k & 1) for k in range(4)])
    wanted = np.random.default_rng(planted).uniform(-0.3, 0.3, (20, 3)) * [1, 1, 0]
    found = allowed_tilt(sole, wanted, np.tile(mask, (20, 1)))
    angle = np.linspace(-np.pi, np.pi, 721)
    radius = np.linspace(0.0, 0.5, 101)
    grid = np.stack(
        [np.outer(radius, np.cos(angle)).ravel(), np.outer(radius, np.sin(angle)).ravel()], axis=1
    )
    pivot = int(np.argmax(mask))
    arm = sole.foot[:, :2] - sole.foot[pivot, :2]

    def lift(tilt: np.ndarray) -> np.ndarray:
        return tilt[:, :1] * arm[:, 1] - tilt[:, 1:2] * arm[:, 0]

    def feasible(tilt: np.ndarray) -> np.ndarray:
        up = lift(tilt)
        return (up[:, ~mask] >= -1e-9).all(axis=1) & (np.abs(up[:, mask]) < 1e-9).all(axis=1)

    assert feasible(found[:, :2]).all()
    choices = grid[feasible(grid)]
    nearest = np.linalg.norm(wanted[:, None, :2] - choices, axis=-1).min(axis=1)
    assert (np.linalg.norm((wanted - found)[:, :2], axis=1) <= nearest + 1e-9).all()


def test_heading_and_tilt_make_up_the_rotation(sole):
    rng = np.random.default_rng(0)
    quat = kinematics.rotvec_to_quat(np.cumsum(0.1 * rng.standard_normal((200, 3)), axis=0))
    rotation = kinematics.quat_to_matrix(quat)
    pose = kinematics.Pose(np.zeros((200, 2, 3)), np.stack([rotation, rotation], axis=1))
    motion = sole_motion(sole, pose)
    lean = kinematics.quat_to_matrix(kinematics.rotvec_to_quat(motion.tilt))
    zero = np.zeros(200)
    turn = kinematics.quat_to_matrix(
        kinematics.rotvec_to_quat(np.stack([zero, zero, motion.yaw], axis=1))
    )
    np.testing.assert_allclose(turn @ lean @ sole.flat, rotation, atol=1e-12)
    np.testing.assert_allclose(motion.tilt[:, 2], 0.0, atol=1e-12)


def test_points_that_are_not_level_in_the_reference_pose_are_levelled():
    tilted = kinematics.quat_to_matrix(kinematics.rotvec_to_quat(np.array([0.1, -0.2, 0.0])))
    four = make_sole(1, np.arange(4), LOCAL, SIDES, tilted)
    np.testing.assert_allclose(four.foot[:, 2], 0.0, atol=1e-12)
    two = make_sole(1, np.arange(2), LOCAL[:2], SIDES[:2], tilted)
    np.testing.assert_allclose(two.foot[:, 2], 0.0, atol=1e-12)
    one = make_sole(1, np.arange(1), LOCAL[:1], SIDES[:1], tilted)
    np.testing.assert_allclose(one.flat, tilted)


def test_rolling_lifts_the_free_side(sole):
    left = np.array([True, True, False, False])
    tilt = rolled(sole, left, 0.1)
    turned = sole.foot @ kinematics.quat_to_matrix(kinematics.rotvec_to_quat(tilt)).T
    assert turned[2:, 2].min() > turned[:2, 2].max()
    assert np.linalg.norm(tilt) == pytest.approx(0.1)
