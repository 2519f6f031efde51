from __future__ import annotations

import copy
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from physretarget import capture
from physretarget.demo import models_folder
from physretarget.errors import InputError, UsageError
from physretarget.keyposes import load_keyposes
from physretarget.kinematics import quat_multiply, rotvec_to_quat
from physretarget.mjcf import Character
from physretarget.mjcf.dynamics import derivatives, momentum, required_wrench
from physretarget.passive import (
    Limb,
    PassiveSettings,
    _Prescribed,
    limb_of,
    passive_features,
    swing,
    with_limb,
)
from physretarget.pipeline import RetargetSettings, retarget
from physretarget.trained import learn

Array = NDArray[np.float64]
FPS = 60.0

PENDULUM = """
<mujoco model="pendulum"><worldbody><body name="base"><freejoint/>
  <geom type="box" size=".1 .1 .1" density="1000"/>
  <body><joint name="swing_1" axis="0 1 0" {joint}/>
    <geom type="sphere" size=".001" pos="0 0 -.5" mass="1"/></body>
</body></worldbody><custom>{custom}</custom></mujoco>
"""


def pendulum(joint: str = "", custom: str = '<text name="passive" data="swing_*"/>') -> Character:
    return Character.from_xml(PENDULUM.format(joint=joint, custom=custom))


@pytest.fixture(scope="module")
def squirrel() -> Character:
    return Character.load(models_folder() / "squirrel.xml")


def limb(character: Character) -> Limb:
    found = limb_of(character)
    assert found is not None
    return found


def hopping(character: Character, seconds: float = 1.5) -> tuple[Array, Array]:
    """The body hops, turns and bows; smooth everywhere."""
    time = np.arange(round(seconds * FPS) + 1) / FPS
    qpos = np.tile(character.reference_qpos, (len(time), 1))
    phase = 2 * np.pi * time
    qpos[:, 0] += 0.1 * np.sin(phase)
    qpos[:, 2] += 0.1 * (1 - np.cos(1.5 * phase))
    turn = np.stack([0.1 * np.sin(phase), 0.3 * np.sin(1.2 * phase), 0.5 * np.sin(phase)], axis=1)
    qpos[:, 3:7] = quat_multiply(rotvec_to_quat(turn), qpos[:, 3:7])
    qpos[:, 7] += 0.2 * np.sin(2 * phase)
    return qpos, time


def test_the_squirrels_tail_is_passive(squirrel: Character) -> None:
    names = limb(squirrel).names
    assert len(names) == 16
    assert all(name.startswith("tail_") for name in names)
    columns = passive_features(squirrel).reshape(-1, 3)[:, 0]
    told = [name for name, on in zip(squirrel.markers.names, columns, strict=True) if on]
    assert len(told) == 24
    assert all("tail" in name for name in told)


def test_at_rest_it_hangs_where_gravity_and_springs_balance(squirrel: Character) -> None:
    qpos, time = hopping(squirrel)
    qpos[:] = qpos[0]
    swung = swing(squirrel, qpos, time)
    assert np.ptp(swung.qpos, axis=0).max() < 1e-4
    still = np.zeros((1, squirrel.model.nv))
    wrench = required_wrench(squirrel, swung.qpos[:1], still, still)
    motor = (wrench.joint_torque - wrench.passive)[0, limb(squirrel).dof]
    assert np.abs(motor).max() < 1e-3
    home = squirrel.reference_qpos[limb(squirrel).qpos]
    assert swung.qpos[0, limb(squirrel).qpos] == pytest.approx(home, abs=0.02)


def test_a_pendulum_has_its_period() -> None:
    character = pendulum()
    time = np.arange(181) / FPS
    qpos = np.tile(character.reference_qpos, (len(time), 1))
    # Set off by a jerk of the base: afterwards the base is at rest.
    qpos[:, 0] = 0.02 * np.tanh((time - 0.2) / 0.05)
    angle = swing(character, qpos, time).qpos[:, 7]
    time, angle = time[time > 0.6], angle[time > 0.6]
    before = np.flatnonzero(np.diff(np.sign(angle)) != 0)
    share = angle[before] / (angle[before] - angle[before + 1])
    crossings = time[before] + share / FPS
    assert 2 * np.mean(np.diff(crossings)) == pytest.approx(
        2 * np.pi * np.sqrt(0.5 / 9.81), rel=0.01
    )


def test_a_stiff_spring_follows_and_a_damper_settles() -> None:
    stiff = pendulum('stiffness="2000" damping="20"')
    qpos, time = hopping(stiff)
    assert np.abs(swing(stiff, qpos, time).qpos[:, 7]).max() < 0.03


@dataclass(frozen=True)
class Forward:
    """A forward simulation of the whole model by mj_step, sampled at the clip's frames."""

    qpos: Array
    linear: Array
    angular: Array
    force: Array


