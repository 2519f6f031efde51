"""Clips as the datasets and simulators of robots keep them."""

from __future__ import annotations

import io
import json
import pickle
import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physretarget.clip import load_clip
from physretarget.errors import InputError, UnsafeInputError
from physretarget.mjcf import Character

ARM = """<mujoco model="arm"><worldbody>{root}<geom size="0.1"/>
<body><joint name="yaw" axis="0 0 1"/><geom size="0.1"/>
<body pos="0 0 0.2"><joint name="pitch" axis="0 1 0"/><geom size="0.1"/></body></body>
{end}</worldbody></mujoco>"""
RNG = np.random.default_rng(3)
FRAMES = 12
JOINTS = np.cumsum(RNG.normal(0, 0.05, (FRAMES, 2)), axis=0)
PLACE = np.cumsum(RNG.normal(0, 0.01, (FRAMES, 3)), axis=0) + np.array([0, 0, 0.5])
TURN = Rotation.from_euler("xyz", np.cumsum(RNG.normal(0, 0.05, (FRAMES, 3)), axis=0))
WXYZ, XYZW = TURN.as_quat(scalar_first=True), TURN.as_quat()
QPOS = np.concatenate([PLACE, WXYZ, JOINTS], axis=1)


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> tuple[Character, Character]:
    """An arm that may go anywhere, and one whose base is fixed."""
    folder = tmp_path_factory.mktemp("models")
    free, fixed = folder / "free.xml", folder / "fixed.xml"
    free.write_text(ARM.format(root='<body><freejoint name="root"/>', end="</body>"))
    fixed.write_text(ARM.format(root="<body>", end="</body>"))
    return Character.load(free), Character.load(fixed)


def _same(found: np.ndarray, wanted: np.ndarray = QPOS) -> None:
    signs = np.ones_like(found)
    if found.shape[1] > 7:
        signs[:, 3:7] = np.sign(np.sum(found[:, 3:7] * wanted[:, 3:7], axis=1))[:, None]
    np.testing.assert_allclose(found * signs, wanted, atol=2e-6)


def test_isaac_lab(tmp_path: Path, models: tuple[Character, Character]) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, joint_names=["pitch", "yaw"], joint_pos=JOINTS[:, ::-1], base_pos_w=PLACE,
             base_quat_w=WXYZ, fps=50.0)  # fmt: skip
    _same(load_clip(path, character=models[0]).qpos)
    fixed = load_clip(path, character=models[1])
    _same(fixed.qpos, JOINTS)
    assert any("fixed base" in note and "left out" in note for note in fixed.notes)


def test_bones_seed(tmp_path: Path, models: tuple[Character, Character]) -> None:
    names = [f"root_{kind}{axis}" for kind in ("translate", "rotate") for axis in "XYZ"]
    angles = TURN.as_euler("xyz", degrees=True)
    count = np.arange(FRAMES)[:, None]
    table = np.concatenate([count, 100 * PLACE, angles, np.degrees(JOINTS)], axis=1)
    path = tmp_path / "a.csv"
    header = ",".join(["Frame", *names, "yaw_dof", "pitch_dof"])
    np.savetxt(path, table, delimiter=",", header=header, comments="")
    _same(load_clip(path, character=models[0], fps=120).qpos)


@pytest.mark.parametrize("prefix", ["", "observation.state.", "action."])
def test_lerobot_csv(tmp_path: Path, models: tuple[Character, Character], prefix: str) -> None:
    path = tmp_path / "a.csv"
    table = np.c_[np.arange(FRAMES) / 50, np.degrees(JOINTS[:, ::-1])]
    header = f"timestamp,{prefix}pitch.pos,{prefix}yaw.pos"
    np.savetxt(path, table, delimiter=",", header=header, comments="")
    clip = load_clip(path, character=models[1])
    _same(clip.qpos, JOINTS)
    assert clip.time[1] == pytest.approx(0.02)


@pytest.mark.parametrize("vector", [False, True])
def test_lerobot_parquet(tmp_path: Path, models: tuple[Character, Character], vector: bool) -> None:
    arrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    angles = np.degrees(JOINTS[:, ::-1])
    columns = {"timestamp": np.arange(FRAMES) / 50, "episode_index": [0] * 8 + [1] * (FRAMES - 8)}
    if vector:
        columns["observation.state"] = angles.tolist()
        (tmp_path / "meta").mkdir()
        feature = {"names": ["pitch.pos", "yaw.pos"]}
        info = {"fps": 50, "features": {"observation.state": feature}}
        (tmp_path / "meta" / "info.json").write_text(json.dumps(info))
    else:
        columns |= {"pitch.pos": angles[:, 0], "yaw.pos": angles[:, 1]}
    path = tmp_path / "data" / "chunk-000" / "episode.parquet"
    path.parent.mkdir(parents=True)
    parquet.write_table(arrow.table(columns), path)
    clip = load_clip(path, character=models[1])
    _same(clip.qpos, JOINTS[:8])
    assert any("2 episodes" in note for note in clip.notes)
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(InputError, match="parquet"):
        load_clip(path, character=models[1])


