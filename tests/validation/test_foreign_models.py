"""Models of all kinds, simulated: clean as they are, and exactly what is wrong when altered."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from physretarget.clip import Clip
from physretarget.mjcf import Character
from physretarget.validation import Report, Settings, validate

Array = NDArray[np.float64]
Control = Callable[[float], object]

PLANE = '<geom name="floor" type="plane" size="9 9 .1"/>'


@dataclass(frozen=True)
class Case:
    """A model, its control over time, and how it is recorded; ``start`` changes qpos at first."""

    xml: str
    control: Control = lambda t: 0.0
    fps: float = 50.0
    seconds: float = 1.6
    settle: float = 0.5
    start: dict[int, float] | None = None
    speed: dict[int, float] | None = None


def leg(name: str, x: float, y: float, foot: str) -> str:
    return f"""<body pos="{x} {y} 0"><joint name="{name}_hip" axis="0 1 0" range="-90 90"/>
    <geom type="capsule" fromto="0 0 0 0 0 -.2" size=".02" mass=".4"/><body pos="0 0 -.2">
    <joint name="{name}_knee" axis="0 1 0" range="-150 0"/>
    <geom type="capsule" fromto="0 0 0 0 0 -.15" size=".015" mass=".15"/>{foot}</body></body>"""


def quadruped(foot: str) -> str:
    corners = {"fl": (0.2, 0.12), "fr": (0.2, -0.12), "rl": (-0.2, 0.12), "rr": (-0.2, -0.12)}
    legs = "".join(leg(name, x, y, foot) for name, (x, y) in corners.items())
    motors = "".join(
        f'<position joint="{name}_{joint}" kp="80" kv="2" forcerange="-40 40"/>'
        for name in corners for joint in ("hip", "knee")
    )  # fmt: skip
    return f"""<mujoco model="dog"><option timestep=".002" integrator="implicitfast"/>
    <default><joint damping=".2" armature=".01"/></default><worldbody>{PLANE}
    <body pos="0 0 .36"><freejoint/><geom type="box" size=".25 .08 .05" mass="8"/>{legs}</body>
    </worldbody><actuator>{motors}</actuator></mujoco>"""


def trot(t: float) -> Array:
    phase = 4 * np.pi * t + np.array([0, np.pi, np.pi, 0])
    ramp = min(max(t, 0) / 0.5, 1)
    hip, knee = 0.6 - 0.12 * ramp * np.cos(phase), -1.2 - 0.35 * ramp * np.maximum(0, np.sin(phase))
    return np.stack([hip, knee], axis=1).ravel()


def blocks(ground: str, *, asset: str = "", body: str = "", z: float = 0.1) -> str:
    """A block with a swinging arm on some ground."""
    shape = body or '<geom type="box" size=".15 .1 .1" mass="5"/>'
    return f"""<mujoco><asset>{asset}</asset><option timestep=".001"/><worldbody>{ground}
    <body name="block" pos="0 0 {z}"><freejoint/>{shape}<body pos="0 0 .12">
    <joint name="arm" axis="0 1 0" range="-90 90" armature=".01"/>
    <geom type="capsule" fromto="0 0 0 0 0 .2" size=".02" mass=".3"/></body></body>
    </worldbody><actuator><position joint="arm" kp="30" kv="2"/></actuator></mujoco>"""


def swing(t: float) -> float:
    return 0.5 * np.sin(2 * np.pi * max(t, 0))


def links(count: int) -> str:
    if count == 0:
        return ""
    return f"""<body pos=".16 0 0"><joint type="ball" damping=".2"/>
    <geom type="capsule" fromto="0 0 0 .12 0 0" size=".04" mass=".5"/>{links(count - 1)}</body>"""


SNAKE = f"""<mujoco><worldbody>{PLANE}<body pos="0 0 .04"><freejoint/>
<geom type="capsule" fromto="0 0 0 .12 0 0" size=".04" mass=".5"/>{links(6)}</body></worldbody>
</mujoco>"""
POGO = f"""<mujoco><option timestep=".001" integrator="implicitfast"/><worldbody>{PLANE}
<body pos="0 0 .5"><freejoint/><geom type="cylinder" size=".15 .05" mass="5"/><body>
<joint name="leg" type="slide" axis="0 0 1" range="-.3 .3"/>
<geom type="capsule" fromto="0 0 -.1 0 0 -.35" size=".02" mass=".3"/>
<geom type="cylinder" size=".12 .01" pos="0 0 -.39" mass=".3"/></body></body></worldbody>
<actuator><position joint="leg" kp="3000" kv="60"/></actuator></mujoco>"""


def hops(t: float) -> float:
    phase = max(t, 0) % 0.8
    return 0.1 if phase < 0.4 else (0.1 - 3.5 * (phase - 0.4) if phase < 0.48 else -0.0)


ANGLES = np.linspace(0, 2 * np.pi, 24, endpoint=False)
SOLE = " ".join(
    f"{0.15 * np.cos(a) * s:.4f} {0.1 * np.sin(a) * s:.4f} {z}"
    for z, s in ((-0.1, 0.9), (0.1, 1.0)) for a in ANGLES
)  # fmt: skip
FLAT = '<hfield name="h" nrow="3" ncol="3" size="5 5 .5 .1" elevation="0 0 0 0 0 0 0 0 0"/>'

CASES = {
    "round feet": Case(quadruped('<geom size=".025" pos="0 0 -.19" mass=".05"/>'), trot, fps=60),
    "capsule feet": Case(
        quadruped('<geom type="capsule" size=".02" fromto="0 -.02 -.19 0 .02 -.19" mass=".05"/>'),
        trot, fps=40,
    ),
    "snake": Case(SNAKE),
    "pogo stick": Case(POGO, hops, fps=100, settle=0.6, seconds=2.0),
    "mesh": Case(
        blocks(
            PLANE, asset=f'<mesh name="m" vertex="{SOLE}"/>',
            body='<geom type="mesh" mesh="m" mass="5"/>',
        ),
        swing, fps=120,
    ),
    "floor at z = -0.35": Case(
        blocks(PLANE.replace("/>", ' pos="0 0 -.35"/>'), z=-0.25), swing, fps=30
    ),
    "box for a floor": Case(
        blocks('<geom name="slab" type="box" size="5 5 .1" pos="0 0 .1"/>', z=0.3), swing
    ),
    "flat height field": Case(
        blocks('<geom name="field" type="hfield" hfield="h"/>', asset=FLAT), swing
    ),
    "nested frames": Case(
        blocks(PLANE).replace('<body name="block"', '<frame pos="1 2 0" euler="0 0 70"><body')
        .replace("</body></body>", "</body></body></frame>"),
        swing,
    ),
    "tumbling box": Case(
        blocks(PLANE, z=0.5), settle=0, start={3: 0.9, 4: 0.3, 5: 0.2, 6: 0.1}, seconds=1.2
    ),
}  # fmt: skip


@cache
def simulated(name: str) -> tuple[Character, Clip]:
    return recorded(CASES[name])


def recorded(case: Case) -> tuple[Character, Clip]:
    character = Character.from_xml(case.xml, name="model")
    model = copy.copy(character.model)
    # A whole number of steps to a frame: sampling at the nearest one would be jitter.
    model.opt.timestep = 1 / case.fps / round(1 / case.fps / model.opt.timestep)
    data = mujoco.MjData(model)
    data.qpos[:] = character.reference_qpos
    for column, value in (case.start or {}).items():
        data.qpos[column] = value
    data.qpos[3:7] /= np.linalg.norm(data.qpos[3:7])
    for dof, value in (case.speed or {}).items():
        data.qvel[dof] = value
    every = round(1 / case.fps / model.opt.timestep)
    qpos = []
    for step in range(
        -round(case.settle * case.fps) * every, round(case.seconds * case.fps) * every
    ):
        if step >= 0 and step % every == 0:
            qpos.append(data.qpos.copy())
        data.ctrl[:] = case.control(step * model.opt.timestep)
        mujoco.mj_step(model, data)
    clip = Clip(
        qpos=np.array(qpos), time=np.arange(len(qpos)) / case.fps,
        joint_names=character.joint_names, model_sha256=character.sha256,
    )  # fmt: skip
    return character, clip


def moved(clip: Clip, column: int, by: Array | float) -> Clip:
    qpos = clip.qpos.copy()
    qpos[:, column] += by
    return replace(clip, qpos=qpos)


def errors(report: Report) -> set[str]:
    causes = {cause.code for cause in report.causes}
    return {f.code for f in report.findings if f.severity == "error"} - causes


def no_model(report: Report) -> set[str]:
    return {f.code for f in report.findings if not f.code.startswith("MDL")}


@pytest.mark.parametrize("hz", [None, 6.0])
@pytest.mark.parametrize("name", CASES)
def test_as_simulated_it_is_clean(name: str, hz: float | None) -> None:
    character, clip = simulated(name)
    for profile in ("animation", "robot"):
        settings = Settings(lowpass_hz=hz, profile=profile)
        report = validate(clip, character, settings=settings)
        assert errors(report) == set(), [f.message for f in report.findings]


@pytest.mark.parametrize("hz", [None, 6.0])
@pytest.mark.parametrize("name", CASES)
def test_lifted_it_floats(name: str, hz: float | None) -> None:
    character, clip = simulated(name)
    report = validate(moved(clip, 2, 0.03), character, settings=Settings(lowpass_hz=hz))
    # While it tumbles, a corner within the tolerance is asked for what the whole box needs.
    found = errors(report) - ({"DYN002"} if name == "tumbling box" else set())
    assert found == {"CON003"}


@pytest.mark.parametrize("hz", [None, 6.0])
@pytest.mark.parametrize("name", CASES)
def test_slid_it_skates(name: str, hz: float | None) -> None:
    character, clip = simulated(name)
    report = validate(moved(clip, 0, 0.2 * clip.time), character, settings=Settings(lowpass_hz=hz))
    if name == "round feet" and hz is not None:
        # A trot at 6 Hz: some foot is always landing or lifting, and may bear what is filtered.
        assert errors(report) <= {"CON002"}
    else:
        assert errors(report) == {"CON002"}


def test_played_faster_a_hop_falls_too_fast() -> None:
    character, clip = simulated("pogo stick")
    report = validate(replace(clip, time=clip.time / 1.5), character)
    assert errors(report) == {"DYN001", "DYN003", "DYN006"}


def test_upside_down_a_hop_sinks_and_falls_upward() -> None:
    character, clip = simulated("pogo stick")
    report = validate(moved(clip, 2, 2 * (clip.qpos[0, 2] - clip.qpos[:, 2])), character)
    assert errors(report) == {"CON001", "DYN001", "DYN003", "DYN006"}


def test_with_a_leg_flipped_a_trot_is_carried_by_nothing() -> None:
    character, clip = simulated("round feet")
    column = character.tree.joints[1].qpos
    report = validate(moved(clip, column, -2 * clip.qpos[:, column]), character)
    assert {"DYN002"} <= errors(report) <= {"DYN001", "DYN002", "CON001", "CON002"}


@pytest.mark.parametrize("hz", [None, 6.0])
def test_a_clip_that_is_cut_in_mid_air_stays_in_free_fall(hz: float | None) -> None:
    character, clip = simulated("tumbling box")
    time = np.arange(30) / 60
    qpos = np.repeat(clip.qpos[:1], 30, axis=0)
    qpos[:, 2] = 3 + 1.0 * time - 9.81 / 2 * time**2
    report = validate(Clip(qpos=qpos, time=time), character, settings=Settings(lowpass_hz=hz))
    assert no_model(report) == set()
    for name in ("min", "max"):
        force = report.measures[f"required_force_vertical_{name}_bw"].value
        assert force == pytest.approx(0, abs=1e-3)


def test_what_stands_on_furniture_is_not_judged_by_its_forces() -> None:
    crate = PLANE + '<geom name="crate" type="box" size=".4 .4 .1" pos="0 0 .1"/>'
    character = Character.from_xml(blocks(crate, z=0.3), name="block")
    clip = Clip(qpos=np.tile(character.reference_qpos, (30, 1)), time=np.arange(30) / 30)
    report = validate(clip, character)
    uncovered = {c.code: c.reason for c in report.coverage if c.status == "not-covered"}
    assert {"CON003", "DYN001", "DYN002", "DYN006"} <= set(uncovered)
    assert "'crate'" in uncovered["DYN001"]
    assert any("'crate'" in note and "30 of 30" in note for note in report.clip.notes)
    assert report.verdict == "not judged"
    assert errors(validate(moved(clip, 2, 0.03), character)) == {"CON003"}


def test_a_slope_is_no_floor() -> None:
    character = Character.from_xml(blocks(PLANE.replace("/>", ' euler="0 8 0"/>')), name="block")
    assert any("tilted by 8 degrees" in note for note in character.notes)
    clip = Clip(qpos=np.tile(character.reference_qpos, (30, 1)), time=np.arange(30) / 30)
    report = validate(moved(clip, 2, -0.05), character)
    uncovered = {c.code: c.reason for c in report.coverage if c.status == "not-covered"}
    assert "no level plane" in uncovered["CON001"]
    assert no_model(report) == set()


def test_friction_is_mixed_as_in_a_simulation() -> None:
    rough = blocks(PLANE.replace("/>", ' friction=".3"/>')).replace(
        'size=".15 .1 .1"', 'size=".15 .1 .1" friction=".9"'
    )
    character = Character.from_xml(rough, name="block")
    assert (character.friction, character.foot_friction) == (0.3, 0.9)
    first = Character.from_xml(rough.replace('type="plane"', 'type="plane" priority="1"'), name="b")
    assert first.foot_friction == 0.3


def test_a_landing_may_sink_into_a_soft_floor_and_a_foot_that_dips_may_not() -> None:
    character = Character.from_xml(blocks(PLANE, z=0.1), name="block")
    time = np.arange(60) / 60
    qpos = np.tile(character.reference_qpos, (60, 1))
    qpos[:, 2] -= 0.03 * np.sin(np.pi * time) ** 2
    report = validate(Clip(qpos=qpos, time=time), character)
    assert "CON001" in errors(report)


LIMB = """<body pos="0 {y} -.1"><joint axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 0 0 -.3" size=".05" mass="4"/></body>"""
FALLING = f"""<mujoco><option timestep=".002"/><default>
<joint damping="1" armature=".01" range="-100 100"/></default><worldbody>{PLANE}
<body pos="0 0 .5"><freejoint/><geom type="capsule" fromto="0 -.1 0 0 .1 0" size=".08" mass="10"/>
<body pos="0 0 .1"><joint axis="0 1 0"/>
<geom type="sphere" size=".09" pos="0 0 .1" mass="4"/></body>
{LIMB.format(y=0.07)}{LIMB.format(y=-0.07)}</body></worldbody></mujoco>"""


