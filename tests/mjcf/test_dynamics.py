from __future__ import annotations

import copy
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from physretarget.errors import InputError, UsageError
from physretarget.kinematics import forward, integrate
from physretarget.mjcf import (
    Character,
    derivatives,
    lowpass,
    momentum,
    required_wrench,
)

Array = NDArray[np.float64]
Clip = Callable[..., tuple[Array, Array]]
GRAVITY = 9.81


def at_rest(character: Character, frames: int = 1) -> tuple[Array, Array]:
    qpos = np.repeat(character.reference_qpos[None], frames, axis=0)
    return qpos, np.zeros((frames, character.model.nv))


def simulate(
    character: Character, seconds: float, *, step: float = 1e-4, torque: float = 0.0
) -> tuple[Array, Array, Array]:
    """A simulation far from the floor, from a tumbling start; qpos, qvel, qacc per step."""
    model = copy.copy(character.unconstrained)
    model.opt.timestep = step
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    data = mujoco.MjData(model)
    generator = np.random.default_rng(5)
    data.qpos[:] = character.reference_qpos
    data.qpos[character.root_qpos + 2] += 5.0
    data.qvel[:] = generator.normal(size=model.nv)
    drive = generator.normal(size=model.nv) * torque
    drive[character.root_dof : character.root_dof + 6] = 0
    data.qfrc_applied[:] = drive
    rows = []
    for _ in range(round(seconds / step)):
        mujoco.mj_forward(model, data)
        rows.append((data.qpos.copy(), data.qvel.copy(), data.qacc.copy()))
        mujoco.mj_step(model, data)
    qpos, qvel, qacc = (np.array(part) for part in zip(*rows, strict=True))
    return qpos, qvel, qacc


def test_derivatives_converge_with_second_order(
    any_character: Character, smooth_clip: Clip
) -> None:
    """Halving the step quarters the error, in the middle and at the ends."""
    errors = []
    for fps in (200.0, 400.0):
        fine, fine_time = smooth_clip(any_character, seconds=0.5, fps=3200.0)
        exact, exact_acc = derivatives(any_character, fine, fine_time)
        every = round(3200 / fps)
        qvel, qacc = derivatives(any_character, fine[::every], fine_time[::every])
        ends = [0, -1]
        last = (len(qvel) - 1) * every
        truth = exact[[0, last]], exact_acc[[0, last]]
        middle = slice(2, -2)
        errors.append(
            [
                np.abs(qvel - exact[::every])[middle].max(),
                np.abs(qacc - exact_acc[::every])[middle].max(),
                np.abs(qvel[ends] - truth[0]).max(),
                np.abs(qacc[ends] - truth[1]).max(),
            ]
        )
    ratio = np.array(errors[0]) / np.array(errors[1])
    assert np.all(ratio > 3.0), (errors, ratio)


def test_derivatives_agree_with_mujoco(hopper: Character, smooth_clip: Clip) -> None:
    qpos, time = smooth_clip(hopper, fps=60)
    qvel, _ = derivatives(hopper, qpos, time)
    ahead, behind = np.zeros(hopper.model.nv), np.zeros(hopper.model.nv)
    for t in (1, 17, 60):
        mujoco.mj_differentiatePos(hopper.model, ahead, 1 / 60, qpos[t], qpos[t + 1])
        mujoco.mj_differentiatePos(hopper.model, behind, 1 / 60, qpos[t], qpos[t - 1])
        np.testing.assert_allclose(qvel[t], (ahead - behind) / 2, atol=1e-9)


def test_derivatives_of_short_clips(hopper: Character) -> None:
    qpos, _ = at_rest(hopper, 4)
    qpos[:, 0] = [0.0, 0.1, 0.4, 0.9]  # x = 0.1 k²
    expected = {1: (0.0, 0.0), 2: (1.0, 0.0), 3: (0.0, 20.0), 4: (0.0, 20.0)}
    for frames, (speed, acceleration) in expected.items():
        qvel, qacc = derivatives(hopper, qpos[:frames], np.arange(frames) * 0.1)
        assert qvel[0, 0] == pytest.approx(speed, abs=1e-9)
        np.testing.assert_allclose(qacc[:, 0], acceleration, atol=1e-9)


