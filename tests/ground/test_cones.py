"""The batched cone fit against a conic solver, and the geometry around it."""

from __future__ import annotations

import clarabel
import mujoco
import numpy as np
import pytest
import scipy.sparse as sp
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.ground.cones import RHO, fit_forces
from physretarget.ground.contacts import find_contacts
from physretarget.ground.undersides import undersides
from physretarget.mjcf import Character

Array = NDArray[np.float64]


def map_of(arm: Array) -> Array:
    """(6, 3n): forces at points to force and moment."""
    x, y, z = arm.T
    zero = np.zeros_like(x)
    cross = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]])
    return np.vstack([np.tile(np.eye(3), len(arm)), cross.transpose(0, 2, 1).reshape(3, -1)])


def clarabel_fit(arm: Array, b: Array, friction: float, rho: Array) -> tuple[Array, Array]:
    """The same problem by an interior-point conic solver: forces (n, 3), residual (6,)."""
    n = len(arm)
    scale = np.array([1.0, 1.0, friction**2])
    quadratic = sp.block_diag([sp.diags(np.outer(rho, scale).ravel()), sp.eye(6)]).tocsc()
    equal = sp.hstack([sp.csc_matrix(map_of(arm)), sp.eye(6)])
    cone = np.zeros((3 * n, 3 * n + 6))
    for i in range(n):
        cone[3 * i, 3 * i + 2] = -friction
        cone[3 * i + 1, 3 * i] = cone[3 * i + 2, 3 * i + 1] = -1
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-13
    cones = [clarabel.ZeroConeT(6)] + [clarabel.SecondOrderConeT(3)] * n
    solver = clarabel.DefaultSolver(
        sp.triu(quadratic).tocsc(), np.zeros(3 * n + 6),
        sp.vstack([equal, sp.csc_matrix(cone)]).tocsc(), np.r_[b, np.zeros(3 * n)], cones, settings,
    )  # fmt: skip
    x = np.array(solver.solve().x)
    return x[: 3 * n].reshape(n, 3), x[3 * n :]


def random_cases(seed: int, frames: int = 120, points: int = 8):  # type: ignore[no-untyped-def]
    rng = np.random.default_rng(seed)
    arm = 0.3 * rng.normal(size=(frames, points, 3))
    arm[..., 2] = -1 + 0.02 * rng.normal(size=(frames, points))
    mask = rng.random((frames, points)) < 0.7
    wrench = np.c_[0.4 * rng.normal(size=(frames, 2)), 1 + rng.normal(size=frames)]
    wrench = np.c_[wrench, 0.2 * rng.normal(size=(frames, 3))]
    return rng, arm, mask, wrench


def objective(force: Array, arm: Array, b: Array, friction: float, rho: Array) -> float:
    price = rho[:, None] * np.array([1, 1, friction**2]) * force**2
    return 0.5 * float(np.sum((b - map_of(arm) @ force.ravel()) ** 2) + price.sum())


@pytest.mark.parametrize(("seed", "friction"), [(0, 0.3), (1, 0.8), (2, 1.0), (3, 2.0)])
@pytest.mark.parametrize("spread", [True, False])
def test_fit_agrees_with_a_conic_solver(seed: int, friction: float, spread: bool) -> None:
    rng, arm, mask, wrench = random_cases(seed)
    rho = 10 ** rng.uniform(-6, -3, size=mask.shape) if spread else np.full(mask.shape, RHO)
    fit = fit_forces(arm, mask, wrench, friction=friction, rho=rho)
    assert fit.converged.all()
    for t in np.flatnonzero(mask.any(axis=1)):
        there = mask[t]
        case = arm[t, there], wrench[t], friction, rho[t, there]
        force, residual = clarabel_fit(*case)
        # What is reported is the size of the unexplained wrench: equal to 1e-6 where there is
        # one; where it vanishes the conic solver stops a little short of it.
        ours, theirs = np.linalg.norm(fit.residual[t]), np.linalg.norm(residual)
        assert ours <= theirs + 1e-6
        assert theirs <= ours + (1e-6 if ours > 1e-3 else 1e-5)
        mine = objective(fit.force[t, there], *case)
        assert mine <= objective(force, *case) + 1e-9
        # Clarabel's own components are good to about 1e-5.
        np.testing.assert_allclose(fit.residual[t], residual, atol=5e-5)