def forward(character: Character, qpos: Array, time: Array, per_frame: int = 40) -> Forward:
    """The body is driven along the clip by brute force: so heavy an armature that nothing the
    tail does is felt, pushed with exactly the acceleration wanted. The tail is left alone."""
    model = copy.copy(character.unconstrained)
    tail = limb(character).dof
    driven = np.setdiff1d(np.arange(model.nv), tail)
    heavy = 1e7
    model.opt.timestep = 1 / FPS / per_frame
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
    model.dof_armature[driven] = heavy
    data = mujoco.MjData(model)
    fine = _Prescribed.between(character, qpos, time, per_frame)
    data.qpos, data.qvel = fine.qpos[0], fine.qvel[0]
    data.qvel[tail] = 0.0
    kept, linear, angular = [], [], []
    away = np.zeros(model.nv)
    for k in range(len(fine.time)):
        if k % per_frame == 0 or k % per_frame in (1, per_frame - 1):
            mujoco.mj_fwdPosition(model, data)
            mujoco.mj_comVel(model, data)
            mujoco.mj_subtreeVel(model, data)
            linear.append(character.mass * data.subtree_linvel[1])
            angular.append(data.subtree_angmom[1].copy())
        if k % per_frame == 0:
            kept.append(data.qpos.copy())
        mujoco.mj_differentiatePos(model, away, 1.0, data.qpos, fine.qpos[k])
        wanted = fine.qacc[k] + 1e4 * away + 200.0 * (fine.qvel[k] - data.qvel)
        data.qfrc_applied[driven] = heavy * wanted[driven]
        mujoco.mj_step(model, data)
    # Samples come as frame, just after, just before the next frame, the next frame, ...
    momenta, spins = np.array(linear), np.array(angular)
    step = 2 / FPS / per_frame
    force = (momenta[4::3] - momenta[2:-2:3]) / step
    force[:, 2] += character.weight
    return Forward(np.array(kept), momenta[::3], spins[::3], force)


def test_it_agrees_with_a_forward_simulation(squirrel: Character) -> None:
    """Stated tolerances: 0.5 degrees, 2 % of momentum, 3 % of the required force."""
    qpos, time = hopping(squirrel)
    swung = swing(squirrel, qpos, time)
    simulated = forward(squirrel, swung.qpos, time)
    tail = limb(squirrel).qpos
    assert np.ptp(swung.qpos[:, tail], axis=0).max() > 0.2
    assert np.abs(simulated.qpos[:, tail] - swung.qpos[:, tail]).max() < np.radians(0.5)

    qvel, qacc = derivatives(squirrel, swung.qpos, time)
    own = momentum(squirrel, swung.qpos, qvel)
    inner = slice(3, -3)
    for mine, theirs in ((own.linear, simulated.linear), (own.angular, simulated.angular)):
        miss = np.abs(mine - theirs)[inner].max()
        assert miss < 0.02 * np.abs(theirs[inner]).max()

    wrench = required_wrench(squirrel, swung.qpos, qvel, qacc)
    frames = slice(3, len(simulated.force) - 3)
    miss = np.abs(wrench.force[1 : len(simulated.force) + 1] - simulated.force)[frames].max()
    assert miss < 0.03 * np.abs(simulated.force[frames]).max()


def test_no_motor_works_in_the_tail(squirrel: Character) -> None:
    qpos, time = hopping(squirrel)
    dof = limb(squirrel).dof

    def motor(clip: Array) -> float:
        qvel, qacc = derivatives(squirrel, clip, time)
        wrench = required_wrench(squirrel, clip, qvel, qacc)
        left = (wrench.joint_torque - wrench.passive)[3:-3, dof]
        return float(np.sqrt(np.mean(left**2)))

    assert motor(swing(squirrel, qpos, time).qpos) < 0.1 * motor(qpos)


def test_a_finer_step_changes_little(squirrel: Character) -> None:
    qpos, time = hopping(squirrel, 0.5)
    coarse = swing(squirrel, qpos, time).qpos
    fine = swing(squirrel, qpos, time, settings=PassiveSettings(step=0.00025)).qpos
    assert np.abs(coarse - fine).max() < np.radians(0.5)


def test_limits_are_kept_softly() -> None:
    character = pendulum('range="-20 20" stiffness="0.5" damping="0.05"')
    time = np.arange(61) / FPS
    qpos = np.tile(character.reference_qpos, (len(time), 1))
    qpos[:, 0] = 0.5 * np.sin(2 * np.pi * time)
    swung = swing(character, qpos, time)
    assert np.abs(swung.qpos[:, 7]).max() <= np.radians(20) + 1e-12
    assert swung.stopped.any()
    assert "limit" in swung.notes[0]


def test_only_the_limb_moves_and_only_it_is_copied(squirrel: Character) -> None:
    qpos, time = hopping(squirrel, 0.3)
    swung = swing(squirrel, qpos, time)
    others = np.setdiff1d(np.arange(squirrel.model.nq), limb(squirrel).qpos)
    assert np.array_equal(swung.qpos[:, others], qpos[:, others])
    assert np.array_equal(with_limb(squirrel, qpos, swung.qpos), swung.qpos)
    assert np.array_equal(swing(squirrel, qpos, time).qpos, swung.qpos)


def test_refusals(squirrel: Character) -> None:
    assert limb_of(pendulum(custom="")) is None
    with pytest.raises(InputError, match="names no passive joints"):
        swing(pendulum(custom=""), np.zeros((2, 8)), np.arange(2.0))
    with pytest.raises(InputError, match="'tail', which is no joint"):
        limb_of(pendulum(custom='<text name="passive" data="tail"/>'))
    with pytest.raises(InputError, match="is a free"):
        limb_of(pendulum(custom='<text name="passive" data="*"/>'))
    with pytest.raises(UsageError, match="contact stage"):
        RetargetSettings(tail="passive", until="placed")


def test_the_pipeline_lets_it_swing(squirrel: Character, motions: Path) -> None:
    keyposes = load_keyposes(models_folder() / "squirrel.keyposes.toml", squirrel)
    mapper = learn(squirrel, keyposes, mapper="gp")
    motion = capture.load(motions / "humanoid3d_walk.txt")
    result = retarget(motion, mapper, settings=RetargetSettings(tail="passive"))
    clip = result.clip
    assert result.contacted is not None
    again = swing(squirrel, clip.qpos, clip.time)
    assert np.abs(again.qpos - clip.qpos).max() < np.radians(2)
    assert clip.meta["settings"]["tail"] == "passive"