@pytest.mark.parametrize("time", [[0, 1, 1.5, 3], [0, 1, 2], [0, -1, -2, -3], [0, 0, 0, 0]])
def test_bad_time_is_refused(hopper: Character, time: list[float]) -> None:
    with pytest.raises(InputError):
        derivatives(hopper, at_rest(hopper, 4)[0], np.array(time))


def test_wrong_shapes_are_refused(hopper: Character) -> None:
    qpos, qvel = at_rest(hopper, 3)
    with pytest.raises(InputError, match="qpos"):
        momentum(hopper, qpos[:, 1:], qvel)
    with pytest.raises(InputError, match="needed"):
        momentum(hopper, qpos, qvel[1:])


def test_lowpass_passes_slow_stops_fast_and_keeps_phase(hopper: Character) -> None:
    fps, time = 120.0, np.arange(600) / 120.0
    qpos, _ = at_rest(hopper, 600)

    def gain(hz: float) -> complex:
        qpos[:, 7] = np.sin(2 * np.pi * hz * time)
        out = lowpass(hopper, qpos, fps, 6.0)[150:450, 7]
        wave = np.exp(-2j * np.pi * hz * time[150:450])
        return complex((out @ wave) / (qpos[150:450, 7] @ wave))

    assert abs(gain(1.0)) == pytest.approx(1.0, abs=2e-3)
    assert abs(gain(6.0)) == pytest.approx(0.5, abs=5e-3)
    assert abs(gain(0.802 * 6.0)) == pytest.approx(np.sqrt(0.5), abs=1e-2)
    assert abs(gain(24.0)) < 1e-2
    assert abs(np.angle(gain(6.0))) < 1e-2


def test_lowpass_of_rotations(hopper: Character, smooth_clip: Clip) -> None:
    qpos, time = smooth_clip(hopper, fps=120)
    flipped = qpos.copy()
    flipped[::2, 3:7] *= -1  # the same rotations, written with the other sign
    smooth = lowpass(hopper, flipped, 120.0, 20.0)
    np.testing.assert_allclose(np.linalg.norm(smooth[:, 3:7], axis=1), 1.0, atol=1e-12)
    before, after = forward(hopper.tree, qpos), forward(hopper.tree, smooth)
    np.testing.assert_allclose(after.rotation[10:-10], before.rotation[10:-10], atol=5e-3)
    still, _ = at_rest(hopper, 5)
    np.testing.assert_allclose(lowpass(hopper, still, 120.0, 6.0), still, atol=1e-12)
    with pytest.raises(UsageError, match="30 frames"):
        lowpass(hopper, still, 30.0, 15.0)
    assert time[0] == 0


def test_momentum_is_the_sum_over_bodies(any_character: Character, smooth_clip: Clip) -> None:
    qpos, time = smooth_clip(any_character, fps=2000.0, seconds=0.05)
    qvel, _ = derivatives(any_character, qpos, time)
    got = momentum(any_character, qpos, qvel)
    model = any_character.model
    bodies = any_character.bodies
    mass = model.body_mass[bodies]
    pose = forward(any_character.tree, qpos)
    place = pose.position[:, bodies] + np.einsum(
        "tbij,bj->tbi", pose.rotation[:, bodies], model.body_ipos[bodies]
    )
    com = np.einsum("b,tbi->ti", mass, place) / mass.sum()
    np.testing.assert_allclose(got.com, com, atol=1e-12)
    velocity = np.gradient(place, time, axis=0)
    linear = np.einsum("b,tbi->ti", mass, velocity)
    np.testing.assert_allclose(got.linear[2:-2], linear[2:-2], atol=2e-4)

    turn = np.zeros((model.nbody, 9))
    for body in range(model.nbody):
        mujoco.mju_quat2Mat(turn[body], model.body_iquat[body])
    axes = pose.rotation[:, bodies] @ turn[bodies].reshape(-1, 3, 3)
    tensor = axes @ (model.body_inertia[bodies][:, :, None] * np.swapaxes(axes, 2, 3))
    spin = np.swapaxes(pose.rotation[:, bodies], 2, 3)
    rate = np.gradient(pose.rotation[:, bodies], time, axis=0) @ spin
    omega = np.stack([rate[..., 2, 1], rate[..., 0, 2], rate[..., 1, 0]], axis=-1)
    arm = place - com[:, None]
    relative = velocity - (linear / mass.sum())[:, None]
    angular = np.einsum("tbij,tbj->ti", tensor, omega) + np.einsum(
        "b,tbi->ti", mass, np.cross(arm, relative)
    )
    np.testing.assert_allclose(got.angular[2:-2], angular[2:-2], atol=2e-4)
    square = np.einsum("tbi,tbi->tb", arm, arm)[..., None, None] * np.eye(3)
    steiner = np.einsum("b,tbij->tij", mass, square - arm[..., :, None] * arm[..., None, :])
    np.testing.assert_allclose(got.inertia, tensor.sum(axis=1) + steiner, atol=1e-10)


