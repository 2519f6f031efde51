from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from physretarget.capture import READERS, find_reader, load, read
from physretarget.capture.actor import ActorMotion
from physretarget.errors import InputError, UsageError

BVH = b"HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nCHANNELS 1 Xrotation\n}\nMOTION\n"


@pytest.mark.parametrize(
    ("name", "content", "kind"),
    [
        ("a.bvh", BVH, "bvh"),
        ("a.txt", BVH, "bvh"),
        ("a.BVH", b"x", "bvh"),
        ("a.amc", b"#!OML\n", "amc"),
        ("a.trc", b"PathFileType\t4\n", "trc"),
        ("a.dat", b"PathFileType\t4\n", "trc"),
        ("a.c3d", b"\x02\x50" + bytes(600), "c3d"),
        ("a.bin", b"\x02\x50" + bytes(600), "c3d"),
        ("a.txt", b'{"Frames": []}', "deepmimic"),
        ("a.json", b' {"Frames": []}', "deepmimic"),
        ("a.json", b"[[[0, 0, 0]]]", "keypoints"),
        ("a.csv", b"Format Version,1.23\n", "motive"),
        ("a.csv", b"hip_x,hip_y,hip_z\n", "keypoints"),
        ("a.tsv", b"NO_OF_FRAMES\t3\n", "qualisys"),
        ("a.npz", b"PK", "smpl"),
        ("a.mvnx", b'<?xml version="1.0"?><mvnx version="4">', "mvnx"),
        ("a.bin", b"glTF" + bytes(20), "gltf"),
        ("a.fbx", b"Kaydara FBX Binary  ", "fbx"),
        ("a.usd", b"PXR-USDC", "usd"),
    ],
)
def test_formats_are_told_by_content_first(
    tmp_path: Path, name: str, content: bytes, kind: str
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    assert find_reader(path).name == kind


@pytest.mark.parametrize("name", ["a.dat", "a", "a.xlsx"])
def test_unknown_formats_are_refused_with_the_known_ones(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(b"1,2,3\n4,5,6\n")
    with pytest.raises(InputError) as caught:
        load(path)
    assert all(reader.title in caught.value.message for reader in READERS)


def test_absent_files_folders_and_bare_skeletons(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not exist"):
        load(tmp_path / "gone.bvh")
    with pytest.raises(InputError, match="folder"):
        load(tmp_path)
    (tmp_path / "a.asf").write_text(":version 1.10")
    with pytest.raises(InputError, match="give the AMC"):
        load(tmp_path / "a.asf")


@pytest.mark.parametrize(
    "options", [{"mass": -1.0}, {"fps": 0.0}, {"skeleton": "a.asf"}, {"unit": "ell"}, {"up": "w"}]
)
def test_senseless_options_are_usage_errors(data: Path, options: dict[str, object]) -> None:
    path = data / "bvh" / "bandai" / "dataset-1_bow_sad_001.bvh"
    with pytest.raises(UsageError):
        load(path, **options)  # type: ignore[arg-type]


@pytest.mark.data
def test_options_are_obeyed(data: Path) -> None:
    path = data / "bvh" / "cmu" / "131_01.bvh"
    motion = load(path, fps=30.0, max_seconds=2.0, mass=82.0)
    assert isinstance(motion, ActorMotion)
    assert motion.fps == 30.0
    assert motion.shape.mass == 82.0
    assert abs(motion.time[-1] - 2.0) < 0.05
    assert motion.source.frames == 994
    assert len(motion.source.sha256) == 64
    told = read(path, unit="0.05", up="y")
    assert told.source.unit == "0.05"
    assert not any("guessed" in note for note in told.notes)
    found = read(path)
    np.testing.assert_allclose(told.position / 0.05, found.position / (0.0254 / 0.45))


@pytest.mark.data
def test_same_file_same_numbers(data: Path) -> None:
    path = data / "bvh" / "bandai" / "dataset-1_run_angry_001.bvh"
    assert load(path).qpos.tobytes() == load(path).qpos.tobytes()


def test_a_skeleton_file_with_nan_is_refused_by_frame(data, tmp_path) -> None:
    lines = next((data / "bvh" / "bandai").glob("*.bvh")).read_text().splitlines(keepends=True)
    first = next(i for i, line in enumerate(lines) if line.startswith("Frame Time")) + 1
    cells = lines[first + 30].split()
    lines[first + 30] = " ".join([*cells[:7], "nan", *cells[8:]]) + "\n"
    (tmp_path / "nan.bvh").write_text("".join(lines))
    with pytest.raises(InputError, match=r"nan\.bvh, frame 30: joint '\w+' is not a number"):
        load(tmp_path / "nan.bvh")
