"""The least torque: what statics says, what the simulation's motors did, and no more."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import linprog

from benchmarks.simulations.judge import Take, simulated
from physretarget.clip import Clip
from physretarget.mjcf import Character
from physretarget.validation import Settings, validate
from physretarget.validation.analysis import analyse
from physretarget.validation.least_torque import _least, _Programme

G = 9.81


def crane(joint: str = "", geom: str = "", box: str = "") -> Character:
    """A heavy box on the floor that holds 2 kg at the end of half a metre: 9.81 N m."""
    return Character.from_xml(
        f"""<mujoco><compiler angle="radian" autolimits="true"/><worldbody>
    <geom type="plane" size="9 9 .1"/>
    <body pos="0 0 .2"><freejoint/><geom type="box" size=".3 .3 .2" mass="30"/>{box}
      <body pos="0 0 .3"><joint name="bar" axis="0 1 0" {joint}/>
        <geom type="sphere" size=".05" pos=".5 0 0" mass="2" {geom}/></body></body>
    </worldbody></mujoco>"""
    )


def held(character: Character, angle: float = 0.0) -> float:
    """The share of the bar's torque that a second of standing still needs."""
    pose = character.reference_qpos.copy()
    pose[-1] = angle
    clip = Clip(qpos=np.tile(pose, (31, 1)), time=np.arange(31) / 30)
    share = validate(clip, character).measures["joint_torque_ratio_max"].value
    assert share is not None
    return share


def test_a_held_bar_needs_what_statics_says() -> None:
    assert held(crane('actuatorfrcrange="-4 4"')) == pytest.approx(G / 4, rel=1e-6)
    assert held(crane('actuatorfrcrange="-40 4"'), 1.0) == pytest.approx(
        G / 40 * np.cos(1.0), rel=1e-6
    )


def test_dry_friction_helps() -> None:
    weak = crane('actuatorfrcrange="-4 4" frictionloss="3"')
    assert held(weak) == pytest.approx((G - 3) / 4, rel=1e-6)


def test_a_spring_of_its_own_helps_as_far_as_it_pushes() -> None:
    """The spring pushes up by 3 N m at rest; without damping it is no controller's gain."""
    sprung = crane('actuatorfrcrange="-4 4" stiffness="10" springref="-0.3"')
    assert held(sprung) == pytest.approx((G - 3) / 4, rel=1e-6)


def test_the_gains_of_a_controller_do_not_help() -> None:
    driven = crane('actuatorfrcrange="-4 4" stiffness="100" damping="10" springref="-0.3"')
    assert held(driven) == pytest.approx(G / 4, rel=1e-6)


@pytest.mark.parametrize(("limits", "share"), [("-1 0", 0.0), ("0 1", G / 4)])
def test_a_stop_holds_from_its_own_side_only(limits: str, share: float) -> None:
    """Gravity turns the bar towards greater angles: the upper stop holds it, the lower not."""
    assert held(crane(f'actuatorfrcrange="-4 4" range="{limits}"')) == pytest.approx(
        share, abs=1e-6
    )


def test_a_bar_that_lies_on_its_own_box_needs_nothing() -> None:
    """Of what its own shelf bears nothing passes through the joint; 3 cm lower it bears none."""
    shelf = """<body><joint name="shelf" axis="0 0 1"/>
      <geom type="box" pos=".5 0 .23" size=".1 .1 .02" mass=".1"/></body>"""
    joint = 'actuatorfrcrange="-4 4"'
    assert held(crane(joint, box=shelf)) == pytest.approx(0.0, abs=1e-6)
    lower = shelf.replace(".23", ".2")
    assert held(crane(joint, box=lower)) == pytest.approx(G / 4, rel=1e-6)


def sides() -> Character:
    """A beam on two posts, each on a hip whose motor is weak: the floor may bear either post."""
    legs = "".join(
        f"""<body pos="{x} 0 0"><joint axis="0 1 0" actuatorfrcrange="-5 5"/>
      <geom type="capsule" fromto="0 0 0 {reach} 0 -.5" size=".03" mass=".01"/></body>"""
        for x, reach in ((-0.4, 0.1), (0.4, -0.1))
    )
    return Character.from_xml(
        f"""<mujoco><compiler angle="radian"/><worldbody><geom type="plane" size="9 9 .1"/>
    <body pos="0 0 .53"><freejoint/><geom type="box" size=".5 .1 .05" mass="20"/>{legs}</body>
    </worldbody></mujoco>"""
    )


