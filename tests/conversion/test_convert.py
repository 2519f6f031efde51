from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from physretarget.capture.bvh import read_bvh
from physretarget.clip import Clip, load_clip
from physretarget.conversion import FORMATS, convert, encode
from physretarget.demo import models_folder
from physretarget.errors import InputError, UsageError
from physretarget.kinematics import forward, integrate
from physretarget.mjcf import Character


@pytest.fixture(scope="module")
def lamp() -> Character:
    return Character.load(models_folder() / "lamp.xml")


@pytest.fixture(scope="module")
def clip(lamp: Character) -> Clip:
    time = np.arange(40) / 30.0
    step = 0.3 * np.sin(np.outer(time, 1.0 + np.arange(lamp.tree.nv) % 4))
    start = np.tile(lamp.reference_qpos, (40, 1))
    return Clip(
        qpos=integrate(lamp.tree, start, step),
        time=time,
        joint_names=lamp.joint_names,
        model_name=lamp.name,
        model_sha256=lamp.sha256,
    )


@pytest.fixture
def stored(clip: Clip, tmp_path: Path) -> Path:
    clip.save(tmp_path / "clip.npz")
    return tmp_path / "clip.npz"


@pytest.mark.parametrize("order", ["wxyz", "xyzw"])
@pytest.mark.parametrize("header", [False, True])
def test_csv_and_back_is_exact(stored, clip, lamp, tmp_path, order, header) -> None:
    table = tmp_path / "clip.csv"
    convert(stored, table, character=lamp, to_quat=order, header=header)
    back = load_clip(
        table,
        character=lamp,
        fps=None if header else 30.0,
        quat=None if header else order,
    )
    # Reading makes quaternions unit length, which may cost the last digit.
    np.testing.assert_allclose(back.qpos, clip.qpos, rtol=0, atol=1e-15)
    np.testing.assert_allclose(back.time, clip.time, atol=1e-12)
    first = table.read_text().splitlines()[0]
    assert first.startswith("time_s,root_x") == header


def test_npy_npz_and_back(stored, clip, lamp, tmp_path) -> None:
    convert(stored, tmp_path / "a.npy", character=lamp)
    convert(tmp_path / "a.npy", tmp_path / "b.npz", character=lamp, fps=30, quat="wxyz")
    back = load_clip(tmp_path / "b.npz", character=lamp)
    np.testing.assert_allclose(back.qpos, clip.qpos, rtol=0, atol=1e-15)
    convert(stored, tmp_path / "c.npz")
    assert (tmp_path / "c.npz").read_bytes() == stored.read_bytes()


def test_bvh_puts_every_body_where_the_model_has_it(stored, clip, lamp, tmp_path) -> None:
    convert(stored, tmp_path / "a.bvh", character=lamp)
    read = read_bvh(tmp_path / "a.bvh", unit="cm", up="y")
    pose = forward(lamp.tree, clip.qpos)
    axes = np.eye(3)[:, [2, 0, 1]]  # the file's local axes, which its reader keeps
    assert len(read.names) == lamp.tree.nb - 1
    for index, name in enumerate(read.names):
        body = lamp.model.body(name).id
        np.testing.assert_allclose(read.position[:, index], pose.position[:, body], atol=1e-5)
        np.testing.assert_allclose(
            read.rotation[:, index], pose.rotation[:, body] @ axes.T, atol=1e-5
        )
    assert read.time[1] == pytest.approx(1 / 30)