def test_fit_is_optimal_to_rounding() -> None:
    _, arm, mask, wrench = random_cases(4, frames=300)
    rho = np.full(mask.shape, 1e-5)
    mu = 0.7
    fit = fit_forces(arm, mask, wrench, friction=mu, rho=rho)
    for t in np.flatnonzero(mask.any(axis=1)):
        p, f = arm[t, mask[t]], fit.force[t, mask[t]]
        # KKT: the dual slack lies in the dual cone and is orthogonal to the force.
        pull = (map_of(p).T @ fit.residual[t]).reshape(-1, 3)
        slack = 1e-5 * f * [1, 1, mu**2] - pull
        assert (np.linalg.norm(slack[:, :2], axis=1) * mu <= slack[:, 2] + 1e-7).all()
        assert np.abs(np.sum(slack * f, axis=1)).max() < 1e-6


@pytest.mark.parametrize("seed", range(3))
def test_fit_is_optimal_where_force_is_dear_and_cones_lean(seed: int) -> None:
    """Many points, none like another, force explained first: what Newton's steps find least easily.
    The dual slack lies in the dual cone and is orthogonal to the force."""
    rng = np.random.default_rng(seed)
    frames, points = 100, 40
    arm = rng.normal(size=(frames, points, 3)) * [0.2, 0.2, 0.02] - [0, 0, 1.0]
    mu = rng.uniform(0.1, 1.0, size=(frames, points))
    lean = rng.normal(size=(frames, points, 2)) * 0.3
    mask = rng.random((frames, points)) < 0.7
    # A force that they can give, as the caller asks for, and a moment that they mostly can't.
    up = rng.exponential(size=(frames, points, 1)) * mask[..., None] / points
    force = np.concatenate([lean * up, up], axis=2).sum(axis=1)
    wrench = np.hstack([force, rng.normal(size=(frames, 3)) * 0.2])
    rho, weight = 1e-6, np.repeat([1e4, 1.0], 3)
    fit = fit_forces(arm, mask, wrench, friction=mu, rho=rho, lean=lean, force_weight=1e4)
    assert fit.converged.all()
    np.testing.assert_allclose(fit.gradient, weight * fit.residual, atol=2e-4)
    for t in range(frames):
        force, tilt, m = fit.force[t, mask[t]], lean[t, mask[t]], mu[t, mask[t]]
        own = np.c_[force[:, :2] - tilt * force[:, 2:], force[:, 2]]
        pull = (map_of(arm[t, mask[t]]).T @ fit.gradient[t]).reshape(-1, 3)
        pull[:, 2] += np.sum(tilt * pull[:, :2], axis=1)
        slack = rho * own * np.c_[np.ones((len(m), 2)), m**2] - pull
        assert (np.linalg.norm(own[:, :2], axis=1) <= m * own[:, 2] + 1e-9).all()
        assert (np.linalg.norm(slack[:, :2], axis=1) * m <= slack[:, 2] + 1e-9).all()
        assert np.abs(np.sum(slack * own, axis=1)).max() < 1e-8


def test_forces_lie_in_their_cones_and_make_the_residual() -> None:
    _, arm, mask, wrench = random_cases(7)
    fit = fit_forces(arm, mask, wrench, friction=0.6)
    tangent = np.linalg.norm(fit.force[..., :2], axis=2)
    assert (tangent <= 0.6 * fit.force[..., 2] + 1e-9).all()
    assert not fit.force[~mask].any()
    for t in range(len(arm)):
        made = map_of(arm[t]) @ fit.force[t].ravel()
        np.testing.assert_allclose(wrench[t] - made, fit.residual[t], atol=1e-9)


def test_what_the_cones_can_give_is_given() -> None:
    rng, arm, mask, _ = random_cases(11)
    mask[:, :3] = True
    force = np.abs(rng.normal(size=arm.shape)) * [0.2, 0.2, 1.0] * mask[..., None]
    wrench = np.stack([map_of(a) @ f.ravel() for a, f in zip(arm, force, strict=True)])
    fit = fit_forces(arm, mask, wrench, friction=1.0)
    assert np.abs(fit.residual).max() < 1e3 * RHO * np.abs(wrench).max()


def test_pull_and_no_points_leave_everything_unexplained() -> None:
    arm = np.array([[[0.0, 0.0, -1.0]], [[0.0, 0.0, -1.0]]])
    wrench = np.array([[0, 0, -1.0, 0, 0, 0], [0, 0, 1.0, 0, 0, 0]])
    fit = fit_forces(arm, np.array([[True], [False]]), wrench, friction=1.0)
    np.testing.assert_allclose(fit.residual, wrench, atol=1e-12)


