from __future__ import annotations

import numpy as np
import pytest

from physretarget.errors import UsageError
from physretarget.kinematics import (
    Joint,
    PointTargets,
    Tree,
    difference,
    difference_slopes,
    forward,
    integrate,
    jacobian,
    points,
    rises,
    solve,
    stiffness,
)
from physretarget.kinematics.solver import add_prior, normal_equations, pose_problem


def arm(free: bool = True) -> Tree:
    """Root, ball, hinge, hinge, slide: every kind of joint in one chain with a branch."""
    axis = np.eye(3)
    zero = np.zeros(3)
    kinds = [("free" if free else "ball", 1, 2), ("ball", 2, 2), ("hinge", 3, 1)]
    kinds += [("hinge", 3, 2), ("slide", 4, 0), ("hinge", 5, 1)]
    joints, q, v = [], 0, 0
    for kind, body, direction in kinds:
        joints.append(Joint(kind, body, q, v, axis[direction], zero))
        q += {"free": 7, "ball": 4}.get(kind, 1)
        v += {"free": 6, "ball": 3}.get(kind, 1)
    return Tree(
        parent=np.array([0, 0, 1, 2, 3, 1]),
        offset=np.array([[0, 0, 0]] + [[0, 0, 0.3]] * 3 + [[0.3, 0, 0], [0, 0.3, 0]], float),
        rotation=np.tile([1.0, 0, 0, 0], (6, 1)),
        joints=tuple(joints),
    )


TREE = arm()
BODY = np.repeat(np.arange(1, 6), 4)
LOCAL = np.random.default_rng(7).uniform(-0.2, 0.2, (20, 3))


