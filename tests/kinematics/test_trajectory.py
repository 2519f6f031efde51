from __future__ import annotations

import numpy as np
import pytest

from physretarget.kinematics import (
    Joint,
    PointTargets,
    Price,
    Tree,
    difference,
    forward,
    integrate,
    points,
    solve_trajectory,
    trajectory,
)
from physretarget.kinematics.solver import normal_equations, pose_problem

HINGES = Tree(
    parent=np.array([0, 0, 1, 2]),
    offset=np.array([[0, 0, 0], [0, 0, 0], [0, 0, 0.3], [0.3, 0, 0]], float),
    rotation=np.tile([1.0, 0, 0, 0], (4, 1)),
    joints=tuple(
        Joint("hinge", body, body - 1, body - 1, np.eye(3)[axis], np.zeros(3))
        for body, axis in ((1, 2), (2, 1), (3, 0))
    ),
)
TREE = Tree(
    parent=np.array([0, 0, 1, 2, 3, 1]),
    offset=np.array([[0, 0, 0]] + [[0, 0, 0.3]] * 3 + [[0.3, 0, 0], [0, 0.3, 0]], float),
    rotation=np.tile([1.0, 0, 0, 0], (6, 1)),
    joints=(
        Joint("free", 1, 0, 0, np.eye(3)[2], np.zeros(3)),
        Joint("ball", 2, 7, 6, np.eye(3)[2], np.zeros(3)),
        Joint("hinge", 3, 11, 9, np.eye(3)[1], np.zeros(3)),
        Joint("slide", 4, 12, 10, np.eye(3)[0], np.zeros(3)),
        Joint("hinge", 5, 13, 11, np.eye(3)[1], np.zeros(3)),
    ),
)
BODY = np.repeat(np.arange(1, 6), 4)
LOCAL = np.random.default_rng(7).uniform(-0.2, 0.2, (20, 3))
AT = np.array([1, 2, 3, 3])
ON = np.array([[0.1, 0, 0], [0, 0.2, 0], [0.1, 0.1, 0], [0, 0, 0.2]])


def price(tree: Tree, velocity: float, acceleration: float) -> Price:
    return Price(velocity=np.full(tree.nv, velocity), acceleration=np.full(tree.nv, acceleration))


def window(tree: Tree, target: np.ndarray, before: np.ndarray, start: np.ndarray):
    body, local = (AT, ON) if tree is HINGES else (BODY, LOCAL)
    problem = pose_problem(
        tree, start, [PointTargets(body, local, target)], None, None, None, None, 0.0
    )
    return trajectory._Window(problem, price(tree, 2e-4, 3e-7), 0.02, before)


@pytest.mark.parametrize("given", [0, 2])
def test_price_of_motion_has_the_slope_and_curvature_that_the_step_takes(given):
    rng = np.random.default_rng(0)
    start = 0.3 * rng.standard_normal((5, 3))
    before = 0.3 * rng.standard_normal((given, 3))
    some = window(HINGES, np.zeros((5, 4, 3)), before, start)
    now = some._at(start)
    matrix, gradient = normal_equations(HINGES, start, now.pose, some.problem, now.error)
    gradient += some._pull(start)
    for frame, dof in np.ndindex(5, 3):
        step = np.zeros((5, 3))
        step[frame, dof] = 1e-6
        slope = (some._at(start + step).cost - some._at(start - step).cost) / 2e-6
        assert slope == pytest.approx(gradient[frame, dof], rel=1e-5, abs=1e-7)
    moves = rng.random((5, 3)) > 0.2
    band = some._band(matrix.copy(), moves, np.arange(3))
    dense = np.zeros((15, 15))
    for below in range(7):
        for column in range(15 - below):
            dense[column + below, column] = dense[column, column + below] = band[below, column]
    base = some._pull(start)
    for column in np.flatnonzero(moves.ravel()):
        step = np.zeros(15)
        step[column] = 1.0
        wanted = (some._pull(start + step.reshape(5, 3)) - base).reshape(15)
        frame, dof = divmod(column, 3)
        wanted[3 * frame : 3 * frame + 3] += matrix[frame, :, dof]
        np.testing.assert_allclose(dense[:, column], wanted * moves.ravel(), atol=1e-8)
    for column in np.flatnonzero(~moves.ravel()):
        np.testing.assert_array_equal(dense[:, column], np.eye(15)[column])


