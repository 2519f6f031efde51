"""Other tools' spellings of a clip, each of which once was refused."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from physretarget.clip import load_clip
from physretarget.errors import InputError

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