def test_bvh_hinges_are_one_channel_that_never_flips(tmp_path) -> None:
    """An arm that turns twice round, and one whose axis is askew, beside a tumbling root."""
    arm = Character.from_xml(
        "<mujoco><compiler angle='radian'/><worldbody><body name='root'><freejoint/>"
        "<geom size='.1'/><body name='upper' pos='0 0 .2'><joint name='a' axis='0 -1 0'/>"
        "<geom size='.05'/><body name='lower' pos='.2 0 0'><joint name='b' axis='1 1 0'/>"
        "<geom size='.05'/></body></body></body></worldbody></mujoco>"
    )
    frames = 120
    way = np.linspace(0, 4 * np.pi, frames)
    qpos = np.zeros((frames, arm.tree.nq))
    qpos[:, 3], qpos[:, 4] = np.cos(way / 2), np.sin(way / 2)
    qpos[:, 7], qpos[:, 8] = way, 0.9 * way
    turning = Clip(qpos=qpos, time=np.arange(frames) / 60)
    text = encode(turning, ".bvh", arm).decode()
    assert "CHANNELS 1 Xrotation" in text
    rows = np.loadtxt(text.split("Frame Time:")[1].splitlines()[1:])
    assert rows.shape[1] == 6 + 1 + 3
    np.testing.assert_allclose(np.abs(rows[:, 6]), np.degrees(way), atol=1e-5)
    assert np.abs(np.diff(rows[:, 3:], axis=0)).max() < 90, "no channel flips by 180 degrees"
    (tmp_path / "arm.bvh").write_text(text)
    read = read_bvh(tmp_path / "arm.bvh", unit="cm", up="y")
    pose = forward(arm.tree, qpos)
    for index, name in enumerate(read.names):
        body = arm.model.body(name).id
        np.testing.assert_allclose(read.position[:, index], pose.position[:, body], atol=1e-5)


def test_glb_holds_the_motion(clip, lamp, tmp_path) -> None:
    pygltflib = pytest.importorskip("pygltflib")
    (tmp_path / "a.glb").write_bytes(encode(clip, ".glb", lamp))
    file = pygltflib.GLTF2().load(str(tmp_path / "a.glb"))
    blob = file.binary_blob()

    def array(index: int, width: int) -> np.ndarray:
        accessor = file.accessors[index]
        view = file.bufferViews[accessor.bufferView]
        raw = blob[view.byteOffset : view.byteOffset + view.byteLength]
        return np.frombuffer(raw, dtype="<f4").reshape(accessor.count, width)

    pose = forward(lamp.tree, clip.qpos)
    animation = file.animations[0]
    moved = [c for c in animation.channels if c.target.path == "translation"]
    assert len(moved) == lamp.tree.nb - 1
    for channel in moved:
        sampler = animation.samplers[channel.sampler]
        body = lamp.model.body(file.nodes[channel.target.node].name).id
        np.testing.assert_allclose(array(sampler.input, 1)[:, 0], clip.time, atol=1e-6)
        np.testing.assert_allclose(array(sampler.output, 3), pose.position[:, body], atol=1e-5)
    assert len(file.meshes) >= lamp.tree.nb - 1


@pytest.mark.parametrize("ending", sorted(FORMATS))
def test_same_clip_same_bytes(clip, lamp, ending) -> None:
    if ending == ".glb":
        pytest.importorskip("pygltflib")
    assert encode(clip, ending, lamp) == encode(clip, ending, lamp)


def test_refusals_write_nothing(stored, lamp, tmp_path) -> None:
    before = set(tmp_path.iterdir())
    for target in ("a.fbx", "a"):
        with pytest.raises(UsageError, match=r"no format to write: \.npz"):
            convert(stored, tmp_path / target, character=lamp)
    for target in ("a.bvh", "a.glb"):
        with pytest.raises(UsageError, match="--model"):
            convert(stored, tmp_path / target)
    with pytest.raises(InputError, match=r"no\.npz"):
        convert(tmp_path / "no.npz", tmp_path / "a.csv")
    assert set(tmp_path.iterdir()) == before


def test_csv_has_no_place_for_ball_joints(tmp_path) -> None:
    ball = Character.from_xml(
        "<mujoco><worldbody><body name='a'><freejoint/><geom size='.1'/><body name='b'>"
        "<joint name='j' type='ball'/><geom size='.1'/></body></body></worldbody></mujoco>"
    )
    qpos = np.tile(ball.reference_qpos, (4, 1))
    motion = Clip(qpos=qpos, time=np.arange(4) / 30, joint_names=ball.joint_names)
    with pytest.raises(UsageError, match="csv"):
        encode(motion, ".csv", ball)