@pytest.mark.parametrize("name", ["hopper", "two_trees"])
def test_flight_keeps_angular_momentum(name: str, request: pytest.FixtureRequest) -> None:
    character: Character = request.getfixturevalue(name)
    qpos, qvel, qacc = simulate(character, 0.3, torque=0.05)
    got = momentum(character, qpos[::50], qvel[::50])
    time = np.arange(len(got.com)) * 50e-4
    np.testing.assert_allclose(got.angular, got.angular[:1].repeat(len(time), 0), atol=1e-5)
    fall = got.linear[:, 2] - got.linear[0, 2]
    np.testing.assert_allclose(fall, -character.weight * time, atol=1e-5 * character.weight)
    wrench = required_wrench(character, qpos[::50], qvel[::50], qacc[::50])
    assert np.abs(wrench.force).max() < 1e-9 * character.weight
    assert np.abs(wrench.moment).max() < 1e-9 * character.weight


def test_inverse_dynamics_return_the_simulated_torque(hopper: Character) -> None:
    qpos, qvel, qacc = simulate(hopper, 0.05, torque=0.05)
    wrench = required_wrench(hopper, qpos, qvel, qacc)
    generator = np.random.default_rng(5)
    generator.normal(size=hopper.model.nv)
    drive = generator.normal(size=hopper.model.nv) * 0.05
    motors = (wrench.joint_torque - wrench.passive)[:, 6:]
    np.testing.assert_allclose(motors, drive[None, 6:].repeat(len(motors), 0), atol=1e-9)
    assert np.abs(wrench.passive).max() > 1e-3  # the hip's spring and damper


def test_standing_still_is_one_body_weight(any_character: Character) -> None:
    qpos, zero = at_rest(any_character)
    wrench = required_wrench(any_character, qpos, zero, zero)
    weight = any_character.weight
    np.testing.assert_allclose(wrench.force[0], [0, 0, weight], atol=1e-9 * weight)
    arm = wrench.com[0] - wrench.root[0]
    np.testing.assert_allclose(wrench.moment[0], np.cross(arm, [0, 0, weight]), atol=1e-9)


def test_free_fall_needs_nothing(hopper: Character) -> None:
    qpos, zero = at_rest(hopper)
    fall = zero.copy()
    fall[:, 2] = -GRAVITY
    wrench = required_wrench(hopper, qpos, zero, fall)
    assert np.abs(wrench.force).max() < 1e-12
    assert np.abs(wrench.moment).max() < 1e-12


def test_a_clip_below_the_floor_and_past_its_limits_changes_nothing(hopper: Character) -> None:
    qpos, zero = at_rest(hopper)
    sunk = qpos.copy()
    sunk[:, 2] -= 0.5
    above = required_wrench(hopper, qpos, zero, zero)
    below = required_wrench(hopper, sunk, zero, zero)
    np.testing.assert_allclose(above.force, below.force, atol=1e-12)
    sunk[:, 7] = 3.0
    assert np.abs(required_wrench(hopper, sunk, zero, zero).joint_torque[:, 6:]).max() < 10.0


