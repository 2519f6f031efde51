"""The tree against MuJoCo, an independent implementation of the same conventions."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from physretarget.kinematics import (
    Joint,
    Tree,
    difference,
    forward,
    integrate,
    jacobian,
    points,
)

KINDS = {0: "free", 1: "ball", 2: "slide", 3: "hinge"}


def random_xml(rng: np.random.Generator, bodies: int, free: bool) -> str:
    def numbers(n: int, scale: float = 1.0) -> str:
        return " ".join(f"{x:.6f}" for x in scale * rng.standard_normal(n))

    children: dict[int, list[int]] = {i: [] for i in range(bodies + 1)}
    for body in range(1, bodies + 1):
        children[0 if body == 1 else int(rng.integers(1, body))].append(body)

    def joints(body: int) -> str:
        if body == 1 and free:
            return "<freejoint/>"
        choice = rng.integers(0, 5)
        text = ""
        if choice in (0, 1):
            text += f'<joint type="slide" axis="{numbers(3)}" pos="{numbers(3)}" ref="0.3"/>'
        if choice in (1, 2):
            for _ in range(int(rng.integers(1, 4))):
                text += f'<joint type="hinge" axis="{numbers(3)}" pos="{numbers(3)}" ref="0.4"/>'
        if choice == 3:
            text += f'<joint type="ball" pos="{numbers(3)}"/>'
        return text

    def body_xml(body: int) -> str:
        inside = "".join(body_xml(c) for c in children[body])
        return (
            f'<body pos="{numbers(3)}" quat="{numbers(4)}">{joints(body)}'
            f'<geom size="0.1"/>{inside}</body>'
        )

    return (
        '<mujoco><compiler angle="radian"/><worldbody>'
        + "".join(body_xml(c) for c in children[0])
        + "</worldbody></mujoco>"
    )


def tree_of(model: mujoco.MjModel) -> Tree:
    joints = tuple(
        Joint(
            kind=KINDS[int(model.jnt_type[j])],
            body=int(model.jnt_bodyid[j]),
            qpos=int(model.jnt_qposadr[j]),
            dof=int(model.jnt_dofadr[j]),
            axis=model.jnt_axis[j].copy(),
            anchor=model.jnt_pos[j].copy(),
            reference=float(model.qpos0[model.jnt_qposadr[j]]),
        )
        for j in range(model.njnt)
    )
    return Tree(
        parent=model.body_parentid.astype(np.int64),
        offset=model.body_pos.copy(),
        rotation=model.body_quat.copy(),
        joints=joints,
    )


@pytest.fixture(params=range(6))
def case(request: pytest.FixtureRequest) -> tuple[mujoco.MjModel, Tree, np.random.Generator]:
    rng = np.random.default_rng(request.param)
    model = mujoco.MjModel.from_xml_string(random_xml(rng, 9, free=request.param % 2 == 0))
    return model, tree_of(model), rng


def random_qpos(tree: Tree, rng: np.random.Generator, frames: int) -> np.ndarray:
    start = np.tile(tree.neutral(), (frames, 1))
    return integrate(tree, start, rng.standard_normal((frames, tree.nv)))


def test_sizes_and_neutral_agree(case):
    model, tree, _ = case
    assert (tree.nq, tree.nv, tree.nb) == (model.nq, model.nv, model.nbody)
    np.testing.assert_allclose(tree.neutral(), model.qpos0, atol=1e-12)


def test_forward_and_jacobian_agree_with_mujoco(case):
    model, tree, rng = case
    qpos = random_qpos(tree, rng, 4)
    body = rng.integers(0, tree.nb, 12)
    local = rng.standard_normal((12, 3))
    pose = forward(tree, qpos)
    at = points(pose, body, local)
    slopes = jacobian(tree, pose, qpos, body, local)
    data = mujoco.MjData(model)
    for frame in range(4):
        data.qpos[:] = qpos[frame]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        np.testing.assert_allclose(pose.position[frame], data.xpos, atol=1e-10)
        np.testing.assert_allclose(
            pose.rotation[frame].reshape(-1, 9), data.xmat.reshape(-1, 9), atol=1e-10
        )
        for k in range(12):
            expected = np.zeros((3, model.nv))
            mujoco.mj_jac(model, data, expected, None, at[frame, k], int(body[k]))
            np.testing.assert_allclose(slopes[frame, 3 * k : 3 * k + 3], expected, atol=1e-10)


def test_jacobian_agrees_with_finite_differences(case):
    _, tree, rng = case
    qpos = random_qpos(tree, rng, 1)
    body, local = np.arange(tree.nb), rng.standard_normal((tree.nb, 3))
    slopes = jacobian(tree, forward(tree, qpos), qpos, body, local)[0]
    h = 1e-6
    for dof in range(tree.nv):
        step = np.zeros((1, tree.nv))
        step[0, dof] = h
        ahead = points(forward(tree, integrate(tree, qpos, step)), body, local)
        behind = points(forward(tree, integrate(tree, qpos, -step)), body, local)
        np.testing.assert_allclose(slopes[:, dof], (ahead - behind).ravel() / (2 * h), atol=1e-7)


def test_integrate_and_difference_agree_with_mujoco(case):
    model, tree, rng = case
    start = random_qpos(tree, rng, 5)
    step = rng.standard_normal((5, tree.nv))
    end = integrate(tree, start, step)
    for frame in range(5):
        expected = start[frame].copy()
        mujoco.mj_integratePos(model, expected, step[frame], 1.0)
        np.testing.assert_allclose(end[frame], expected, atol=1e-12)
        back = np.zeros(model.nv)
        mujoco.mj_differentiatePos(model, back, 1.0, start[frame], end[frame])
        np.testing.assert_allclose(difference(tree, start, end)[frame], back, atol=1e-10)
