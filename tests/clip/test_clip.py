from __future__ import annotations

import contextlib
import io
import os
import pickle
import re
import struct
import time as clock
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from physretarget.clip import Clip, load_clip
from physretarget.errors import InputError, UnsafeInputError, UsageError
from physretarget.kinematics import Joint, Tree, forward


class Toy:
    """A free root with two branches of two hinges: depth-first and breadth-first differ."""

    name = "toy"
    sha256 = "0" * 64
    joint_names = ("root", "left_1", "left_2", "right_1", "right_2")

    def __init__(self) -> None:
        parent = np.array([0, 0, 1, 2, 1, 4])
        offset = np.array(
            [[0, 0, 0], [0, 0, 0], [0, 0.3, 0], [0.2, 0, 0], [0, -0.3, 0.1], [0.25, 0, 0.0]]
        )
        rotation = np.tile([1.0, 0, 0, 0], (6, 1))
        axis = np.array([0.0, 0, 1])
        joints = [Joint("free", 1, 0, 0, axis, np.zeros(3))]
        joints += [
            Joint("hinge", b, 7 + i, 6 + i, axis, np.zeros(3)) for i, b in enumerate([2, 3, 4, 5])
        ]
        self.tree = Tree(parent=parent, offset=offset, rotation=rotation, joints=tuple(joints))


def motion(frames: int = 12) -> np.ndarray:
    rng = np.random.default_rng(3)
    qpos = np.zeros((frames, 11))
    qpos[:, :3] = rng.normal(size=(frames, 3))
    qpos[:, 3] = 1
    qpos[:, 4:7] = 0.05 * rng.normal(size=(frames, 3))
    qpos[:, 3:7] /= np.linalg.norm(qpos[:, 3:7], axis=1, keepdims=True)
    qpos[:, 7:] = rng.normal(size=(frames, 4))
    return qpos


def clip(**changes: object) -> Clip:
    qpos = motion()
    fields: dict = {
        "qpos": qpos,
        "time": np.arange(len(qpos)) / 30,
        "joint_names": Toy.joint_names,
        "model_name": "toy",
        "contact_points": ("heel", "toe"),
        "contact_active": np.arange(2 * len(qpos)).reshape(-1, 2) % 3 == 0,
        "meta": {"seed": 0, "inputs": {"a.bvh": "00ff"}},
        "notes": ("One thing was guessed.",),
    }
    return Clip(**(fields | changes))


