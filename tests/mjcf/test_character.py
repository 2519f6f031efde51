from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from physretarget.errors import InputError, UnsafeInputError
from physretarget.kinematics import forward, integrate
from physretarget.mjcf import Character


def test_tree_is_the_twin_of_mj_kinematics(
    any_character: Character, rng: np.random.Generator
) -> None:
    model, data = any_character.model, mujoco.MjData(any_character.model)
    start = np.repeat(any_character.reference_qpos[None], 20, axis=0)
    qpos = integrate(any_character.tree, start, rng.normal(size=(20, model.nv)))
    assert any_character.tree.nq == model.nq
    pose = forward(any_character.tree, qpos)
    for t in range(20):
        data.qpos[:] = qpos[t]
        mujoco.mj_kinematics(model, data)
        np.testing.assert_allclose(pose.position[t], data.xpos, atol=1e-12)
        np.testing.assert_allclose(pose.rotation[t].reshape(-1, 9), data.xmat, atol=1e-12)


def test_annotations_are_read(hopper: Character) -> None:
    assert hopper.name == "hopper"
    assert hopper.has_root
    assert hopper.has_floor
    assert hopper.friction == 0.7
    np.testing.assert_allclose(hopper.front, [1, 0, 0])
    np.testing.assert_allclose(hopper.up, [0, 0, 1])
    assert hopper.contacts.names == ("contact_left", "contact_right", "contact_back")
    assert hopper.tied == ("left_toe", "right_toe", None)
    assert hopper.mass == pytest.approx(2.7)
    assert hopper.joint_names == ("root", "hip", "neck", "slide", "twist")
    np.testing.assert_allclose(hopper.upper[[7, 8]], [np.deg2rad(100), np.inf])
    assert np.isneginf(hopper.lower[:7]).all()
    # The box on top reaches 0.06 above the neck, the floor is at the cylinder's bottom.
    assert hopper.height == pytest.approx(0.03 + 0.03 + 0.25 + 0.06, abs=0.02)
    assert 0.03 < hopper.com_height < hopper.height
    assert not hopper.notes


def test_generated_markers_fix_every_moving_body(any_character: Character) -> None:
    model, markers = any_character.model, any_character.markers
    moving = [b for b in any_character.bodies if model.body_jntnum[b]]
    assert sorted(set(markers.body.tolist())) == sorted(moving)
    for body in moving:
        a, b, c = markers.local[markers.body == body]
        area = 0.5 * np.linalg.norm(np.cross(b - a, c - a))
        assert area > 0.5 * (0.03 * any_character.height) ** 2


def test_a_fixed_base_and_a_prop(fixed_arm: Character) -> None:
    assert fixed_arm.name == "arm"
    assert not fixed_arm.has_root
    assert not fixed_arm.has_floor
    assert fixed_arm.floor_height == 0.0
    assert fixed_arm.mass == pytest.approx(5.0)
    assert fixed_arm.joint_names[0] == "joint0"
    assert any("prop" in note for note in fixed_arm.notes)
    assert any("no free joint" in note for note in fixed_arm.notes)
    assert any("no floor" in note for note in fixed_arm.notes)


def test_the_tree_with_most_joints_is_the_character(two_trees: Character) -> None:
    model = two_trees.model
    assert model.body(two_trees.root_body).name == "torso"
    assert two_trees.root_qpos == 7
    assert two_trees.root_dof == 6
    assert two_trees.reference_qpos[9] == 2.0  # the keyframe "stand"
    assert len(two_trees.bodies) == 4


def test_the_shared_model_is_not_touched(hopper: Character) -> None:
    assert hopper.unconstrained.opt.disableflags != hopper.model.opt.disableflags
    assert hopper.model.opt.disableflags == 0
    assert hopper.unconstrained is hopper.unconstrained


