"""Other tools' spellings of a clip, each of which once was refused."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physretarget.clip import load_clip
from physretarget.errors import InputError, UsageError
from physretarget.mjcf import Character

XYZ = np.arange(30.0).reshape(10, 3) / 100
ROWS = np.concatenate([XYZ, np.tile([1.0, 0, 0, 0], (10, 1)), np.zeros((10, 2))], axis=1)


@pytest.mark.parametrize("wrapped", [False, True])
def test_phc_and_its_kin(tmp_path: Path, wrapped: bool) -> None:
    motion = {
        "root_trans_offset": XYZ,
        "root_rot": np.tile([0.0, 0, 0, 1], (10, 1)),
        "dof": np.zeros((10, 2)),
        "pose_aa": np.zeros((10, 3, 3)),
        "fps": 30,
    }
    path = tmp_path / "walk.pkl"
    path.write_bytes(pickle.dumps({"walk": motion} if wrapped else motion))
    np.testing.assert_allclose(load_clip(path).qpos, ROWS)


@pytest.mark.parametrize("first", ["Frame", "index", "Frame,time"])
def test_a_column_that_counts_frames(tmp_path: Path, first: str) -> None:
    count = np.arange(10.0)[:, None]
    table = np.concatenate([*([count] * first.count(",")), count, ROWS], axis=1)
    names = f"{first},x,y,z,qw,qx,qy,qz,a,b"
    path = tmp_path / "walk.csv"
    np.savetxt(path, table, delimiter=",", header=names, comments="")
    clip = load_clip(path, fps=None if "time" in first else 30.0)
    np.testing.assert_allclose(clip.qpos, ROWS)


def test_a_table_of_frame_numbers_alone(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    path.write_text("Frame\n0\n1\n2\n")
    with pytest.raises(InputError):
        load_clip(path, fps=30.0, quat="wxyz")


def gmr(path: Path, root_rot: np.ndarray) -> Path:
    frames = len(root_rot)
    motion = {
        "fps": 30,
        "root_pos": np.zeros((frames, 3)),
        "root_rot": root_rot,
        "dof_pos": np.zeros((frames, 2)),
    }
    path.write_bytes(pickle.dumps(motion))
    return path


def turning(order: str, *, lying: bool = False) -> np.ndarray:
    """Someone who turns by 120 degrees to the left, upright or flat on the back."""
    turn = Rotation.from_rotvec(np.linspace(0, 2.1, 20)[:, None] * [0, 0, 1])
    turn = turn * Rotation.from_euler("y", -90 if lying else 0, degrees=True)
    return turn.as_quat(scalar_first=order == "wxyz")


def test_a_gmr_pickle_that_stands_only_in_the_other_order_is_doubted(tmp_path: Path) -> None:
    (note,) = [
        n for n in load_clip(gmr(tmp_path / "a.pkl", turning("wxyz"))).notes if "read as" in n
    ]
    assert "--quat wxyz" in note
    assert "5% of the frames then, in 100%" in note  # it begins at zero, which is the same in both
    told = load_clip(gmr(tmp_path / "a.pkl", turning("wxyz")), quat="wxyz")
    assert not [n for n in told.notes if "--quat" in n]
    np.testing.assert_allclose(told.qpos[:, 3:7], turning("wxyz"))


@pytest.mark.parametrize("lying", [False, True])
def test_a_gmr_pickle_as_gmr_writes_it_is_not(tmp_path: Path, lying: bool) -> None:
    clip = load_clip(gmr(tmp_path / "a.pkl", turning("xyzw", lying=lying)))
    assert not [n for n in clip.notes if "--quat" in n]
    np.testing.assert_allclose(clip.qpos[:, 3:7], turning("wxyz", lying=lying))


def test_a_qpos_array_with_xyzw_inside_is_doubted(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    np.save(path, np.concatenate([np.zeros((20, 3)), turning("xyzw"), np.zeros((20, 2))], axis=1))
    assert any("--quat xyzw" in n for n in load_clip(path, fps=30).notes)


@pytest.mark.parametrize(
    ("separator", "comma", "end", "head"),
    [
        (",", ".", "\n", ""),
        (",", ".", "\r\n", ""),
        (",", ".", ",\n", ""),
        (";", ".", "\n", ""),
        (";", ",", "\n", ""),
        ("\t", ".", "\n", ""),
        (" ", ".", "\n", "# made by a tool, version 2\n"),
        (",", ".", "\n", "# made by a tool\n#x,y,z,qw,qx,qy,qz,a,b\n"),
        (";", ",", ";\r\n", "x;y;z;qw;qx;qy;qz;a;b;\r\n"),
    ],
)
def test_a_csv_of_any_spelling(
    tmp_path: Path, separator: str, comma: str, end: str, head: str
) -> None:
    path = tmp_path / "walk.csv"
    rows = (separator.join(f"{v:.6f}".replace(".", comma) for v in row) for row in ROWS)
    path.write_bytes((head + "".join(row + end for row in rows)).encode())
    clip = load_clip(path, fps=30.0, quat="wxyz")
    np.testing.assert_allclose(clip.qpos, ROWS)
    assert clip.joint_names == (("a", "b") if "qw" in head else ())


@pytest.mark.parametrize(("unit", "scale"), [("m", 1), ("cm", 100), ("mm", 1000), ("0.5", 2)])
def test_a_clip_in_another_unit(tmp_path: Path, unit: str, scale: float) -> None:
    path = tmp_path / "walk.npy"
    rows = ROWS.copy()
    rows[:, :3] *= scale
    rows[:, 7] = 0.25  # an angle, which has no length
    np.save(path, rows)
    clip = load_clip(path, fps=30.0, unit=unit)
    np.testing.assert_allclose(clip.qpos[:, :3], XYZ, atol=1e-12)
    np.testing.assert_allclose(clip.qpos[:, 7], 0.25)
    assert any("m to the unit" in note for note in clip.notes)


def test_a_slide_is_a_length_too(tmp_path: Path) -> None:
    text = """<mujoco><worldbody><body><freejoint/><geom size=".1"/><body><joint name="s"
    type="slide"/><geom size=".1"/><body><joint name="h"/><geom size=".1"/></body></body></body>
    </worldbody></mujoco>"""
    path = tmp_path / "walk.npy"
    np.save(path, np.c_[ROWS[:, :7], np.full((10, 2), 3.0)])
    clip = load_clip(path, fps=30.0, unit="cm", character=Character.from_xml(text, name="m"))
    np.testing.assert_allclose(clip.qpos[0, 7:], [0.03, 3.0])


@pytest.mark.parametrize("unit", ["ft", "-1", "nan", "0", "1e9", ""])
def test_an_unknown_unit_is_refused(tmp_path: Path, unit: str) -> None:
    np.save(tmp_path / "walk.npy", ROWS)
    with pytest.raises(UsageError, match="m, cm, mm, inch"):
        load_clip(tmp_path / "walk.npy", fps=30.0, unit=unit)
