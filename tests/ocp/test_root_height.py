from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from physretarget.errors import InputError, UsageError
from physretarget.mjcf import Character
from physretarget.mjcf.dynamics import derivatives, required_wrench
from physretarget.ocp import PRESETS, RootHeightSettings, bound, optimise
from physretarget.ocp import ipopt as ipopt_solver
from physretarget.ocp.basis import differences, gaussian_basis, sparse_of
from physretarget.ocp.bound import vertical_bound
from physretarget.ocp.gauss_newton import Normal, Outcome, solve
from physretarget.ocp.problem import build, lowest_displacement
from physretarget.ocp.scene import scene_of

Make = Callable[..., Any]


def test_basis_is_the_papers_gaussians() -> None:
    time = np.arange(50) / 30
    basis = gaussian_basis(time, 0.1)
    centres = 0.1 * np.arange(basis.count)
    full = np.exp(-(((time[:, None] - centres) / 0.2) ** 2))
    np.testing.assert_allclose(sparse_of(basis, basis.value).toarray(), full, atol=2e-7)
    weights = np.random.default_rng(0).normal(size=basis.count)
    value, rate, curvature = basis.motion(weights)
    np.testing.assert_allclose(value, full @ weights, atol=1e-5)
    first, second = differences(50, 1 / 30)
    np.testing.assert_allclose(rate, first @ value, atol=1e-9)
    np.testing.assert_allclose(curvature, second @ value, atol=1e-7)


@pytest.mark.parametrize("frames", [4, 5, 40])
def test_raising_the_root_is_exactly_affine(frames: int, hopper: Make) -> None:
    """The forces predicted from one pass agree with a full pass of the raised clip."""
    character = hopper()
    rng = np.random.default_rng(1)
    time = np.arange(frames) / 30
    qpos = np.zeros((frames, 7))
    qpos[:, :3] = rng.normal(scale=0.05, size=(frames, 3))
    qpos[:, 3:] = rng.normal(scale=0.1, size=(frames, 4))
    qpos[:, 2:4] += [0.25, 1.0]
    qpos[:, 3:] /= np.linalg.norm(qpos[:, 3:], axis=1, keepdims=True)
    active = np.ones((frames, 4), dtype=bool)
    before = scene_of(character, qpos, time, active)
    basis = gaussian_basis(time, 0.05)
    value, rate, curvature = basis.motion(rng.normal(scale=0.02, size=basis.count))
    raised = qpos.copy()
    raised[:, 2] += value
    after = required_wrench(character, raised, *derivatives(character, raised, time))
    lift = np.zeros((frames, 3))
    lift[:, 2] = character.mass * curvature
    np.testing.assert_allclose(after.force, before.force + lift, atol=1e-8)
    moment = before.moment + np.cross(before.arm, lift)
    np.testing.assert_allclose(after.moment, moment, atol=1e-8)
    again = scene_of(character, raised, time, active)
    np.testing.assert_allclose(again.height, before.height + value[:, None], atol=1e-12)
    np.testing.assert_allclose(again.velocity[..., 2], before.velocity[..., 2] + rate[:, None])


@pytest.mark.parametrize("name", PRESETS)
def test_derivatives_are_exact(name: str, hopper: Make, hops: Make) -> None:
    qpos, time, active = hops(2.0)
    rng = np.random.default_rng(2)
    error, variance = rng.normal(scale=0.01, size=(60, 12)), rng.uniform(1e-4, 1e-3, 60)
    scene = scene_of(hopper(), qpos, time, active, error, variance)
    problem = build(scene, RootHeightSettings.preset(name))
    f0 = 3 * problem.model.residual
    s = [rng.normal(scale=scale, size=60) for scale in (0.01, 0.1, 2.0)]
    _, slopes = problem.evaluate(tuple(s), f0)
    for axis, step in enumerate((1e-7, 1e-6, 1e-5)):
        ahead, behind = [v.copy() for v in s], [v.copy() for v in s]
        ahead[axis] += step
        behind[axis] -= step
        numeric = problem.evaluate(tuple(ahead), f0)[0] - problem.evaluate(tuple(behind), f0)[0]
        size = np.abs(slopes[..., axis]).max() + 1.0
        np.testing.assert_allclose(
            slopes[..., axis], numeric / (2 * step), rtol=1e-4, atol=1e-5 * size
        )


