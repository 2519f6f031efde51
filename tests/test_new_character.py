"""Robots' files become characters that stand, with every guess said."""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh

from physretarget.errors import InputError
from physretarget.keyposes import actor_character_of_reference, check, propose
from physretarget.keyposes.pose import KeyPose, KeyPoseSet
from physretarget.keyposes.propose import planted_points
from physretarget.mjcf import Character
from physretarget.mjcf.reference import lowest_and_highest
from physretarget.new_character import make_character

INERTIAL = """<inertial><mass value="{m}"/><origin xyz="0 0 .05"/>
  <inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>"""
LAMP = """<robot name="desk lamp">
<link name="base"><visual><geometry><cylinder radius=".1" length=".04"/></geometry></visual>
  <collision><geometry><cylinder radius=".1" length=".04"/></geometry></collision>{base}</link>
<link name="arm"><visual><origin xyz="0 0 .15"/>
  <geometry><box size=".03 .03 .3"/></geometry></visual>
  <collision><origin xyz="0 0 .15"/>
  <geometry><box size=".03 .03 .3"/></geometry></collision>{arm}</link>
<link name="head"><visual><origin xyz="{hx} {hy} 0"/>
  <geometry><sphere radius=".05"/></geometry></visual>
  <collision><origin xyz="{hx} {hy} 0"/><geometry><sphere radius=".05"/></geometry></collision>
  {head}</link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="arm"/>
  <origin xyz="0 0 .02"/>
  <axis xyz="0 1 0"/><limit lower="-1" upper="1.5" effort="5" velocity="3"/></joint>
<joint name="neck" type="continuous"><parent link="arm"/><child link="head"/><origin xyz="0 0 .3"/>
  <axis xyz="0 1 0"/></joint>
</robot>"""


def lamp(tmp_path: Path, *, x: float = 0.1, y: float = 0.0, base: str | None = None) -> Path:
    path = tmp_path / "lamp.urdf"
    mass = INERTIAL.format(m=1)
    head = INERTIAL.format(m=0.2).replace('xyz="0 0 .05"', f'xyz="{x} {y} 0"')
    path.write_text(LAMP.format(
        base=mass if base is None else base, arm=INERTIAL.format(m=0.3), head=head, hx=x, hy=y
    ))  # fmt: skip
    return path


def test_a_desk_lamp_gets_a_free_root_and_stands_on_its_base(tmp_path: Path) -> None:
    made = make_character(lamp(tmp_path), tmp_path / "out" / "lamp.xml")
    character = Character.load(made.path)
    assert character.has_root
    assert character.model.body(character.root_body).name == "base"
    assert character.mass == pytest.approx(1.5)
    data = mujoco.MjData(character.model)
    mujoco.mj_kinematics(character.model, data)
    low, _ = lowest_and_highest(character.model, data, character.bodies)
    assert low == pytest.approx(character.floor_height, abs=1e-9)
    assert set(character.tied) == {"left_toe", "left_heel", "right_toe", "right_heel"}
    place = character.contacts.local
    sides = {tie: place[k] for k, tie in enumerate(character.tied)}
    assert sides["left_toe"][0] > 0 > sides["left_heel"][0]
    assert sides["left_toe"][1] > 0 > sides["right_toe"][1]


def test_every_guess_is_said(tmp_path: Path) -> None:
    notes = " ".join(make_character(lamp(tmp_path), tmp_path / "lamp.xml").notes)
    for word in ("free root", "neck had no limits", "front", "no floor", "contact points", "face"):
        assert word in notes
    assert "shoulder" not in notes, "its limits were in the file"


def test_limits_of_the_file_stay_and_missing_ones_are_wide(tmp_path: Path) -> None:
    made = make_character(lamp(tmp_path), tmp_path / "lamp.xml")
    model = Character.load(made.path).model
    np.testing.assert_allclose(model.joint("shoulder").range, [-1, 1.5])
    np.testing.assert_allclose(model.joint("neck").range, np.radians([-60, 60]), atol=1e-4)


@pytest.mark.parametrize(
    ("x", "y", "front"), [(0.1, 0.0, [1, 0, 0]), (-0.1, 0, [-1, 0, 0]), (0, 0.1, [0, 1, 0])]
)
def test_the_front_is_where_the_head_is(
    tmp_path: Path, x: float, y: float, front: list[float]
) -> None:
    made = make_character(lamp(tmp_path, x=x, y=y), tmp_path / "lamp.xml")
    character = Character.load(made.path)
    np.testing.assert_allclose(character.front, front, atol=1e-9)
    told = make_character(lamp(tmp_path, x=x, y=y), tmp_path / "lamp.xml", front="-y")
    np.testing.assert_allclose(Character.load(told.path).front, [0, -1, 0], atol=1e-9)


