"""The simulated clips are what they are taken for: MuJoCo's physics, with the truth beside it."""

from __future__ import annotations

from functools import cache

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.simulations.judge import Take, judged, simulated, takes
from benchmarks.simulations.models import SMALL
from benchmarks.simulations.simulate import RATES, Simulation

Array = NDArray[np.float64]


@cache
def simulation(subject: str, scenario: str, seed: int = 7) -> Simulation:
    return simulated(Take(subject, scenario, seed, 0))


def momenta(played: Simulation) -> tuple[Array, Array, Array, Array]:
    """CoM (S, 3), its velocity, angular momentum about it, and mechanical energy (S,)."""
    model = played.subject.model
    data = mujoco.MjData(model)
    rows = []
    for step in range(len(played.qpos) - 1):
        data.qpos[:] = played.qpos[step]
        # Semi-implicit integration: the velocity that leads to the next pose is that of the next.
        mujoco.mj_differentiatePos(
            model, data.qvel, 1 / played.subject.steps, played.qpos[step], played.qpos[step + 1]
        )
        mujoco.mj_forward(model, data)
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        mujoco.mj_subtreeVel(model, data)
        rows.append(
            (data.subtree_com[1].copy(), data.subtree_linvel[1].copy(),
             data.subtree_angmom[1].copy(), data.energy.sum())
        )  # fmt: skip
    com, velocity, spin, energy = zip(*rows, strict=True)
    return np.array(com), np.array(velocity), np.array(spin), np.array(energy)


@pytest.mark.parametrize("subject", [*SMALL, "lamp"])
def test_the_recorded_force_is_what_moves_the_body(subject: str) -> None:
    """Newton and Euler over half a second of landing, against momenta that MuJoCo computes."""
    played = simulation(subject, "drop")
    character = played.subject.character
    _, velocity, spin, _ = momenta(played)
    first, last = 1, played.subject.steps
    time = (last - first) / played.subject.steps
    impulse = played.force[first:last].sum(axis=0) / played.subject.steps
    gained = character.mass * (velocity[last - 1] - velocity[first - 1])
    gained[2] += character.weight * time
    np.testing.assert_allclose(gained, impulse, atol=2e-3 * character.weight)
    turned = played.moment[first:last].sum(axis=0) / played.subject.steps
    np.testing.assert_allclose(
        spin[last - 1] - spin[first - 1],
        turned,
        atol=0.01 * character.weight * character.com_height,
    )


def test_nothing_but_gravity_acts_in_the_air() -> None:
    """Until it lands, what is dropped falls at g, and nothing touches it."""
    played = simulation("four legs", "drop")
    landing = int(np.argmax(np.any(played.force != 0, axis=1)))
    assert landing > 100
    com, *_ = momenta(played)
    falling = np.diff(com[: landing - 1], n=2, axis=0) * played.subject.steps**2
    np.testing.assert_allclose(falling, np.broadcast_to([0, 0, -9.81], falling.shape), atol=0.02)
    assert not any(played.touches[s] for s in played.touches if s < landing - 1)


@pytest.mark.parametrize("subject", ["turtle", "bird", "ball"])
def test_a_limp_body_never_gains_energy(subject: str) -> None:
    """Nothing drives a ragdoll: energy goes down, but for what springs of contacts
    within the body held at the start."""
    played = simulation(subject, "ragdoll")
    *_, energy = momenta(played)
    reach = played.subject.character.weight * played.subject.character.height
    assert energy.max() <= energy[0] + 0.05 * reach
    assert energy[-1] < energy[0]


@pytest.mark.parametrize("subject", ["six legs", "arm"])
def test_a_stand_ends_with_the_weight_on_the_floor(subject: str) -> None:
    played = simulation(subject, "stand")
    mean = played.force[-played.subject.steps // 5 :].mean(axis=0) / played.subject.character.weight
    np.testing.assert_allclose(mean, [0, 0, 1], atol=0.02)
    touches = played.touches[max(played.touches)]
    assert touches
    assert all(abs(t.depth) < 0.01 for t in touches)


def test_a_hop_leaves_the_floor() -> None:
    played = simulation("four legs", "hop")
    flight = np.all(played.force == 0, axis=1).mean() * len(played.force) / played.subject.steps
    assert 0.02 < flight < 1.0
    assert played.force[:, 2].max() > 2 * played.subject.character.weight


@pytest.mark.parametrize("fps", RATES)
def test_every_frame_rate_shows_the_same_simulation(fps: int) -> None:
    played = simulation("box", "push")
    clip = played.clip(fps)
    assert abs(clip.duration - (len(played.qpos) - 1) / played.subject.steps) < 1 / fps
    assert clip.fps == pytest.approx(fps)
    frame = clip.frames // 2
    step = frame * (played.subject.steps // fps)
    np.testing.assert_array_equal(clip.qpos[frame], played.qpos[step])
    assert step in played.touches


def test_what_frames_see_of_a_force_is_the_acceleration_of_their_positions() -> None:
    """An impact shorter than a frame is spread over the two frames around it."""
    played = simulation("box", "drop")
    fps = 60
    every = played.subject.steps // fps
    com, *_ = momenta(played)
    character = played.subject.character
    for frame in range(2, 40):
        middle = frame * every
        seen = (com[middle - every] - 2 * com[middle] + com[middle + every]) * fps**2
        expected = played.true_force(fps, frame)[1] / character.mass - [0, 0, 9.81]
        np.testing.assert_allclose(seen, expected, atol=0.03 * 9.81)


def test_a_take_is_repeatable_and_seeds_differ() -> None:
    again = simulated(Take("bird", "fall", 7, 0))
    np.testing.assert_array_equal(again.qpos, simulation("bird", "fall").qpos)
    other = simulated(Take("bird", "fall", 8, 0))
    assert other.subject.character.mass != again.subject.character.mass


def test_there_are_over_two_hundred_simulations_without_any_data(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("benchmarks.simulations.judge.g1_file", lambda: None)
    chosen = list(takes(0, 3))
    assert len(set(chosen)) == len(chosen) > 200
    assert {t.scenario for t in chosen} >= {"stand", "push", "drop", "fall", "ragdoll", "hop",
                                            "skid", "swing"}  # fmt: skip


def test_an_alarm_stands_beside_the_truth() -> None:
    """A clip lifted off its floor floats, and the alarm carries MuJoCo's force."""
    played = simulation("box", "drop")
    lifted = played.qpos.copy()
    lifted[:, 2] += 0.05
    wrong = Simulation(
        played.subject, lifted, played.force, played.moment, played.torque, played.touches
    )
    result = judged(Take("box", "drop", 7, 0), wrong, 60)
    floating = [a for a in result.alarms if a.code == "CON003"]
    assert floating
    assert floating[0].seen_force is not None
    assert floating[0].seen_force == pytest.approx(
        played.true_force(60, floating[0].frame or 0)[1][2] / played.subject.character.weight
    )
    assert floating[0].seen_force > 0.5


@pytest.mark.parametrize("subject", ["four legs", "bird"])
def test_motors_keep_to_their_limits(subject: str) -> None:
    played = simulation(subject, "dance")
    limit = played.subject.model.jnt_actfrcrange[1:, 1]
    assert np.all(limit > 0)
    used = np.abs(played.torque[:, 6:]) / limit
    assert 0.05 < used.max() <= 0.9
