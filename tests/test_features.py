from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physretarget import capture
from physretarget.errors import InputError
from physretarget.features import LocalFrame, local_frame, stack, unstack

FRONT, UP = np.array([1.0, 0, 0]), np.array([0.0, 0, 1])


def _frame(rotation: Rotation) -> LocalFrame:
    matrices = rotation.as_matrix().reshape(-1, 3, 3)
    return local_frame(np.zeros((len(matrices), 3)), matrices, FRONT, UP)


def _smallest_rotation(u: np.ndarray) -> np.ndarray:
    """Independent twin: the smallest rotation from u to z by axis and angle."""
    axis = np.cross(u, UP)
    angle = np.arctan2(np.linalg.norm(axis), u[2])
    return Rotation.from_rotvec(axis / np.linalg.norm(axis) * angle).as_matrix()


def test_is_the_papers_definition_where_upright() -> None:
    rotation = Rotation.random(400, rng=np.random.default_rng(0))
    for matrix in rotation.as_matrix():
        if matrix[2, 2] < -0.7:
            continue
        yaw = local_frame(np.zeros((1, 3)), matrix[None], FRONT, UP).yaw[0]
        heading = _smallest_rotation(matrix @ UP) @ matrix @ FRONT
        assert abs(heading[2]) < 1e-12
        np.testing.assert_allclose([np.cos(yaw), np.sin(yaw)], heading[:2], atol=1e-12)


@pytest.mark.parametrize("lean", [0.0, 1e-9, 1e-3, 0.02, -0.02, 0.1])
@pytest.mark.parametrize("direction", [-1, 1])
@pytest.mark.parametrize("axis", ["x", "y"])
def test_a_flip_never_turns_the_heading_round(lean: float, direction: int, axis: str) -> None:
    turn = direction * np.linspace(0, 2 * np.pi, 61)
    flip = Rotation.from_euler(axis, turn[:, None])
    tilted = Rotation.from_euler("y" if axis == "x" else "x", lean)
    frame = _frame(Rotation.from_euler("z", 0.7) * tilted * flip)
    assert np.abs(np.diff(frame.yaw)).max() < 0.25
    assert np.abs(frame.yaw - 0.7).max() < 0.5
    assert frame.yaw[-1] == pytest.approx(frame.yaw[0], abs=1e-9)


def test_a_turn_in_a_handstand_turns_the_heading() -> None:
    into = Rotation.from_euler("y", np.linspace(0, np.pi, 30)[:, None])
    turn = Rotation.from_euler("z", np.linspace(0, 1.2, 30)[:, None]) * into[-1]
    yaw = _frame(Rotation.concatenate([into, turn])).yaw
    assert yaw[-1] == pytest.approx(1.2, abs=1e-6)
    assert np.abs(np.diff(yaw)).max() < 0.1


def test_a_single_frame_upside_down_is_read_as_pitched_over() -> None:
    assert _frame(Rotation.from_euler("y", np.pi)).yaw[0] == pytest.approx(0.0, abs=1e-12)


def test_horizontal_place_and_heading_vanish_height_and_tilt_stay() -> None:
    rng = np.random.default_rng(1)
    local = rng.normal(size=(1, 5, 3))
    rotation = Rotation.from_euler("zyx", [[0.0, 0.4, -0.3]])
    moved = Rotation.from_euler("z", 2.0) * rotation
    place = np.array([[0.3, -0.2, 0.9]])
    shift = np.array([[5.0, 7.0, 0.0]])

    def seen(turn: Rotation, at: np.ndarray) -> np.ndarray:
        world = at[:, None] + local @ turn.as_matrix().transpose(0, 2, 1)
        return local_frame(at, turn.as_matrix(), FRONT, UP).to_local(world)

    np.testing.assert_allclose(seen(rotation, place), seen(moved, place + shift), atol=1e-12)
    assert not np.allclose(seen(rotation, place), seen(rotation, place + np.array([[0, 0, 0.1]])))


def test_to_world_undoes_to_local() -> None:
    rng = np.random.default_rng(2)
    rotation = Rotation.random(20, rng=rng).as_matrix()
    frame = local_frame(rng.normal(size=(20, 3)), rotation, FRONT, UP)
    points = rng.normal(size=(20, 4, 3))
    np.testing.assert_allclose(frame.to_world(frame.to_local(points)), points, atol=1e-12)
    np.testing.assert_array_equal(unstack(stack(points)), points)


def test_front_along_up_is_refused() -> None:
    with pytest.raises(InputError, match="must differ"):
        local_frame(np.zeros((1, 3)), np.eye(3)[None], UP, UP)


def test_a_recorded_backflip_never_turns_the_heading_round(motions: Path) -> None:
    motion = capture.load(motions / "humanoid3d_backflip.txt")
    rotation = Rotation.from_quat(motion.qpos[:, 3:7], scalar_first=True).as_matrix()
    assert rotation[:, 2, 2].min() < -0.8  # upside down it is
    yaw = local_frame(motion.qpos[:, :3], rotation, FRONT, UP).yaw
    assert np.abs(np.diff(yaw)).max() < 0.5
    assert np.ptp(yaw) < 1.0