def test_saved_clip_comes_back_and_bytes_repeat(tmp_path: Path) -> None:
    before = clip()
    before.save(tmp_path / "a.npz")
    clock.sleep(0.01)
    clip().save(tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    after = load_clip(tmp_path / "a.npz", character=Toy())
    np.testing.assert_allclose(after.qpos, before.qpos, atol=1e-15)
    np.testing.assert_array_equal(after.time, before.time)
    np.testing.assert_array_equal(after.contact_active, before.contact_active)
    assert after.meta == before.meta
    assert after.notes == before.notes
    assert after.joint_names == before.joint_names
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.npz", "b.npz"]  # nothing left over


def test_saving_never_pickles(tmp_path: Path) -> None:
    clip().save(tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz", allow_pickle=False) as file:
        assert set(file) >= {"qpos", "time", "joint_names", "model_name", "model_sha256", "meta"}
        assert all(file[name].dtype != object for name in file)


@pytest.mark.parametrize(
    ("change", "message", "frame"),
    [
        ({"time": np.r_[np.arange(11), 10.0] / 30}, "must increase", 11),
        ({"time": np.full(12, 1.0)}, "must increase", 1),
        ({"qpos": np.where(np.arange(12)[:, None] == 5, np.nan, motion())}, "nan", 5),
        ({"time": np.arange(11) / 30}, "frames", None),
        ({"qpos": np.zeros((0, 11)), "time": np.zeros(0)}, "empty", None),
    ],
)
def test_unusable_motion_names_the_frame(change: dict, message: str, frame: int | None) -> None:
    with pytest.raises(InputError, match=message) as caught:
        clip(contact_active=None, **change)
    assert caught.value.frame == frame


def test_wrong_nq_names_both(tmp_path: Path) -> None:
    path = tmp_path / "wide.npy"
    np.save(path, np.zeros((4, 13)))
    with pytest.raises(InputError, match=r"13 coordinates.*nq = 11"):
        load_clip(path, character=Toy(), fps=30)


def test_joints_are_ordered_by_name(tmp_path: Path) -> None:
    qpos = motion()
    names = ["right_2", "left_1", "right_1", "left_2"]
    columns = [10, 7, 9, 8]
    np.savez(
        tmp_path / "c.npz", qpos=np.c_[qpos[:, :7], qpos[:, columns]], fps=30,
        joint_names=np.array(["base", *names]),
    )  # fmt: skip
    read = load_clip(tmp_path / "c.npz", character=Toy())
    np.testing.assert_allclose(read.qpos, qpos, atol=1e-12)
    assert any("by their names" in n for n in read.notes)


def test_other_joint_names_are_named(tmp_path: Path) -> None:
    np.savez(
        tmp_path / "c.npz", qpos=motion(), fps=30,
        joint_names=np.array(["root", "left_1", "left_2", "right_1", "right_x"]),
    )  # fmt: skip
    with pytest.raises(InputError, match="right_x") as caught:
        load_clip(tmp_path / "c.npz", character=Toy())
    assert "'right_2'" in str(caught.value)


@pytest.mark.parametrize(
    ("theirs", "meant"),
    [("left_knee_jont", "left_knee_joint"), ("left_knee", "left_knee_joint"),
     ("Left_Knee_Joint", "left_knee_joint"), ("left_elbow_joint", None),
     ("right_knee_joint", None), ("hip_left", None),
     ("floating_base", None), ("left_hip_pitch_link", None)],
)  # fmt: skip
def test_only_a_joint_that_is_near_and_missing_is_suggested(
    tmp_path: Path, theirs: str, meant: str | None
) -> None:
    """left_hip_pitch_joint is nearest to the last, but the clip has it."""
    toy = Toy()
    ours = ("floating_base_joint", "left_hip_pitch_joint", "left_knee_joint", "waist", "neck")
    toy.joint_names = ours
    np.savez(
        tmp_path / "c.npz",
        qpos=motion(),
        fps=30,
        joint_names=np.array([*ours[:2], theirs, *ours[3:]]),
    )
    with pytest.raises(InputError, match=f"joint '{theirs}' is not in model 'toy'") as caught:
        load_clip(tmp_path / "c.npz", character=toy)
    told = re.findall(r"did it mean '(\w+)'", str(caught.value))
    assert told == ([] if meant is None else [meant])


def test_locomujoco(tmp_path: Path) -> None:
    qpos = motion()
    np.savez(
        tmp_path / "l.npz", qpos=qpos, qvel=np.zeros((12, 10)), frequency=np.array(40.0),
        joint_names=np.array(Toy.joint_names), split_points=np.array([0, 7, 12]),
        metadata=np.array(None, dtype=object),
    )  # fmt: skip
    read = load_clip(tmp_path / "l.npz", character=Toy())
    assert read.format == "LocoMuJoCo npz"
    assert read.frames == 7
    assert read.fps == pytest.approx(40)
    np.testing.assert_allclose(read.qpos, qpos[:7], atol=1e-12)


def test_holosoma_and_plain(tmp_path: Path) -> None:
    np.savez(tmp_path / "h.npz", qpos=motion(), fps=30, human_joints=np.zeros((12, 3, 3)), cost=1.0)
    assert load_clip(tmp_path / "h.npz", character=Toy()).format == "holosoma npz"
    np.savez(tmp_path / "p.npz", qpos=motion(), time=np.arange(12) / 24)
    assert load_clip(tmp_path / "p.npz", character=Toy()).fps == pytest.approx(24)
    np.save(tmp_path / "p.npy", motion())
    with pytest.raises(InputError, match="--fps"):
        load_clip(tmp_path / "p.npy", character=Toy())


@pytest.mark.parametrize("order", ["model", "breadth-first"])
def test_mjlab_joint_order_is_found_by_kinematics(tmp_path: Path, order: str) -> None:
    toy, qpos = Toy(), motion()
    pose = forward(toy.tree, qpos)
    bodies = [1, 2, 3, 4, 5] if order == "model" else [1, 2, 4, 3, 5]
    joints = [7, 8, 9, 10] if order == "model" else [7, 9, 8, 10]
    quat = np.tile([1.0, 0, 0, 0], (12, 5, 1))
    quat[:, 0] = qpos[:, 3:7]
    np.savez(
        tmp_path / "m.npz", fps=np.array([50]), joint_pos=qpos[:, joints].astype(np.float32),
        body_pos_w=pose.position[:, bodies], body_quat_w=quat,
    )  # fmt: skip
    read = load_clip(tmp_path / "m.npz", character=toy)
    np.testing.assert_allclose(read.qpos, qpos, atol=1e-6)
    assert any(order in n for n in read.notes)


@pytest.mark.parametrize("joints", ["model", "breadth-first"])
@pytest.mark.parametrize("bodies", ["model", "breadth-first"])
def test_mjlab_body_order_is_told_apart_from_that_of_joints(
    tmp_path: Path, joints: str, bodies: str
) -> None:
    toy, qpos = Toy(), motion()
    pose = forward(toy.tree, qpos)
    order = [1, 2, 3, 4, 5] if bodies == "model" else [1, 2, 4, 3, 5]
    columns = [7, 8, 9, 10] if joints == "model" else [7, 9, 8, 10]
    quat = np.tile([1.0, 0, 0, 0], (12, 5, 1))
    quat[:, 0] = qpos[:, 3:7]
    np.savez(
        tmp_path / "m.npz", fps=50, joint_pos=qpos[:, columns],
        body_pos_w=pose.position[:, order], body_quat_w=quat,
    )  # fmt: skip
    read = load_clip(tmp_path / "m.npz", character=toy)
    np.testing.assert_allclose(read.qpos, qpos, atol=1e-6)
    told = any("bodies are in breadth-first order" in n for n in read.notes)
    assert told == (bodies == "breadth-first")


def test_mjlab_unsettled_order_is_asked_for(tmp_path: Path) -> None:
    quat = np.tile([1.0, 0, 0, 0], (12, 5, 1))
    np.savez(
        tmp_path / "m.npz", fps=50, joint_pos=motion()[:, 7:],
        body_pos_w=np.zeros((12, 5, 3)), body_quat_w=quat,
    )  # fmt: skip
    with pytest.raises(InputError, match="order"):
        load_clip(tmp_path / "m.npz", character=Toy())
    read = load_clip(tmp_path / "m.npz", character=Toy(), joint_order="model")
    assert any("as told" in n for n in read.notes)


@pytest.mark.parametrize("protocol", [0, 1, 2, 3, 4, 5])
def test_gmr_pickle(tmp_path: Path, protocol: int) -> None:
    qpos = motion()
    value = {
        "fps": 30, "root_pos": qpos[:, :3], "root_rot": qpos[:, [4, 5, 6, 3]],
        "dof_pos": qpos[:, 7:], "local_body_pos": None, "link_body_list": ["a", "b"],
    }  # fmt: skip
    (tmp_path / "g.pkl").write_bytes(pickle.dumps(value, protocol=protocol))
    read = load_clip(tmp_path / "g.pkl", character=Toy())
    np.testing.assert_allclose(read.qpos, qpos, atol=1e-12)


class _Evil:
    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple:
        return Path.touch, (self.path,)


def test_pickle_that_runs_code_runs_nothing(tmp_path: Path) -> None:
    made = tmp_path / "made"

    class Shell:
        def __reduce__(self) -> tuple:
            return os.system, (f"touch {made}",)

    for evil in (Shell(), {"fps": Shell()}, [_Evil(made)]):
        (tmp_path / "e.pkl").write_bytes(pickle.dumps(evil))
        with pytest.raises(UnsafeInputError, match="nothing was run"):
            load_clip(tmp_path / "e.pkl", character=Toy())
    np.savez(tmp_path / "e.npz", qpos=np.array([Shell()], dtype=object), fps=30)
    with pytest.raises(UnsafeInputError):
        load_clip(tmp_path / "e.npz", character=Toy())
    assert not made.exists()


def test_pickled_array_cannot_claim_memory(tmp_path: Path) -> None:
    # numpy's _reconstruct with a terabyte shape
    stream = (
        b"\x80\x02cnumpy.core.multiarray\n_reconstruct\ncnumpy\nndarray\n"
        b"\x8a\x06\x00\x00\x00\x00\x00\x01\x85U\x01d\x87R."
    )
    (tmp_path / "big.pkl").write_bytes(stream)
    with pytest.raises(InputError):
        load_clip(tmp_path / "big.pkl")
    (tmp_path / "b8.pkl").write_bytes(b"\x80\x04\x8e" + struct.pack("<Q", 1 << 40) + b"abc.")
    with pytest.raises(InputError):
        load_clip(tmp_path / "b8.pkl")


def _npy_header(shape: tuple[int, ...]) -> bytes:
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "<f8", "fortran_order": False, "shape": shape}
    )
    return header.getvalue()