def test_normal_equations_are_those_of_the_dense_jacobian() -> None:
    time = np.arange(40) / 30
    basis = gaussian_basis(time, 0.05)
    rng = np.random.default_rng(3)
    r, slopes = rng.normal(size=(40, 4)), rng.normal(size=(40, 4, 3))
    operators = [sparse_of(basis, b).toarray() for b in (basis.value, basis.rate, basis.curvature)]
    dense = sum(slopes[..., a][..., None] * operators[a][:, None] for a in range(3))
    jacobian = np.asarray(dense).reshape(160, -1)
    matrix, rhs = Normal(basis).equations(r, slopes, 0.5)
    expected = jacobian.T @ jacobian + 0.5 * np.eye(basis.count)
    np.testing.assert_allclose(rhs, jacobian.T @ r.ravel(), rtol=1e-9, atol=1e-6)
    band = matrix.shape[0] - 1
    for i in range(basis.count):
        for j in range(i, basis.count):
            entry = matrix[band + i - j, j] if j - i <= band else 0.0
            assert entry == pytest.approx(expected[i, j], rel=1e-9, abs=1e-6)


def test_blocks_of_frames_make_no_difference(
    hopper: Make, hops: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    character = hopper()
    qpos, time, active = hops(2.0)
    whole = optimise(character, qpos, time, active)
    for module in ("problem", "gauss_newton"):
        monkeypatch.setattr(f"physretarget.ocp.{module}.BLOCK", 7)
    parts = optimise(character, qpos, time, active)
    assert parts.qpos.tobytes() == whole.qpos.tobytes()
    assert parts.contact_after.tobytes() == whole.contact_after.tobytes()


@pytest.mark.parametrize("seed", range(3))
def test_both_solvers_reach_the_papers_optimum(seed: int, hopper: Make, hops: Make) -> None:
    """Two algorithms, the same cold start: the same cost and the same way of the root."""
    qpos, time, active = hops(3.0, seed=seed)
    settings = replace(RootHeightSettings.preset("paper"), tolerance=1e-10)
    banded, ipopt = (
        optimise(hopper(), qpos, time, active, settings=replace(settings, solver=solver))
        for solver in ("banded", "ipopt")
    )
    assert banded.status == ipopt.status == "converged"
    assert ipopt.mismatch_after == pytest.approx(banded.mismatch_after, rel=1e-4)
    np.testing.assert_allclose(ipopt.displacement, banded.displacement, atol=1e-5)
    assert np.abs(banded.displacement).max() > 1e-3
    # what is optimised is what both are said to have optimised
    scene = scene_of(hopper(), qpos, time, active)
    basis = gaussian_basis(time, settings.interval)
    problem = build(scene, settings)
    f0, ridge = problem.model.residual, settings.weights
    start = np.zeros(basis.count)
    one = solve(problem, basis, start, f0=f0, ridge=ridge, iterations=200, tolerance=1e-10)
    two = ipopt_solver.solve(problem, basis, start, f0=f0, ridge=ridge)
    assert two.cost == pytest.approx(one.cost, rel=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_where_one_solver_ends_the_other_stays(seed: int, hopper: Make, hops: Make) -> None:
    """The stiff floor leaves several local optima; each is one for both solvers."""
    qpos, time, active = hops(3.0, seed=seed)
    settings = RootHeightSettings()
    scene = scene_of(hopper(), qpos, time, active)
    problem, basis = build(scene, settings), gaussian_basis(time, settings.interval)

    def banded(start: np.ndarray, f0: float) -> Outcome:
        return solve(problem, basis, start, f0=f0, ridge=settings.weights, iterations=500,
                     tolerance=1e-10)  # fmt: skip

    def ipopt(start: np.ndarray, f0: float) -> Outcome:
        return ipopt_solver.solve(problem, basis, start, f0=f0, ridge=settings.weights)

    for first, second in ((banded, ipopt), (ipopt, banded)):
        weights = np.zeros(basis.count)
        for factor in settings.continuation:
            found = first(weights, factor * problem.model.residual)
            weights = found.weights
        again = second(weights, problem.model.residual)
        assert again.cost == pytest.approx(found.cost, rel=1e-5)
        moved = basis.motion(again.weights)[0] - basis.motion(weights)[0]
        assert np.abs(moved).max() < 1e-4


def test_hops_become_physical(hopper: Make, hops: Make) -> None:
    character = hopper()
    qpos, time, active = hops(6.0)
    result = optimise(character, qpos, time, active)
    assert result.improvement > 0.6
    assert np.abs(result.displacement).max() <= 0.15 * character.height
    assert result.ballistic_vertical_after < 0.5 * result.ballistic_vertical_before
    assert result.pull_after < result.pull_before
    assert result.verified < 1e-6
    assert result.bound_rms <= result.mismatch_after
    # only the root's height has changed
    moved = result.qpos - qpos
    np.testing.assert_allclose(moved[:, 2], result.displacement)
    assert np.abs(np.delete(moved, 2, axis=1)).max() == 0.0


def test_a_clip_that_stands_still_only_sinks_into_its_contact(hopper: Make) -> None:
    qpos = np.tile([0, 0, 0.25, 1, 0, 0, 0.0], (60, 1))
    character = hopper()
    result = optimise(character, qpos, np.arange(60) / 30, np.ones((60, 4), dtype=bool))
    assert result.mismatch_after < 0.01 * character.weight
    assert result.displacement.min() > -0.01 * character.height
    assert np.isnan(result.ballistic_before)


def test_continuation_beats_a_cold_start(hopper: Make, hops: Make) -> None:
    qpos, time, active = hops(6.0)
    cold = RootHeightSettings(continuation=(1.0,), iterations=180)
    results = [optimise(hopper(), qpos, time, active, settings=s) for s in (None, cold)]
    assert results[0].mismatch_after < 0.8 * results[1].mismatch_after


def test_convex_forces_stay_in_their_cones_and_reach_the_bound(hopper: Make, hops: Make) -> None:
    character = hopper()
    qpos, time, active = hops(4.0)
    result = optimise(character, qpos, time, active, settings=RootHeightSettings.preset("convex"))
    force = result.contact_after
    assert (force[:, 2] >= -1e-5).all()
    slip = np.linalg.norm(force[:, :2], axis=1) - character.friction * force[:, 2]
    assert slip.max() < 1e-4 * character.weight
    assert np.abs(force[~active.any(axis=1)]).max() == 0.0
    assert result.bound_rms <= result.mismatch_after < result.mismatch_before


def test_bound_of_a_clip_that_cannot_be_mended(hopper: Make) -> None:
    """Told to fly while it stands: gravity stays unexplained, whatever the root does."""
    character = hopper()
    qpos = np.tile([0, 0, 0.25, 1, 0, 0, 0.0], (90, 1))
    time = np.arange(90) / 30
    never = np.zeros(90, dtype=bool)
    scene = scene_of(character, qpos, time, np.zeros((90, 4), dtype=bool))
    basis = gaussian_basis(time, 1 / 30)
    bound = vertical_bound(scene, basis, never, np.zeros(90), 0.01)
    assert 0.9 * character.weight < bound <= character.weight


def test_pose_knowledge_holds_the_root(hopper: Make, hops: Make) -> None:
    qpos, time, active = hops(3.0)
    error = np.zeros((len(qpos), 12))
    free = optimise(hopper(), qpos, time, active)
    held = optimise(
        hopper(),
        qpos,
        time,
        active,
        pose_error=error,
        pose_variance=np.full(len(qpos), 1e-6),
        settings=RootHeightSettings(pose=1.0, pose_floor=0.0),
    )
    assert np.abs(held.displacement).max() < 0.3 * np.abs(free.displacement).max()
    unknown = optimise(
        hopper(), qpos, time, active, pose_error=error, pose_variance=np.full(len(qpos), np.nan)
    )
    np.testing.assert_array_equal(unknown.displacement, free.displacement)


def test_same_input_same_bytes(hopper: Make, hops: Make) -> None:
    qpos, time, active = hops(2.0)
    one, two = (optimise(hopper(), qpos, time, active) for _ in range(2))
    assert one.qpos.tobytes() == two.qpos.tobytes()


def test_every_preset_runs_and_unknown_ones_are_named(hopper: Make, hops: Make) -> None:
    qpos, time, active = hops(2.0)
    for name in PRESETS:
        result = optimise(hopper(), qpos, time, active, settings=RootHeightSettings.preset(name))
        assert np.isfinite(result.qpos).all()
    with pytest.raises(UsageError, match="default, paper, convex"):
        RootHeightSettings.preset("moon")


def test_what_cannot_be_optimised_is_said(hopper: Make, hops: Make) -> None:
    qpos, time, active = hops(2.0)
    with pytest.raises(InputError, match="at least four frames"):
        optimise(hopper(), qpos[:3], time[:3], active[:3])
    with pytest.raises(InputError, match="contact phases have shape"):
        optimise(hopper(), qpos, time, active[:, :2])
    bare = Character.from_xml(
        "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
    )
    with pytest.raises(InputError, match="no contact points"):
        optimise(bare, qpos, time, active)
    fixed = Character.from_xml(
        "<mujoco><worldbody><body><joint/><geom size='.1'/></body></worldbody></mujoco>"
    )
    with pytest.raises(InputError, match="no free root joint"):
        optimise(fixed, np.zeros((10, 1)), np.arange(10) / 30, np.zeros((10, 0), dtype=bool))


TAILED = """<mujoco model="tailed"><option gravity="0 0 -9.81"/><worldbody>
<geom name="floor" type="plane" size="5 5 .1" friction="0.8"/>
<body name="box" pos="0 0 0.25"><freejoint/>
<geom type="box" size=".12 .1 .05" pos="0 0 -.2" mass="2"/>
<geom type="box" size=".05 .05 .2" pos=".03 .01 .05" mass="1"/>
<geom name="tail" type="sphere" size=".02" pos="-.2 0 -.262" mass="0.01"/>
<site name="contact_a" pos=".12 .1 -.25"/><site name="contact_b" pos=".12 -.1 -.25"/>
<site name="contact_c" pos="-.12 .1 -.25"/><site name="contact_d" pos="-.12 -.1 -.25"/>
</body></worldbody></mujoco>"""


@pytest.mark.parametrize("name", ["default", "convex"])
def test_nothing_is_lowered_through_the_floor(name: str, hops: Make) -> None:
    """A flight that is too high is lowered, but only until the tail touches the floor."""
    character = Character.from_xml(TAILED)
    time = np.arange(60) / 30
    qpos = np.zeros((60, 7))
    qpos[:, 2], qpos[:, 3] = 0.25 + 0.035, 1.0  # it floats: the tail 3 mm over the floor
    active = np.ones((60, 4), dtype=bool)
    settings = replace(RootHeightSettings.preset(name), hold=0.0)
    scene = scene_of(character, qpos, time, active)
    np.testing.assert_allclose(scene.clearance, 0.285 - 0.282, atol=1e-9)
    least = lowest_displacement(scene, settings)
    np.testing.assert_allclose(least, -(0.003 + settings.floor * character.height))
    free = replace(settings, floor=np.inf)
    bound = optimise(character, qpos, time, active, settings=settings)
    unbound = optimise(character, qpos, time, active, settings=free)
    assert bound.displacement.min() > least[0] - 1e-3
    assert unbound.displacement.min() < least[0] - 0.01


def test_what_is_below_the_floor_already_is_lowered_no_further(hopper: Make) -> None:
    character = hopper()
    qpos = np.zeros((20, 7))
    qpos[:, 2], qpos[:, 3] = 0.25 - 0.03, 1.0
    time, active = np.arange(20) / 30, np.ones((20, 4), dtype=bool)
    settings = RootHeightSettings()
    least = lowest_displacement(scene_of(character, qpos, time, active), settings)
    np.testing.assert_allclose(least, -0.1 * settings.floor * character.height)


def test_a_long_clip_is_solved_piece_by_piece_as_if_at_once(
    hopper: Make, hops: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    character = hopper()
    qpos, time, active = hops(12.0)
    settings = RootHeightSettings.preset("convex")
    whole = optimise(character, qpos, time, active, settings=settings)
    monkeypatch.setattr(bound, "CONE_WINDOW", 70)
    monkeypatch.setattr(bound, "CONE_AHEAD", 60)
    pieces = optimise(character, qpos, time, active, settings=settings)
    assert pieces.iterations > 3 * whole.iterations
    moved = np.abs(pieces.displacement - whole.displacement).max()
    assert moved < 1e-4 * character.height
    push = np.abs(pieces.contact_after - whole.contact_after).max()
    assert push < 1e-2 * character.weight
    assert pieces.mismatch_after == pytest.approx(whole.mismatch_after, rel=1e-4)
    monkeypatch.setattr(bound, "CONE_AHEAD", 1)
    short = optimise(character, qpos, time, active, settings=settings)
    assert np.abs(short.displacement - whole.displacement).max() > 10 * moved


def test_pieces_are_never_shorter_than_a_weight_acts(
    hopper: Make, hops: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else the next piece begins where this one did, without end."""
    monkeypatch.setattr(bound, "CONE_WINDOW", 1)
    monkeypatch.setattr(bound, "CONE_AHEAD", 60)
    qpos, time, active = hops(6.0)
    found = optimise(hopper(), qpos, time, active, settings=RootHeightSettings.preset("convex"))
    assert np.isfinite(found.displacement).all()