def test_a_base_without_mass_gets_that_of_its_geometry(tmp_path: Path) -> None:
    """Robots' arms often leave it out, since their base is bolted down."""
    made = make_character(lamp(tmp_path, base=""), tmp_path / "lamp.xml")
    character = Character.load(made.path)
    volume = math.pi * 0.1**2 * 0.04
    mass = float(character.model.body("base").mass[0])
    assert mass == pytest.approx(500 * volume, rel=1e-3), "once, not for what is drawn besides"
    assert "base had no mass" in " ".join(made.notes)


def test_a_first_key_pose_of_it_is_sound(tmp_path: Path) -> None:
    character = Character.load(make_character(lamp(tmp_path), tmp_path / "lamp.xml").path)
    actor = np.array(actor_character_of_reference().reference_qpos)
    pose = KeyPose(
        name="stand", source="", sha256="", time=0.0, actor_qpos=actor,
        qpos=propose(character, actor), planted=planted_points(actor),
    )  # fmt: skip
    alone = KeyPoseSet(
        character_name=character.name, character_sha256="", license="", poses=(pose,)
    )
    assert not [r for r in check(alone, character) if r.severity == "error"]


def test_four_legs_are_tied_by_side_and_front(tmp_path: Path) -> None:
    legs = "".join(
        f"<body name='{n}' pos='{x} {y} 0'><joint name='{n}' axis='0 1 0' range='-1 1'/>"
        "<geom type='capsule' fromto='0 0 0 0 0 -.2' size='.02'/></body>"
        for n, x, y in (("a", 0.2, 0.1), ("b", 0.2, -0.1), ("c", -0.2, 0.1), ("d", -0.2, -0.1))
    )
    source = tmp_path / "dog.xml"
    source.write_text(
        "<mujoco><compiler angle='radian' autolimits='true'/><worldbody><body name='trunk'>"
        f"<geom type='box' size='.25 .1 .05'/>{legs}</body></worldbody></mujoco>"
    )
    character = Character.load(make_character(source, tmp_path / "dog-character.xml").path)
    bodies = [character.model.body(b).name for b in character.contacts.body]
    assert dict(zip(bodies, character.tied, strict=True)) == {
        "a": "left_toe", "b": "right_toe", "c": "left_heel", "d": "right_heel",
    }  # fmt: skip


def test_up_is_what_it_is_told_to_be(tmp_path: Path) -> None:
    source = tmp_path / "tall.xml"
    source.write_text(
        "<mujoco><worldbody><body name='foot'><geom type='box' size='.1 .02 .1'/>"
        "<body name='pole'><joint name='j' axis='0 0 1' range='-50 50'/>"
        "<geom type='capsule' fromto='0 .02 0 0 .5 0' size='.02'/></body></body>"
        "</worldbody></mujoco>"
    )
    made = make_character(source, tmp_path / "out.xml", up="+y")
    assert Character.load(made.path).height == pytest.approx(0.54, abs=1e-6)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("<mujoco><worldbody><geom type='box' size='1 1 1'/></worldbody></mujoco>", "no moving"),
        (
            "<mujoco><worldbody><body name='a'><joint/><geom size='.1'/></body></worldbody>"
            "</mujoco>", "hangs in the world",
        ),
        (
            "<mujoco><worldbody><body name='a'><freejoint/><geom size='.1'/></body>"
            "<body name='b'><freejoint/><geom size='.1'/></body></worldbody></mujoco>",
            "side by side",
        ),
    ],
)  # fmt: skip
def test_what_can_be_no_character_is_named(tmp_path: Path, text: str, said: str) -> None:
    source = tmp_path / "x.xml"
    source.write_text(text)
    with pytest.raises(InputError, match=said):
        make_character(source, tmp_path / "out.xml")
    assert not (tmp_path / "out.xml").exists()


def test_meshes_come_along(tmp_path: Path) -> None:
    folder = tmp_path / "robot" / "meshes"
    folder.mkdir(parents=True)
    trimesh.creation.box((0.2, 0.2, 0.1)).export(folder / "base.stl")
    source = tmp_path / "robot" / "r.xml"
    source.write_text(
        "<mujoco><compiler meshdir='meshes'/><asset><mesh name='m' file='base.stl'/></asset>"
        "<worldbody><body name='base'><geom type='mesh' mesh='m'/><body name='arm' pos='0 0 .05'>"
        "<joint name='j' range='-50 50'/><geom type='capsule' fromto='0 0 0 0 0 .2' size='.02'/>"
        "</body></body></worldbody></mujoco>"
    )
    made = make_character(source, tmp_path / "elsewhere" / "c.xml")
    (tmp_path / "robot").rename(tmp_path / "gone")
    assert Character.load(made.path).has_root
    assert str(tmp_path) not in made.path.read_text()