def motion(frames: int, scale: float = 0.4, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    start = np.tile(TREE.neutral(), (frames, 1))
    return integrate(TREE, start, scale * rng.standard_normal((frames, TREE.nv)))


def test_normal_equations_equal_the_dense_jacobian():
    qpos, rng = motion(5), np.random.default_rng(3)
    target = rng.standard_normal((5, 20, 3))
    weight = rng.random((5, 20))
    some = PointTargets(BODY, LOCAL, target, weight)
    problem = pose_problem(TREE, qpos, [some], None, None, None, None, 0.0)
    pose = forward(TREE, qpos)
    error = problem.errors(pose)
    matrix, gradient = normal_equations(TREE, qpos, pose, problem, error)
    dense = jacobian(TREE, pose, qpos, BODY, LOCAL)
    wide = np.repeat(weight, 3, axis=1)
    np.testing.assert_allclose(matrix, np.einsum("tki,tk,tkj->tij", dense, wide, dense), atol=1e-10)
    expected = np.einsum("tki,tk->ti", dense, wide * error.reshape(5, -1))
    np.testing.assert_allclose(gradient, expected, atol=1e-10)


def test_recovers_a_known_motion_and_chunks_do_not_matter():
    truth = motion(70)
    target = points(forward(TREE, truth), BODY, LOCAL)
    some = [PointTargets(BODY, LOCAL, target)]
    found = solve(TREE, TREE.neutral(), some)
    assert found.converged.all()
    assert np.nanmax(found.residual) < 1e-5
    again = solve(TREE, TREE.neutral(), some, chunk=16)
    np.testing.assert_allclose(found.qpos, again.qpos, atol=1e-9)


def test_missing_targets_are_left_out_and_priors_fill_in():
    truth = motion(10)
    target = points(forward(TREE, truth), BODY, LOCAL)
    target[:, BODY == 5] = np.nan
    found = solve(TREE, TREE.neutral(), [PointTargets(BODY, LOCAL, target)], prior_weight=1e-8)
    assert np.isnan(found.residual[:, BODY == 5]).all()
    assert np.nanmax(found.residual) < 1e-4
    np.testing.assert_allclose(found.qpos[:, -1], 0, atol=1e-6)


def test_bounds_hold_and_are_optimal():
    truth = motion(30, scale=0.8)
    target = points(forward(TREE, truth), BODY, LOCAL)
    lower, upper = np.full(TREE.nq, -np.inf), np.full(TREE.nq, np.inf)
    hinges = [11, 12, 13, 14]
    lower[hinges], upper[hinges] = -0.3, 0.3
    found = solve(
        TREE, TREE.neutral(), [PointTargets(BODY, LOCAL, target)], lower=lower, upper=upper,
        iterations=100,
    )  # fmt: skip
    assert (found.qpos[:, hinges] >= -0.3).all()
    assert (found.qpos[:, hinges] <= 0.3).all()
    # No small feasible step may lower the cost.
    cost = np.sum(found.residual**2, axis=1)
    rng = np.random.default_rng(0)
    for _ in range(20):
        step = 1e-3 * rng.standard_normal((30, TREE.nv))
        other = np.clip(integrate(TREE, found.qpos, step), lower, upper)
        gap = points(forward(TREE, other), BODY, LOCAL) - target
        assert (np.sum(gap**2, axis=(1, 2)) >= cost - 1e-7).all()


def test_locked_dofs_stay():
    truth = motion(10)
    target = points(forward(TREE, truth), BODY, LOCAL)
    locked = np.zeros(TREE.nv, dtype=bool)
    locked[:6] = True
    found = solve(TREE, TREE.neutral(), [PointTargets(BODY, LOCAL, target)], locked=locked)
    np.testing.assert_array_equal(found.qpos[:, :7], np.tile(TREE.neutral()[:7], (10, 1)))


def test_prior_pulls_towards_itself():
    truth, prior = motion(5), motion(5, seed=9)
    target = points(forward(TREE, truth), BODY, LOCAL)
    some = [PointTargets(BODY, LOCAL, target)]
    stiff = solve(TREE, TREE.neutral(), some, prior=prior, prior_weight=1e6)
    np.testing.assert_allclose(difference(TREE, prior, stiff.qpos), 0, atol=1e-4)


def test_uneven_priors_have_the_right_slope():
    qpos, prior = motion(6, scale=1.0), motion(6, scale=1.0, seed=4)
    weight = np.random.default_rng(1).random(TREE.nv)
    none = PointTargets(BODY, LOCAL, np.full((6, 20, 3), np.nan))
    problem = pose_problem(TREE, qpos, [none], None, None, None, prior, weight)
    matrix, gradient = np.zeros((6, TREE.nv, TREE.nv)), np.zeros((6, TREE.nv))
    add_prior(problem, qpos, matrix, gradient)
    h = 1e-6
    for dof in range(TREE.nv):
        step = np.zeros((6, TREE.nv))
        step[:, dof] = h
        cost = [
            problem.cost(q, np.zeros((6, 20, 3)))
            for q in (integrate(TREE, qpos, step), integrate(TREE, qpos, -step))
        ]
        np.testing.assert_allclose(gradient[:, dof], (cost[0] - cost[1]) / (2 * h), atol=1e-7)


def test_no_targets_is_an_error():
    with pytest.raises(UsageError, match="at least one"):
        solve(TREE, TREE.neutral(), [])


def test_stiffness_is_that_of_the_jacobian() -> None:
    rng = np.random.default_rng(1)
    tree = arm()
    qpos = integrate(tree, np.tile(tree.neutral(), (3, 1)), rng.normal(0, 0.3, (3, tree.nv)))
    pose = forward(tree, qpos)
    body, local = np.array([1, 3, 5, 4]), rng.normal(size=(4, 3))
    weight = rng.uniform(0.1, 2.0, (3, 4))
    slope = jacobian(tree, pose, qpos, body, local)
    twin = np.swapaxes(slope, 1, 2) @ (np.repeat(weight, 3, axis=1)[..., None] * slope)
    assert stiffness(tree, qpos, pose, body, local, weight) == pytest.approx(twin, abs=1e-10)


def test_rises_are_vertical_rows_of_the_jacobian() -> None:
    rng = np.random.default_rng(2)
    tree = arm()
    qpos = integrate(tree, np.tile(tree.neutral(), (3, 1)), rng.normal(0, 0.3, (3, tree.nv)))
    pose = forward(tree, qpos)
    frame, body, local = np.array([0, 2, 2]), np.array([5, 3, 4]), rng.normal(size=(3, 3))
    rows = rises(tree, pose, qpos, frame, body, local)
    for row, t, b, at in zip(rows, frame, body, local, strict=True):
        whole = jacobian(tree, pose, qpos, np.array([b]), at[None])
        assert row == pytest.approx(whole[t, 2], abs=1e-12)


def test_slopes_of_a_difference_are_its_derivatives() -> None:
    rng = np.random.default_rng(3)
    tree = arm()
    start = integrate(tree, np.tile(tree.neutral(), (3, 1)), rng.normal(0, 0.4, (3, tree.nv)))
    end = integrate(tree, start, rng.normal(0, 0.5, (3, tree.nv)))
    step, eps = rng.normal(size=(3, tree.nv)), 1e-6
    by_start, by_end = difference_slopes(tree, start, end)
    for slope, moved in (
        (by_start, lambda s: difference(tree, integrate(tree, start, s * step), end)),
        (by_end, lambda s: difference(tree, start, integrate(tree, end, s * step))),
    ):
        twin = (moved(eps) - moved(-eps)) / (2 * eps)
        # Rows times the derivative: the derivative's own rows, times the step.
        unit = np.tile(np.eye(tree.nv), (3, 1, 1))
        found = (slope.times(unit) @ step[..., None])[..., 0]
        assert found == pytest.approx(twin, abs=1e-8)