def test_robot(data: Path) -> None:
    robot = Character.load(data / "robot" / "g1_no_mesh_box_feet.xml", untrusted=True)
    assert robot.model.nq == 36
    assert robot.has_root
    assert 1.2 < robot.height < 1.4
    assert 0.6 < robot.com_height < 0.8
    assert 30 < robot.mass < 40
    assert len(robot.contacts) == 0
    assert len(robot.markers) == 3 * 30
    assert robot.sha256 == Character.load(data / "robot" / "g1_no_mesh_box_feet.xml").sha256


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("<mujoco>\n<worldbody>\n<body></worldbody></mujoco>", 3, "XML"),
        ("<mujoco>\n<worldbody>\n<body>\n<geom typ='3'/></body></worldbody></mujoco>", 4, "'typ'"),
        ("<mujoco><worldbody>\n<body><joint/></body></worldbody></mujoco>", 2, "mass"),
        ("<robot/>", None, "no joint"),
        ("<mujoko/>", None, "MuJoCo cannot build"),
        ("<mujoco/>", None, "no joint"),
        (
            "<mujoco><asset>\n<mesh name='a' file='b/c.stl'/></asset></mujoco>",
            2,
            "mesh 'a' names the file 'b/c.stl', which does not exist",
        ),
        ("<mujoco>\n\n<include file='x.xml'/></mujoco>", 3, "include names the file 'x.xml'"),
        (
            "<mujoco><custom><numeric name='front' data='0 0 0'/></custom><worldbody><body>"
            "<freejoint/><geom size='1'/></body></worldbody></mujoco>",
            None,
            "'front' is no direction",
        ),
        (
            "<mujoco><custom><text name='contact_a' data='nose'/></custom><worldbody><body>"
            "<freejoint/><geom size='1'/><site name='contact_a'/></body></worldbody></mujoco>",
            None,
            "left_toe",
        ),
    ],
)
def test_broken_models_say_where(tmp_path: Path, text: str, line: int | None, words: str) -> None:
    path = tmp_path / "model.xml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        Character.load(path)
    assert words in str(caught.value)
    assert caught.value.line == line
    assert str(path) in str(caught.value)
    with pytest.raises(InputError):
        Character.from_xml(text)