def test_header_claiming_two_gigabytes(tmp_path: Path) -> None:
    claim = _npy_header((250_000, 1000)) + b"\0" * 64
    (tmp_path / "big.npy").write_bytes(claim)
    with pytest.raises(InputError, match="2000000000 bytes"):
        load_clip(tmp_path / "big.npy", fps=30)
    with zipfile.ZipFile(tmp_path / "big.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("qpos.npy", claim)
        archive.writestr("fps.npy", _npy_header((1,)) + struct.pack("<d", 30.0))
    with pytest.raises(InputError, match="2000000000 bytes"):
        load_clip(tmp_path / "big.npz")


def write_csv(path: Path, qpos: np.ndarray, header: str = "") -> Path:
    np.savetxt(path, qpos, delimiter=",", header=header, comments="")
    return path


def test_csv_order_is_inferred_only_when_sound(tmp_path: Path) -> None:
    qpos = motion()
    turned = qpos.copy()
    half = np.linspace(0, np.pi, len(qpos)) / 2
    turned[:, 3:7] = np.c_[np.cos(half), 0 * half, 0 * half, np.sin(half)]
    xyzw = turned[:, [0, 1, 2, 4, 5, 6, 3, *range(7, 11)]]
    for order, values, meant in (("wxyz", qpos, qpos), ("xyzw", xyzw, turned)):
        read = load_clip(write_csv(tmp_path / "a.csv", values), character=Toy(), fps=30)
        np.testing.assert_allclose(read.qpos, meant, atol=1e-9)
        assert any(f"{order} was inferred" in n for n in read.notes)
    facing_back = qpos.copy()
    facing_back[:, 3:7] = [0, 0, 0, 1]  # upright under both readings
    write_csv(tmp_path / "b.csv", facing_back)
    with pytest.raises(InputError, match="--quat"):
        load_clip(tmp_path / "b.csv", character=Toy(), fps=30)
    read = load_clip(tmp_path / "b.csv", character=Toy(), fps=30, quat="wxyz")
    np.testing.assert_allclose(read.qpos, facing_back, atol=1e-9)


def test_csv_errors_name_the_line(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "a.csv", motion())
    lines = path.read_text().splitlines()
    lines[4] = lines[4].replace(",", ",x", 1)
    path.write_text("\n".join(lines))
    with pytest.raises(InputError, match="not a number") as caught:
        load_clip(path, fps=30, quat="wxyz")
    assert caught.value.line == 5
    lines[4] = "1,2"
    path.write_text("\n".join(lines))
    with pytest.raises(InputError, match="row has 2") as caught:
        load_clip(path, fps=30, quat="wxyz")
    assert caught.value.line == 5


def test_csv_with_header(tmp_path: Path) -> None:
    header = "px,py,pz,qw,qx,qy,qz,right_2,left_1,right_1,left_2"
    qpos = motion()
    write_csv(tmp_path / "a.csv", qpos[:, [*range(7), 10, 7, 9, 8]], header)
    read = load_clip(tmp_path / "a.csv", character=Toy(), fps=30)
    np.testing.assert_allclose(read.qpos, qpos, atol=1e-9)


def test_csv_nan_names_the_frame(tmp_path: Path) -> None:
    qpos = motion()
    qpos[3, 8] = np.nan
    with pytest.raises(InputError, match="finite") as caught:
        load_clip(write_csv(tmp_path / "a.csv", qpos), fps=30, quat="wxyz")
    assert caught.value.frame == 3


def test_quaternions_are_repaired_or_refused(tmp_path: Path) -> None:
    qpos = motion()
    qpos[6, 3:7] *= 1.05
    read = load_clip(write_csv(tmp_path / "a.csv", qpos), character=Toy(), fps=30, quat="wxyz")
    np.testing.assert_allclose(np.linalg.norm(read.qpos[:, 3:7], axis=1), 1, atol=1e-12)
    assert any("normalised" in n and "frame 6" in n for n in read.notes)
    qpos[6, 3:7] *= 2
    with pytest.raises(InputError, match="length") as caught:
        load_clip(write_csv(tmp_path / "a.csv", qpos), character=Toy(), fps=30, quat="wxyz")
    assert caught.value.frame == 6


def test_words_of_the_user_are_checked(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "a.csv", motion())
    with pytest.raises(UsageError, match="wxyz or xyzw"):
        load_clip(path, fps=30, quat="zyxw")
    with pytest.raises(UsageError, match="frame rate"):
        load_clip(path, fps=0.0)
    with pytest.raises(InputError, match="no clip format"):
        load_clip(tmp_path / "a.fbx")
    with pytest.raises(InputError, match="cannot be read"):
        load_clip(tmp_path / "none.npz")


_QUIET = settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@_QUIET
@given(data=st.binary(max_size=400), suffix=st.sampled_from([".npz", ".npy", ".csv", ".pkl"]))
def test_garbage_is_refused_in_one_sentence(tmp_path: Path, data: bytes, suffix: str) -> None:
    path = tmp_path / f"garbage{suffix}"
    path.write_bytes(data)
    try:
        load_clip(path, character=Toy(), fps=30, quat="wxyz")
    except InputError as error:
        said = str(error)
    else:
        return
    assert said.endswith(".")


@_QUIET
@given(at=st.integers(0, 10_000), value=st.integers(0, 255), kind=st.sampled_from(["npz", "pkl"]))
def test_damaged_files_are_read_or_refused(tmp_path: Path, at: int, value: int, kind: str) -> None:
    qpos = motion()
    path = tmp_path / f"d.{kind}"
    if kind == "npz":
        clip().save(path)
    else:
        fields = {"fps": 30, "root_pos": qpos[:, :3], "root_rot": qpos[:, 3:7]}
        path.write_bytes(pickle.dumps(fields | {"dof_pos": qpos[:, 7:]}))
    content = bytearray(path.read_bytes())
    content[at % len(content)] = value
    path.write_bytes(bytes(content))
    with contextlib.suppress(InputError):
        load_clip(path, character=Toy(), quat="wxyz")


def test_the_generated_robot_clips(data: Path) -> None:
    for name, frames in {"walk": 150, "wave": 150, "jumpjack": 120, "dance": 150}.items():
        read = load_clip(data / "robot" / f"g1_{name}.csv", fps=30)
        assert read.qpos.shape == (frames, 36)
        assert any("wxyz was inferred" in n for n in read.notes)