@pytest.mark.parametrize("fps", [120, 240])
def test_a_body_that_falls_forward_may_skid_where_it_lands(fps: float) -> None:
    """Trunk and head land at 3 m/s while a leg rests on the floor: they bear the blow, not it."""
    case = Case(FALLING, fps=fps, settle=0, seconds=1.0, speed={0: 3.0, 1: 0.2, 3: 0.3, 4: 3.0})
    character, clip = recorded(case)
    assert not errors(validate(clip, character))


@pytest.mark.parametrize("name", ["pogo stick", "round feet"])
def test_every_step_of_a_simulation_is_no_trembling(name: str) -> None:
    """At 1000 frames/s the blow of a foot lasts several frames, and was taken for jitter."""
    character, clip = recorded(
        replace(CASES[name], fps=1000, xml=CASES[name].xml.replace('".002"', '".001"'))
    )
    assert not errors(validate(clip, character))


CUBE = f"""<mujoco><option timestep=".001"/><worldbody>{PLANE}<body pos="0 0 .7"><freejoint/>
<geom type="box" size=".2 .2 .2" mass="5"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize("speed", [{3: 0.3, 4: 0.2}, {0: 1.5, 1: 0.3, 3: 2.0, 4: 4.0, 5: 1.0}])
def test_a_box_that_lands_on_one_corner_after_another_is_explained(speed: dict[int, float]) -> None:
    """A filter spreads the blows of all corners over frames in which at most one touches."""
    character, clip = recorded(Case(CUBE, fps=120, settle=0, seconds=2.0, speed=speed))
    assert not errors(validate(clip, character, settings=Settings(lowpass_hz=6)))