def test_unreadable_files(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        Character.load(tmp_path / "none.xml")
    (tmp_path / "empty.xml").write_text(" \n")
    with pytest.raises(InputError, match="empty"):
        Character.load(tmp_path / "empty.xml")
    (tmp_path / "binary.xml").write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(InputError, match="not a text file"):
        Character.load(tmp_path / "binary.xml")
    with pytest.raises(InputError):
        Character.load(tmp_path)


BODY = "<worldbody><body><freejoint/><geom size='1'/></body></worldbody>"


@pytest.mark.parametrize(
    "text",
    [
        f"<!DOCTYPE a><mujoco>{BODY}</mujoco>",
        f"<!DOCTYPE a [<!ENTITY b 'c'>]><mujoco model='&b;'>{BODY}</mujoco>",
        f"<mujoco>{BODY}<asset><mesh file='../m.stl'/></asset></mujoco>",
        f"<mujoco>{BODY}<asset><mesh file='/etc/passwd'/></asset></mujoco>",
        f"<mujoco><compiler meshdir='/etc'/>{BODY}<asset><mesh file='passwd'/></asset></mujoco>",
        f"<mujoco>{BODY}<asset><texture file='http://a/b.png'/></asset></mujoco>",
        f"<mujoco>{BODY}<asset><texture type='cube' fileright='../b.png'/></asset></mujoco>",
        f"<mujoco>{BODY}<asset><hfield file='link/h.png'/></asset></mujoco>",
        f"<mujoco>{BODY}<include file='../b.xml'/></mujoco>",
        f"<mujoco>{BODY}<extension><plugin plugin='a'/></extension></mujoco>",
        f"<mujoco>{BODY}<size memory='1000G'/></mujoco>",
        f"<mujoco>{BODY}<size nuserdata='100000000'/></mujoco>",
        f"<mujoco>{BODY}<asset><texture builtin='flat' width='99999' height='9'/></asset></mujoco>",
        f"<mujoco>{BODY}<custom><numeric name='a' size='1000000000'/></custom></mujoco>",
        "<mujoco><worldbody><replicate count='9999'><body/></replicate></worldbody></mujoco>",
        f"<mujoco>{'<body>' * 500}</mujoco>",
    ],
)
def test_untrusted_models_are_refused(tmp_path: Path, text: str) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    (tmp_path / "h.png").write_bytes(b"")
    (folder / "link").symlink_to(tmp_path)
    (folder / "model.xml").write_text(text)
    with pytest.raises(UnsafeInputError):
        Character.load(folder / "model.xml", untrusted=True)


def test_replicas_are_counted_and_admitted(tmp_path: Path) -> None:
    path = tmp_path / "model.xml"
    path.write_text(
        f"<mujoco>{BODY}<worldbody><replicate count='9'><site/></replicate></worldbody></mujoco>"
    )
    assert Character.load(path, untrusted=True).model.nsite == 9


def test_what_is_no_model_is_an_input_error(tmp_path: Path) -> None:
    path = tmp_path / "model.xml"
    path.write_text("<robot name='a'/>")
    for file in (path, tmp_path / "missing.xml", tmp_path):
        with pytest.raises(InputError):
            Character.load(file, untrusted=True)


def test_a_huge_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "huge.xml"
    with path.open("wb") as file:
        file.truncate(2**31)
    with pytest.raises(UnsafeInputError, match="bytes"):
        Character.load(path)


def test_includes_and_assets_enter_the_hash(tmp_path: Path) -> None:
    (tmp_path / "assets").mkdir()
    mesh = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
    (tmp_path / "assets" / "m.obj").write_text(mesh)
    (tmp_path / "part.xml").write_text(
        "<mujoco><asset><mesh name='m' file='m.obj'/></asset></mujoco>"
    )
    (tmp_path / "model.xml").write_text(
        "<mujoco><compiler meshdir='assets'/><include file='part.xml'/><worldbody><body>"
        "<freejoint/><geom type='mesh' mesh='m'/></body></worldbody></mujoco>"
    )
    first = Character.load(tmp_path / "model.xml", untrusted=True)
    assert first.model.nmesh == 1
    assert first.height == pytest.approx(1.0, abs=0.01)
    (tmp_path / "assets" / "m.obj").write_text(mesh.replace("v 1 0 0", "v 2 0 0"))
    second = Character.load(tmp_path / "model.xml", untrusted=True)
    assert first.sha256 != second.sha256
    assert second.mass == pytest.approx(2 * first.mass)


def test_comments_that_only_mujoco_reads_are_noted(tmp_path: Path) -> None:
    path = tmp_path / "model.xml"
    path.write_text(f"<mujoco>\n<!-- a -- b -->{BODY}</mujoco>")
    assert any("line 2" in note for note in Character.load(path).notes)
    with pytest.raises(InputError):
        Character.load(path, untrusted=True)


def test_includes_beside_the_including_file(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    (tmp_path / "model.xml").write_text(f"<mujoco><include file='sub/a.xml'/>{BODY}</mujoco>")
    (tmp_path / "sub" / "a.xml").write_text("<mujoco><include file='b.xml'/></mujoco>")
    (tmp_path / "sub" / "b.xml").write_text("<mujoco><option timestep='0.125'/></mujoco>")
    assert Character.load(tmp_path / "model.xml", untrusted=True).model.opt.timestep == 0.125
    first = Character.load(tmp_path / "model.xml").sha256
    (tmp_path / "sub" / "b.xml").write_text("<mujoco><option timestep='0.25'/></mujoco>")
    assert Character.load(tmp_path / "model.xml").sha256 != first


def test_a_file_that_includes_itself_ends(tmp_path: Path) -> None:
    path = tmp_path / "model.xml"
    path.write_text(f"<mujoco><include file='model.xml'/>{BODY}</mujoco>")
    with pytest.raises(UnsafeInputError, match="included"):
        Character.load(path, untrusted=True)


NUMBERS = st.one_of(
    st.integers(-5, 5), st.floats(width=32), st.sampled_from(["1e300", "nan", "x", "", "1 2 3"])
)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    tag=st.sampled_from(["geom", "joint", "inertial", "site", "body", "freejoint", "numeric"]),
    attributes=st.dictionaries(
        st.sampled_from(["pos", "size", "mass", "range", "axis", "type", "quat", "data", "name"]),
        NUMBERS,
        max_size=4,
    ),
    cut=st.integers(0, 400),
)
def test_garbage_is_an_input_error(
    tmp_path_factory: pytest.TempPathFactory, tag: str, attributes: dict[str, object], cut: int
) -> None:
    inner = " ".join(f'{key}="{value}"' for key, value in attributes.items())
    text = f"<mujoco><worldbody><body><freejoint/><geom size='1'/><{tag} {inner}/></body>"
    path = tmp_path_factory.getbasetemp() / "garbage.xml"
    path.write_text((text + "</worldbody></mujoco>")[: cut if cut < 150 else None])
    try:
        character = Character.load(path, untrusted=True)
    except InputError:
        return  # said so; any other error fails the test
    assert np.isfinite(character.reference_qpos).all()
