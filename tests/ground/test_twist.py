"""Moments that contacts take besides those of their forces: MuJoCo's torsional and rolling
friction."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from physretarget.clip import Clip
from physretarget.mjcf import Character
from physretarget.validation import Settings
from physretarget.validation.analysis import analyse

RADIUS, TORSION, ROLLING = 0.1, 0.02, 0.01


def ball(condim: int) -> Character:
    text = f"""<mujoco><option integrator="implicitfast" cone="elliptic" timestep="0.001"/>
      <worldbody><geom name="floor" type="plane" size="5 5 .1"/>
      <body name="ball" pos="0 0 {RADIUS}"><freejoint/>
        <geom type="sphere" size="{RADIUS}" condim="{condim}" density="1000"
              friction="1 {TORSION} {ROLLING}"/></body></worldbody></mujoco>"""
    return Character.from_xml(text, name="ball")


def moments_left(condim: int, played: int, kick: NDArray[np.float64]) -> NDArray[np.float64]:
    """(T, 6) BW that the floor bears, and BW h that it leaves unexplained.

    MuJoCo let the ball spin or roll to rest with ``played`` dimensions of contact; it is judged as
    a ball of ``condim``.
    """
    model = ball(played).model
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 300)
    data.qvel[:] = kick
    qpos = []
    for _ in range(200):
        qpos.append(data.qpos.copy())
        mujoco.mj_step(model, data)
    character = ball(condim)
    clip = Clip(
        qpos=np.array(qpos)[::4], time=np.arange(50) * 0.004, joint_names=character.joint_names,
        model_name=character.name, model_sha256=character.sha256,
    )  # fmt: skip
    forces = analyse(clip, character, Settings()).forces
    assert forces is not None
    return np.hstack([forces.required.force, forces.bearing.moment_rest])[5:-5]


SPIN = np.array([0, 0, 0, 0, 0, 30.0])
ROLL = np.array([3.0, 0, 0, 0, 3.0 / RADIUS, 0])


@pytest.mark.parametrize(("condim", "kick"), [(4, SPIN), (6, SPIN), (6, ROLL)])
def test_what_torsional_and_rolling_friction_brake_is_explained(
    condim: int, kick: NDArray[np.float64]
) -> None:
    assert np.abs(moments_left(condim, condim, kick)[:, 3:]).max() < 2e-3


@pytest.mark.parametrize(
    ("condim", "played", "kick", "axis", "arm"),
    [(3, 4, SPIN, 2, TORSION), (4, 6, ROLL, 1, ROLLING)],
)
def test_contacts_without_it_leave_as_much_as_coefficient_times_weight(
    condim: int, played: int, kick: NDArray[np.float64], axis: int, arm: float
) -> None:
    # Soft contacts make it hop, but every push turns it by as much.
    left = moments_left(condim, played, kick)
    turned = np.abs(left[:, 3 + axis].sum()) / left[:, 2].sum()
    np.testing.assert_allclose(turned, arm / RADIUS, rtol=0.05)
