"""Roots in pieces and fixed bases, set free: the same bodies in the same places."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from physretarget.errors import InputError
from physretarget.kinematics import forward
from physretarget.mjcf import Character
from physretarget.mjcf.free_root import floating_body, free_root

Array = NDArray[np.float64]

SLIDES = "".join(
    f'<joint name="t{a}" type="slide" axis="{v}"/>'
    for a, v in (("x", "1 0 0"), ("y", "0 1 0"), ("z", "0 0 1"))
)
HINGES = "".join(
    f'<joint name="r{a}" axis="{v}"/>' for a, v in (("x", "1 0 0"), ("y", "0 1 0"), ("z", "0 0 1"))
)
TRUNK = """<geom type="box" size=".1 .15 .2" mass="10"/>
<body name="leg" pos="0 0 -.2"><joint name="hip" axis="0 1 0" range="-1 1"/>
<geom type="capsule" fromto="0 0 0 0 0 -.3" size=".05" mass="3"/></body>
<body name="arm" pos="0 .2 .1"><joint name="shoulder" type="ball"/>
<geom type="capsule" fromto="0 0 0 0 .3 0" size=".04" mass="2"/></body>"""
EXTRA = """<actuator><motor joint="tx"/><motor joint="hip"/></actuator>
<keyframe><key name="home" qpos="0 0 0 {turn} .2 1 0 0 0"/></keyframe>"""


def world(inside: str, turn: str, floor: str = '<geom type="plane" size="3 3 .1"/>') -> Character:
    text = f"""<mujoco><worldbody>{floor}{inside}</worldbody>{EXTRA.format(turn=turn)}</mujoco>"""
    return Character.from_xml(text, name="pieces")


def one_body() -> Character:
    return world(f'<body name="trunk" pos="0 0 .6">{SLIDES}{HINGES}{TRUNK}</body>', "0 0 0")


def ball() -> Character:
    inside = f'<body name="trunk" pos="0 0 .6">{SLIDES}<joint name="turn" type="ball"/>{TRUNK}'
    return world(inside + "</body>", "1 0 0 0")


PIECES = {"one body": one_body, "ball": ball}


def poses(character: Character, frames: int = 20) -> Array:
    generator = np.random.default_rng(0)
    qpos = np.tile(character.reference_qpos, (frames, 1))
    qpos += 0.3 * generator.normal(size=qpos.shape)
    for quat in character.tree.quats[0]:
        qpos[:, quat] /= np.linalg.norm(qpos[:, quat], axis=1, keepdims=True)
    return qpos


@pytest.mark.parametrize("kind", PIECES)
def test_a_root_in_pieces_is_free(kind: str) -> None:
    character = PIECES[kind]()
    assert not character.has_root
    freed = free_root(character, stands=False)
    assert freed is not None
    made = freed.character
    assert made.has_root
    assert made.root_qpos == 0
    assert made.mass == pytest.approx(character.mass)
    assert made.com_height == pytest.approx(character.com_height)
    assert (made.name, made.sha256) == (character.name, character.sha256)
    qpos = poses(character)
    before = forward(character.tree, qpos)
    after = forward(made.tree, freed.lift(qpos))
    for name in ("trunk", "leg", "arm"):
        mine, its = character.model.body(name).id, made.model.body(name).id
        np.testing.assert_allclose(
            after.position[:, its], before.position[:, mine], atol=1e-12, err_msg=name
        )
        np.testing.assert_allclose(after.rotation[:, its], before.rotation[:, mine], atol=1e-12)


def test_a_root_on_bodies_without_mass_is_free() -> None:
    light = '<inertial pos="0 0 0" mass=".001" diaginertia="1e-6 1e-6 1e-6"/>'
    inside = f'<body pos="0 0 .6">{light}{SLIDES}<body>{HINGES}{TRUNK}</body></body>'
    character = world(inside, "0 0 0")
    freed = free_root(character, stands=False)
    assert freed is not None
    qpos = poses(character)
    before, after = forward(character.tree, qpos), forward(freed.character.tree, freed.lift(qpos))
    mine, its = character.model.body("leg").id, freed.character.model.body("leg").id
    np.testing.assert_allclose(after.position[:, its], before.position[:, mine], atol=1e-12)


@pytest.mark.parametrize(
    "joints",
    [
        "".join(SLIDES.split("/>")[i] + "/>" for i in (0, 2)) + '<joint name="r" axis="0 1 0"/>',
        SLIDES + HINGES.replace("0 0 1", "0 1 0").replace("1 0 0", "0 1 0"),  # about one axis
    ],
)
def test_what_cannot_move_anywhere_is_held_by_the_world(joints: str) -> None:
    text = f"""<mujoco><worldbody><body name="trunk" pos="0 0 .6">{joints}{TRUNK}</body>
    </worldbody></mujoco>"""
    character = Character.from_xml(text, name="planar")
    assert floating_body(character) is None
    assert free_root(character, stands=False) is None


ARM = """<body name="turret" pos="0 0 .1"><joint name="j0" axis="0 0 1"/>
<geom type="capsule" fromto="0 0 0 0 0 .3" size=".03" mass=".5"/>
<body name="boom" pos="0 0 .3"><joint name="j1" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 .4 0 0" size=".02" mass=".4"/></body></body>"""
BASE = '<geom name="foot" type="cylinder" pos="0 0 .05" size=".1 .05" mass="2"/>'
FLOORS = {
    "plane": '<geom type="plane" size="3 3 .1"/>',
    "slab": '<geom type="box" pos="0 0 -.1" size="4 4 .1"/>',
}
BASES = {
    "geom of the world": BASE + ARM,
    "body beside it": f'<body name="base">{BASE}</body>{ARM}',
    "body above it": f'<body name="base">{BASE}{ARM}</body>',
}


@pytest.mark.parametrize("floor", FLOORS)
@pytest.mark.parametrize("base", BASES)
def test_a_fixed_base_that_only_stands_is_set_free(floor: str, base: str) -> None:
    text = f"<mujoco><worldbody>{FLOORS[floor]}{BASES[base]}</worldbody></mujoco>"
    character = Character.from_xml(text, name="arm")
    assert free_root(character, stands=False) is None
    freed = free_root(character, stands=True)
    assert freed is not None
    made = freed.character
    assert made.mass == pytest.approx(2.9)
    assert made.floor_height == pytest.approx(0)
    qpos = poses(character)
    lifted = freed.lift(qpos)
    data = mujoco.MjData(made.model)
    data.qpos[:] = lifted[3]
    mujoco.mj_kinematics(made.model, data)
    mine = forward(character.tree, qpos).position[3, character.model.body("boom").id]
    np.testing.assert_allclose(data.body("boom").xpos, mine, atol=1e-12)
    assert data.geom("foot").xpos[2] == pytest.approx(0.05)


def test_an_arm_without_a_base_is_refused() -> None:
    text = f"<mujoco><worldbody>{FLOORS['plane']}{ARM}</worldbody></mujoco>"
    bare = Character.from_xml(text, name="arm")
    with pytest.raises(InputError, match="no base"):
        free_root(bare, stands=True)