def test_friction_between_the_legs_takes_load_off_the_hips() -> None:
    """Each post bears 98 N a tenth of a metre inward of its hip: 9.8 N m, unless the feet press
    outwards. At half a metre below, 19.6 N along the floor, well within friction, take it all."""
    frames = np.tile(sides().reference_qpos, (31, 1))
    report = validate(Clip(qpos=frames, time=np.arange(31) / 30), sides())
    assert report.measures["joint_torque_ratio_max"].value == pytest.approx(0.0, abs=0.02)
    icy = validate(
        Clip(qpos=frames, time=np.arange(31) / 30), sides(), settings=Settings(friction=0.05)
    )
    spared = 0.05 * 0.53 * 98.1 / np.cos(np.pi / 8)
    assert icy.measures["joint_torque_ratio_max"].value == pytest.approx(
        (9.81 - spared) / 5, rel=0.05
    )


def programme(seed: int, rays: int = 24, rows: int = 8) -> _Programme:
    """A programme whose wrench some forces along its rays make; every fourth row is moved by none.

    Its rays are those of a floor: they press, so that no loads hold each other.
    """
    rng = np.random.default_rng(seed)
    slopes = rng.normal(size=(rows, rays))
    slopes[::4] = 0.0
    equal = rng.normal(size=(6, rays))
    equal[2] = 1.0
    wrench = equal @ rng.exponential(size=rays)
    return _Programme(slopes, 3 * rng.normal(size=rows), equal, wrench, np.arange(rows))


def test_shares_solved_at_once_are_those_of_the_programme_itself() -> None:
    """The twin is the primal, in the forces, one frame at a time: no gap between the two."""
    every = [programme(seed) for seed in range(20)]
    shares, which = _least(every)
    for p, share, joint in zip(every, shares, which, strict=True):
        rays = p.slopes.shape[1]
        primal = linprog(
            np.r_[np.zeros(rays), 1.0], np.c_[-p.slopes, -np.ones(len(p.bare))], -p.bare,
            np.c_[p.equal, np.zeros(6)], p.wrench,
        )  # fmt: skip
        assert primal.x is not None
        assert share == pytest.approx(primal.fun, abs=1e-9)
        if share > 0:  # the joint that is named is at that share
            assert (p.bare - p.slopes @ primal.x[:-1])[joint] == pytest.approx(share, abs=1e-9)


def test_a_frame_without_a_solution_leaves_the_others_theirs() -> None:
    """A floor cannot pull: the wrench of one of three frames is turned down."""
    first, second, third = (programme(seed) for seed in range(3))
    pulled = replace(second, wrench=-second.wrench)
    shares, _ = _least([first, pulled, third])
    assert shares[1] == np.inf
    np.testing.assert_allclose(shares[[0, 2]], _least([first, third])[0], atol=1e-12)


@pytest.mark.parametrize("subject", ["four legs", "bird"])
@pytest.mark.parametrize("scenario", ["dance", "ragdoll", "swing"])
@pytest.mark.parametrize("fps", [60, 250])
def test_simulated_motors_are_believed(subject: str, scenario: str, fps: int) -> None:
    """Motors of the simulation keep to nine tenths of their limits; limp joints use none."""
    played = simulated(Take(subject, scenario, 5, 0))
    analysis = analyse(played.clip(fps), played.subject.character, Settings(), None)
    assert analysis.series.torque is not None
    needed: NDArray[np.float64] = analysis.series.torque.share
    assert (needed > 1.0).mean() < 0.02
    assert np.quantile(needed, 0.95) < 0.95


@pytest.mark.parametrize("first", range(0, 16, 3))
def test_a_stop_that_is_met_between_two_frames_is_no_work_of_the_motor(first: int) -> None:
    """MuJoCo lets a limp bar fall on its stop; any frame may lie before or after the blow."""
    character = Character.from_xml(
        """<mujoco><compiler angle="radian" autolimits="true"/><option timestep="0.001"/>
        <worldbody><body><joint name="bar" axis="0 1 0" range="-1 1" solreflimit="0.004 1"
          actuatorfrcrange="-1 1"/><geom type="capsule" fromto="0 0 0 .4 0 0" size=".02"/></body>
        </worldbody></mujoco>""",
        name="bar",
    )
    data = mujoco.MjData(character.model)
    data.qpos[:] = -0.9
    played = []
    for _ in range(1000):
        played.append(data.qpos.copy())
        mujoco.mj_step(character.model, data)
    qpos = np.array(played)[first::16]
    clip = Clip(qpos=qpos, time=np.arange(len(qpos)) * 0.016)
    ratio = validate(clip, character).measures["joint_torque_ratio_max"].value
    assert ratio is not None
    assert ratio < 0.2