def test_loco_mujoco_columns(tmp_path: Path) -> None:
    model = tmp_path / "cart.xml"
    model.write_text(
        "<mujoco><worldbody><body><joint name='x' type='slide'/><geom size='1'/>"
        "<body><joint name='tilt'/><geom size='1'/></body></body></worldbody></mujoco>"
    )
    path = tmp_path / "a.npz"
    np.savez(path, q_tilt=JOINTS[:, 1], q_x=JOINTS[:, 0], dq_x=JOINTS[:, 0], frequency=100.0)
    _same(load_clip(path, character=Character.load(model)).qpos, JOINTS)


def test_the_pose_of_an_object_behind_the_robots_is_left_out(
    tmp_path: Path, models: tuple[Character, Character]
) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, qpos=np.concatenate([QPOS, PLACE, WXYZ], axis=1), fps=30)
    clip = load_clip(path, character=models[0])
    _same(clip.qpos)
    assert any("left out" in note for note in clip.notes)
    np.savez(path, qpos=np.concatenate([QPOS, PLACE, WXYZ * 1.2], axis=1), fps=30)
    with pytest.raises(InputError, match="nq = 9"):
        load_clip(path, character=models[0])


@pytest.mark.parametrize("suffix", [".npz", ".pkl", ".csv", ".npy", ".parquet"])
def test_a_pointer_of_git_lfs_is_called_one(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    path.write_text("version https://git-lfs.example/spec/v1\noid sha256:abc\nsize 12345\n")
    with pytest.raises(InputError, match="a git-lfs pointer, not the clip: fetch the file itself"):
        load_clip(path)


def _joblib(motions: dict[str, dict[str, object]], wrapper: str = "joblib.numpy_pickle") -> bytes:
    """What joblib.dump writes (protocol 4), made by hand."""
    out = io.BytesIO()

    def text(value: str) -> None:
        out.write(b"\x8c" + struct.pack("<B", len(value)) + value.encode())

    out.write(b"\x80\x04}(")
    for name, motion in motions.items():
        text(name)
        out.write(b"}(")
        for key, value in motion.items():
            text(key)
            if isinstance(value, np.ndarray):
                text(wrapper)
                text("NumpyArrayWrapper")
                out.write(b"\x93)\x81}(")
                text("shape")
                out.write(b"(" + b"".join(b"J" + struct.pack("<i", n) for n in value.shape) + b"t")
                text("order")
                text("C")
                text("dtype")
                text("numpy")
                text("dtype")
                out.write(b"\x93")
                text(value.dtype.str)
                out.write(b"\x85R")
                text("numpy_array_alignment_bytes")
                out.write(b"K\x10ub\x03abc" + value.tobytes())
            else:
                out.write(b"K" + struct.pack("<B", value))
        out.write(b"u")
    out.write(b"u.")
    return out.getvalue()


MOTION = {"root_trans_offset": PLACE, "root_rot": XYZW, "dof": JOINTS, "fps": 30}


def test_joblib(tmp_path: Path, models: tuple[Character, Character]) -> None:
    path = tmp_path / "a.pkl"
    path.write_bytes(_joblib({"walk": MOTION, "run": MOTION}))
    clip = load_clip(path, character=models[0])
    _same(clip.qpos)
    assert any("2 motions" in note and "'walk'" in note for note in clip.notes)


def test_joblibs_own_pickle(tmp_path: Path, models: tuple[Character, Character]) -> None:
    joblib = pytest.importorskip("joblib", reason="the twin of the extra 'twins'")
    path = tmp_path / "a.pkl"
    joblib.dump({"walk": MOTION}, path)
    _same(load_clip(path, character=models[0]).qpos)


def test_a_joblib_pickle_runs_nothing_and_claims_no_memory(tmp_path: Path) -> None:
    path = tmp_path / "a.pkl"
    good = _joblib({"walk": MOTION})
    path.write_bytes(good[:-400])
    with pytest.raises(InputError):
        load_clip(path)
    far = {"walk": MOTION | {"dof": np.zeros((FRAMES, 2))}}
    claims = _joblib(far).replace(struct.pack("<i", FRAMES), struct.pack("<i", 1 << 30))
    path.write_bytes(claims)
    with pytest.raises(InputError):
        load_clip(path)
    ran = tmp_path / "ran"
    evil = b"joblib.numpy_pickle" + pickle.dumps(0)
    for program in (
        b"cos\nsystem\n(S'touch " + str(ran).encode() + b"'\ntR.",
        b"\x80\x04\x8c\x02os\x8c\x06system\x93\x8c\x01x\x85R.",
        b"\x80\x04cnumpy\ndtype\n)\x81.",
    ):
        path.write_bytes(program + evil)
        with pytest.raises(InputError):
            load_clip(path)
    assert not ran.exists()


def _motion_file(path: Path, fields: dict[str, np.ndarray], count: int | None = None) -> None:
    """What torch.save writes of tensors, made by hand."""
    out = io.BytesIO()

    def text(value: str) -> None:
        out.write(b"X" + struct.pack("<I", len(value)) + value.encode())

    def number(value: int) -> None:
        out.write(b"J" + struct.pack("<i", value))

    out.write(b"\x80\x02}(")
    text("fps")
    number(30)
    text("state")
    out.write(b"cprotomotions.states\nKind\n")
    text("common")
    out.write(b"\x85R")
    for key, (name, array) in enumerate(fields.items()):
        text(name)
        out.write(b"ctorch._utils\n_rebuild_tensor_v2\n((")
        text("storage")
        out.write(b"ctorch\nFloatStorage\n")
        text(str(key))
        text("cpu")
        number(array.size if count is None else count)
        out.write(b"tQ")
        number(0)
        steps = [stride // array.itemsize for stride in array.strides]
        for values in (array.shape, steps):
            out.write(b"(")
            for value in values:
                number(value)
            out.write(b"t")
        out.write(b"\x89ccollections\nOrderedDict\n)Rt")
        out.write(b"R")
    out.write(b"u.")
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("walk/data.pkl", out.getvalue())
        for key, array in enumerate(fields.values()):
            archive.writestr(f"walk/data/{key}", array.astype("<f4").tobytes())


FIELDS = {
    "dof_pos": JOINTS.astype(np.float32),
    "rigid_body_pos": np.stack([PLACE, PLACE + 1], axis=1).astype(np.float32),
    "rigid_body_rot": np.stack([XYZW, XYZW], axis=1).astype(np.float32),
}


def test_proto_motions(tmp_path: Path, models: tuple[Character, Character]) -> None:
    path = tmp_path / "a.motion"
    _motion_file(path, FIELDS)
    clip = load_clip(path, character=models[0])
    _same(clip.qpos)
    assert clip.time[1] == pytest.approx(1 / 30)


def test_a_tensor_beyond_its_storage_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.motion"
    _motion_file(path, FIELDS, count=1 << 20)
    with pytest.raises(InputError):
        load_clip(path)


def test_an_archive_runs_nothing(tmp_path: Path) -> None:
    path = tmp_path / "a.motion"
    _motion_file(path, FIELDS)
    with zipfile.ZipFile(path) as archive:
        program = archive.read("walk/data.pkl")
    broken = program.replace(b"torch._utils\n_rebuild_tensor_v2", b"os\nsystem", 1)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("walk/data.pkl", broken)
    with pytest.raises(UnsafeInputError, match=r"asks for os\.system"):
        load_clip(path)


def test_the_same_walk_as_its_twin(data: Path) -> None:
    model = Character.load(data / "robot" / "g1_no_mesh_box_feet.xml")
    motion = load_clip(data / "formats" / "proto_walk.motion", character=model)
    table = load_clip(data / "robot" / "g1_walk.csv", character=model, fps=30, quat="wxyz")
    np.testing.assert_allclose(motion.qpos[:, 7:], table.qpos[:, 7:], atol=1e-5)
    np.testing.assert_allclose(motion.qpos[:, :2], table.qpos[:, :2], atol=1e-5)


@pytest.mark.parametrize("protocol", range(6))
def test_arrays_of_every_plain_type_come_through(tmp_path: Path, protocol: int) -> None:
    from physretarget.archives.pickles import unpickle

    arrays = {
        "little": np.arange(6, dtype="<f4").reshape(2, 3),
        "big": np.arange(6, dtype=">f8").reshape(2, 3),
        "turned": np.asfortranarray(np.arange(6.0).reshape(2, 3)),
        "names": np.array(["hip", "knee"]),
        "objects": np.array(["hip", None], dtype=object),
        "flags": np.array([True, False]),
        "number": np.float32(1.5),
    }
    found = unpickle(pickle.dumps(arrays, protocol=protocol), path="a.pkl")
    for name, array in arrays.items():
        assert np.array_equal(np.asarray(found[name]), array), name


class _Restored:
    """Pickles as a data type with any state at all."""

    def __init__(self, state: object) -> None:
        self.state = state

    def __reduce__(self) -> tuple[object, ...]:
        return np.dtype, ("f8", False, True), self.state


@pytest.mark.parametrize(
    "state",
    [
        (3, "|", None, ("a", "b"), {"a": 1}, 8, 8, 27),
        (3, "<", (np.dtype("f8"), (1 << 40,)), None, None, 8, 8, 0),
        (4, "<", None, None, None, -1, -1, 0, {"a": 1}, 5),
        (3, None, None, None, None, -1, -1, 0),
        3,
    ],
)
def test_a_state_that_no_plain_type_has_is_refused(tmp_path: Path, state: object) -> None:
    path = tmp_path / "a.pkl"
    path.write_bytes(pickle.dumps({"root_pos": _Restored(state)}))
    with pytest.raises(InputError):
        load_clip(path)