def test_free_motion_comes_back_at_almost_no_price():
    """Every kind of joint; the price is so small that the targets are met."""
    phase = np.linspace(0.0, 4.0, 60)
    way = 0.4 * np.sin(np.outer(phase, 1.0 + np.arange(TREE.nv) % 4))
    wanted = integrate(TREE, np.tile(TREE.neutral(), (60, 1)), way)
    target = points(forward(TREE, wanted), BODY, LOCAL)
    found = solve_trajectory(
        TREE,
        [np.tile(TREE.neutral(), (60, 1))],
        [PointTargets(BODY, LOCAL, target)],
        step_s=1 / 30,
        price=price(TREE, 0.0, 1e-12),
        iterations=40,
    )
    assert found.residual.max() < 1e-3
    assert np.abs(difference(TREE, wanted, found.qpos)).max() < 0.02


def test_a_swing_is_followed_as_the_price_says():
    """One hinge with stiffness A follows a swing of ω by A / (A + c_v ω² + c_a ω⁴)."""
    tree = Tree(
        parent=np.array([0, 0]),
        offset=np.zeros((2, 3)),
        rotation=np.tile([1.0, 0, 0, 0], (2, 1)),
        joints=(Joint("hinge", 1, 0, 0, np.eye(3)[2], np.zeros(3)),),
    )
    time = np.arange(1200) / 120.0
    omega = 2 * np.pi * 3.0
    angle = 0.05 * np.sin(omega * time)[:, None]
    local = np.array([[0.5, 0.0, 0.0]])
    target = points(forward(tree, angle), np.array([1]), local)
    velocity, acceleration = 2e-4, 4e-7
    found = solve_trajectory(
        tree,
        [np.zeros_like(angle)],
        [PointTargets(np.array([1]), local, target)],
        step_s=1 / 120,
        price=price(tree, velocity, acceleration),
    )
    share = 0.25 / (0.25 + velocity * omega**2 + acceleration * omega**4)
    middle = slice(300, 900)
    got = found.qpos[middle, 0] @ angle[middle, 0] / (angle[middle, 0] @ angle[middle, 0])
    assert share < 0.9, "the case is worth testing"
    assert got == pytest.approx(share, rel=0.01)


def test_windows_leave_no_seam(monkeypatch: pytest.MonkeyPatch):
    rng = np.random.default_rng(1)
    phase = np.linspace(0.0, 20.0, 300)
    wanted = 0.5 * np.sin(np.outer(phase, [1.0, 1.7, 2.3]))
    target = points(forward(HINGES, wanted), AT, ON)
    target += 0.01 * rng.standard_normal(target.shape)

    def solved() -> np.ndarray:
        return solve_trajectory(
            HINGES,
            [np.zeros((300, 3))],
            [PointTargets(AT, ON, target)],
            step_s=1 / 30,
            price=price(HINGES, 1e-5, 1e-8),
            iterations=40,
            tolerance=1e-6,
        ).qpos

    monkeypatch.setattr(trajectory, "WINDOW", 90)
    pieces = solved()
    monkeypatch.setattr(trajectory, "WINDOW", 1000)
    np.testing.assert_allclose(pieces, solved(), atol=2e-3)


def test_one_frame_and_two_frames_are_solved_too():
    for frames in (1, 2, 3):
        target = points(forward(HINGES, np.full((frames, 3), 0.3)), AT, ON)
        found = solve_trajectory(
            HINGES,
            [np.zeros((frames, 3))],
            [PointTargets(AT, ON, target)],
            step_s=0.1,
            price=price(HINGES, 1e-6, 1e-9),
            iterations=20,
        )
        np.testing.assert_allclose(found.qpos, 0.3, atol=1e-3)


def test_another_start_is_taken_where_it_leads_to_less():
    """Seen from afar the elbow bends the wrong way, and limits keep it there."""
    target = points(forward(HINGES, np.tile([0.0, 2.5, 0.0], (20, 1))), AT, ON)
    bad, good = np.tile([3.1, -2.9, 3.0], (20, 1)), np.tile([0.0, 2.0, 0.0], (20, 1))

    def missed(starts: list[np.ndarray], doubt: float) -> float:
        found = solve_trajectory(
            HINGES,
            starts,
            [PointTargets(AT, ON, target)],
            step_s=1 / 30,
            price=price(HINGES, 1e-6, 1e-9),
            lower=np.full(3, -3.2),
            upper=np.array([3.2, 2.6, 3.2]),
            doubt=doubt,
            iterations=30,
        )
        return float(np.nanmax(found.residual))

    assert missed([bad], 0.0) > 0.05, "the case is worth testing"
    assert missed([bad, good], 0.0) < 1e-3
    assert missed([bad, good], 1.0) > 0.05