SHAPES = """<mujoco><asset><mesh name="m" vertex="0 0 0 .2 0 0 0 .1 0 0 0 .3 .1 .1 .1"/></asset>
<worldbody><body name="a" pos="0 0 1"><freejoint/>
<geom type="sphere" size=".1" pos=".3 0 0"/>
<geom type="capsule" size=".05 .2" pos="0 .3 0" euler="20 30 0"/>
<geom type="box" size=".1 .2 .3" pos="0 0 .2" euler="10 0 40"/>
<geom type="cylinder" size=".1 .2" pos="-.3 0 0" euler="0 50 0"/>
<geom type="ellipsoid" size=".1 .2 .3" pos="0 -.3 0" euler="70 20 0"/>
<geom type="mesh" mesh="m" mass="1"/>
</body></worldbody></mujoco>"""


def test_lowest_points_agree_with_collision_distances() -> None:
    character = Character.from_xml(SHAPES, name="shapes")
    rng = np.random.default_rng(2)
    qpos = np.c_[rng.normal(size=(20, 3)), rng.normal(size=(20, 4))]
    qpos[:, 3:] /= np.linalg.norm(qpos[:, 3:], axis=1, keepdims=True)
    pose = kinematics.forward(character.tree, qpos)
    ours = undersides(character).lowest(pose)[..., 2].min(axis=1)
    # A plane far below: MuJoCo's own distance of each geom to it.
    plane = '<worldbody><geom name="floor" type="plane" size="1 1 .1" pos="0 0 -9"/>'
    model = mujoco.MjModel.from_xml_string(SHAPES.replace("<worldbody>", plane))
    data = mujoco.MjData(model)
    for t in range(20):
        data.qpos[:] = qpos[t]
        mujoco.mj_kinematics(model, data)
        apart = [
            mujoco.mj_geomDistance(model, data, 0, g, 100.0, None) for g in range(1, model.ngeom)
        ]
        assert ours[t] == pytest.approx(min(apart) - 9, abs=1e-6)


def test_touching_points_are_few_and_outermost() -> None:
    character = Character.from_xml(
        """<mujoco><worldbody><geom type="plane" size="1 1 .1"/><body pos="0 0 .1"><freejoint/>
        <geom type="cylinder" size=".2 .1"/></body></worldbody></mujoco>""",
        name="disc",
    )
    pose = kinematics.forward(character.tree, character.reference_qpos[None])
    found = find_contacts(undersides(character), pose, 0.0, 0.01)
    assert (found.outer.sum(), found.mask.sum()) == (8, 24)
    assert found.lowest[0] == pytest.approx(0, abs=1e-12)
    far = np.linalg.norm(found.position[0, :, :2], axis=1)
    np.testing.assert_allclose(far, 0.2, rtol=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_what_forces_in_their_cones_make_is_explained(seed: int) -> None:
    """Impacts on one side of a body that rolls: forces of several body weights at the edges of
    their cones, points near each other, arms long beside the height. Nothing remains of a wrench
    that such forces make."""
    rng = np.random.default_rng(seed)
    frames, points, friction = 400, 12, 0.42
    arm = rng.normal(size=(frames, 1, 3)) + 0.3 * rng.normal(size=(frames, points, 3))
    arm[..., 2] = -0.9 + 0.05 * rng.normal(size=(frames, points))
    mask = np.arange(points) < rng.integers(2, points, size=(frames, 1))
    up = rng.uniform(0, 3, size=(frames, points)) * (rng.random((frames, points)) < 0.4) * mask
    way = rng.uniform(0, 2 * np.pi, size=(frames, points))
    along = friction * up * np.where(rng.random((frames, points)) < 0.5, 1.0, 0.5)
    force = np.stack([along * np.cos(way), along * np.sin(way), up], axis=2)
    wrench = np.hstack([force.sum(axis=1), np.cross(arm, force).sum(axis=1)])
    rho = 10 ** rng.uniform(-7, -4, size=mask.shape)
    fit = fit_forces(arm, mask, wrench, friction=friction, rho=rho, force_weight=1e4)
    assert fit.converged.all()
    assert np.abs(fit.residual).max() < 0.02