def test_wrench_is_the_rate_of_momentum(any_character: Character, smooth_clip: Clip) -> None:
    """Newton and Euler against inverse dynamics: an independent twin, from momentum alone."""
    qpos, time = smooth_clip(any_character, fps=2000.0, seconds=0.05)
    qvel, qacc = derivatives(any_character, qpos, time)
    wrench = required_wrench(any_character, qpos, qvel, qacc)
    motion = momentum(any_character, qpos, qvel)
    gravity = np.array([0, 0, -any_character.weight])
    force = np.gradient(motion.linear, time, axis=0) - gravity
    moment = np.gradient(motion.angular, time, axis=0) + np.cross(wrench.com - wrench.root, force)
    inside = slice(4, -4)
    scale = any_character.weight
    np.testing.assert_allclose(wrench.force[inside], force[inside], atol=1e-4 * scale)
    np.testing.assert_allclose(wrench.moment[inside], moment[inside], atol=1e-4 * scale)


def test_root_height_acts_affinely(hopper: Character, smooth_clip: Clip) -> None:
    """Yamane 2010, section 5.3: the law on which the root-height optimisation stands."""
    qpos, time = smooth_clip(hopper, fps=60.0)
    qvel, qacc = derivatives(hopper, qpos, time)
    before = required_wrench(hopper, qpos, qvel, qacc)
    rng = np.random.default_rng(1)
    height, speed, lift = (rng.normal(size=len(time)) for _ in range(3))
    moved, moved_vel, moved_acc = qpos.copy(), qvel.copy(), qacc.copy()
    moved[:, 2] += height
    moved_vel[:, 2] += speed
    moved_acc[:, 2] += lift
    after = required_wrench(hopper, moved, moved_vel, moved_acc)
    extra = np.zeros((len(time), 3))
    extra[:, 2] = hopper.mass * lift
    np.testing.assert_allclose(after.force, before.force + extra, atol=1e-9)
    moment = before.moment + np.cross(before.com - before.root, extra)
    np.testing.assert_allclose(after.moment, moment, atol=1e-9)


def test_armature_on_the_root_is_no_burden_of_the_floor() -> None:
    text = (
        "<mujoco><default><joint armature='0.5'/></default><worldbody><body>"
        "<joint type='free'/><geom size='0.1' mass='2'/></body></worldbody></mujoco>"
    )
    ball = Character.from_xml(text)
    qpos, zero = at_rest(ball)
    fall = zero.copy()
    fall[:, 2] = -GRAVITY
    assert np.abs(required_wrench(ball, qpos, zero, fall).force).max() < 1e-12


def test_same_bytes_again(hopper: Character, smooth_clip: Clip) -> None:
    qpos, time = smooth_clip(hopper, fps=60.0)
    qvel, qacc = derivatives(hopper, qpos, time)
    first = required_wrench(hopper, qpos, qvel, qacc)
    second = required_wrench(hopper, qpos, qvel, qacc)
    assert first.moment.tobytes() == second.moment.tobytes()
    assert integrate(hopper.tree, qpos, qvel * 0).shape == qpos.shape


def test_threads_share_a_character(hopper: Character, smooth_clip: Clip) -> None:
    qpos, time = smooth_clip(hopper, fps=120.0)
    qvel, qacc = derivatives(hopper, qpos, time)
    alone = required_wrench(hopper, qpos, qvel, qacc)
    with ThreadPoolExecutor(4) as pool:
        results = list(pool.map(lambda _: required_wrench(hopper, qpos, qvel, qacc), range(8)))
    for result in results:
        np.testing.assert_array_equal(result.joint_torque, alone.joint_torque)


@pytest.mark.parametrize(
    ("clip", "hz", "lowest", "highest"),
    [("walk", 6.0, 0.69, 1.65), ("wave", 6.0, 0.96, 1.03), ("walk", None, 0.30, 2.45)],
)
def test_robot_clips_as_read_independently(
    data: Path, clip: str, hz: float | None, lowest: float, highest: float
) -> None:
    robot = Character.load(data / "robot" / "g1_no_mesh_box_feet.xml")
    qpos = np.loadtxt(data / "robot" / f"g1_{clip}.csv", delimiter=",")
    qpos = qpos if hz is None else lowpass(robot, qpos, 30.0, hz)
    wrench = required_wrench(robot, qpos, *derivatives(robot, qpos, np.arange(len(qpos)) / 30))
    vertical = wrench.force[:, 2] / robot.weight
    assert vertical.min() == pytest.approx(lowest, abs=0.01)
    assert vertical.max() == pytest.approx(highest, abs=0.01)
