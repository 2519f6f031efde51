from __future__ import annotations

import struct
from pathlib import Path

import ezc3d
import numpy as np
import pytest

from physretarget.capture.c3d import read_c3d
from physretarget.errors import InputError, UnsafeInputError

LABELS = ["s:LFHD", "s:RFHD", "s:LHEE", "s:RHEE", "s:LASI", "*7", "s:LKneeAngles", "s:RASI"]


def write(path: Path, position: np.ndarray, *, labels=LABELS, unit="mm", screen=None) -> Path:
    """``position`` (T, M, 3) in file units."""
    file = ezc3d.c3d()
    point = file["parameters"]["POINT"]
    point["RATE"]["value"] = [50]
    point["LABELS"]["value"] = list(labels)
    point["UNITS"]["value"] = [unit]
    if screen:
        file.add_parameter("POINT", "X_SCREEN", ["+X"])
        file.add_parameter("POINT", "Y_SCREEN", [screen])
    values = np.ones((4, *position.shape[1::-1]))
    values[:3] = np.moveaxis(position, -1, 0).swapaxes(1, 2)
    file["data"]["points"] = values
    file.write(str(path))
    return path


def standing(frames: int = 12) -> np.ndarray:
    place = np.array([
        [90, 70, 1680], [90, -70, 1680], [-60, 90, 50], [-60, -90, 50], [70, 120, 1010],
        [1, 2, 3], [20, 30, 40], [70, -120, 1010],
    ], dtype=float)  # fmt: skip
    walk = np.zeros((frames, 1, 3))
    walk[:, 0, 0] = np.linspace(0, 500, frames)
    return place + walk


def test_reads_markers_in_metres_and_leaves_out_the_rest(tmp_path: Path):
    recording = read_c3d(write(tmp_path / "a.c3d", standing()))
    assert recording.labels == ("s:LFHD", "s:RFHD", "s:LHEE", "s:RHEE", "s:LASI", "s:RASI")
    assert recording.source.unit == "mm"
    assert recording.source.up == "z"
    assert recording.source.fps == 50
    np.testing.assert_allclose(recording.position[0, 0], [0.09, 0.07, 1.68], atol=1e-6)
    np.testing.assert_allclose(recording.time, np.arange(12) / 50)
    assert any("1 model outputs" in note for note in recording.notes)
    assert any("1 unnamed" in note for note in recording.notes)


def test_toes_are_no_axes_of_a_segment(tmp_path: Path):
    """Plug-in-Gait's LTOO, LTOA, LTOL and LTOP draw the toes' axes; LTOE is a marker."""
    labels = ["LTOO", "LTOA", "LTOL", "LTOP", "LTOE", "LHEE", "LASI", "RASI"]
    recording = read_c3d(write(tmp_path / "a.c3d", standing(), labels=labels), unit="mm", up="z")
    assert recording.labels == ("LTOE", "LHEE", "LASI", "RASI")


def test_gaps_become_nan(tmp_path: Path):
    position = standing()
    position[3, 0] = np.nan
    position[4, 1] = 0.0
    recording = read_c3d(write(tmp_path / "a.c3d", position))
    missing = np.asarray(np.isnan(recording.position).all(axis=-1))
    assert missing[3, 0]
    assert missing[4, 1]
    assert missing.sum() == 2


def test_up_axis_from_the_poses_even_where_the_header_lies(tmp_path: Path):
    y_up = standing()[..., [1, 2, 0]]
    recording = read_c3d(write(tmp_path / "a.c3d", y_up, screen="+Z"))
    assert recording.source.up == "y"
    assert any("although the file says z" in note for note in recording.notes)
    assert recording.position[0, 0, 2] == pytest.approx(1.68)


def test_a_unit_that_cannot_be_a_body_s_is_replaced_and_noted(tmp_path: Path):
    recording = read_c3d(write(tmp_path / "a.c3d", standing(), unit="m"))
    assert recording.source.unit == "mm"
    assert any("unit guessed as mm" in note for note in recording.notes)
    told = read_c3d(write(tmp_path / "b.c3d", standing() / 10, unit="mm"), unit="cm", up="z")
    assert told.position[0, 0, 2] == pytest.approx(1.68)
    assert told.notes == recording.notes[:2]


def test_a_header_that_claims_gigabytes_is_refused_before_allocation(tmp_path: Path):
    path = write(tmp_path / "a.c3d", standing())
    content = bytearray(path.read_bytes())
    content[2:4] = struct.pack("<H", 60000)
    content[6:10] = struct.pack("<2H", 1, 65535)
    path.write_bytes(content)
    with pytest.raises(UnsafeInputError, match="65535 frames of 60000 points"):
        read_c3d(path)


def test_truncated_empty_and_foreign_files(tmp_path: Path):
    path = write(tmp_path / "a.c3d", standing(frames=400))
    whole = path.read_bytes()
    for content, match in (
        (whole[: len(whole) // 2], "cut short"),
        (b"", "empty"),
        (b"HIERARCHY" * 400, "not a C3D"),
        (b"\x02\x50" + b"\xff" * 2000, "."),
    ):
        path.write_bytes(content)
        with pytest.raises(InputError, match=match):
            read_c3d(path)
    with pytest.raises(InputError, match="no such file"):
        read_c3d(tmp_path / "missing.c3d")


def test_damaged_bytes_never_escape_as_anything_but_input_errors(tmp_path: Path):
    path = write(tmp_path / "a.c3d", standing())
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    for _ in range(60):
        content = bytearray(whole)
        for at in rng.integers(0, min(len(whole), 1200), 8):
            content[at] = rng.integers(256)
        path.write_bytes(content)
        try:
            read_c3d(path)
        except InputError:
            continue


@pytest.mark.parametrize(
    ("labels", "says"),
    [
        ([f"L{name}Angles" for name in "abcdefgh"], "8 model outputs"),
        ([f"*{i}" for i in range(8)], "8 unnamed points"),
        ([""] * 8, "8 unnamed points"),
    ],
)
def test_points_that_are_no_markers_are_an_error_that_says_so(
    tmp_path: Path, labels: list[str], says: str
):
    with pytest.raises(InputError, match=f"none of the file's 8 points .* {says}"):
        read_c3d(write(tmp_path / "a.c3d", standing(), labels=labels))


@pytest.mark.parametrize("rotations", [True, False])
def test_files_without_points_say_what_they_hold(tmp_path: Path, rotations: bool):
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["RATE"]["value"] = [100]
    file["data"]["points"] = np.zeros((4, 0, 5))
    if rotations:  # as Theia writes them
        for name, value in (("LABELS", ["pelvis_4X4"]), ("RATE", [100.0]), ("USED", [1])):
            file.add_parameter("ROTATION", name, value)
        file.add_parameter("ROTATION", "RATIO", [1])
        file["data"]["rotations"] = np.tile(np.eye(4)[:, :, None, None], (1, 1, 1, 5))
    else:
        file["parameters"]["ANALOG"]["RATE"]["value"] = [1000]
        file["parameters"]["ANALOG"]["LABELS"]["value"] = ["emg"]
        file["data"]["analogs"] = np.zeros((1, 1, 50))
    file.write(str(tmp_path / "a.c3d"))
    with pytest.raises(InputError, match="rotations of segments" if rotations else "no points"):
        read_c3d(tmp_path / "a.c3d")


@pytest.mark.data
def test_plates_carry_the_body(data: Path):
    recording = read_c3d(data / "c3d/Movement_trial.c3d")
    assert len(recording.labels) == 39
    assert len(recording.plates) == 4
    heights = [plate.corners[:, 2].mean() for plate in recording.plates]
    np.testing.assert_allclose(heights, [0, 0.195, 0.389, 0.584], atol=2e-3)  # a staircase
    for plate in recording.plates:
        assert plate.time[-1] == pytest.approx(recording.time[-1], abs=0.02)
        assert 500 < plate.force[:, 2].max() < 2000
        loaded = plate.force[:, 2] > 200
        low, high = plate.corners[:, :2].min(axis=0), plate.corners[:, :2].max(axis=0)
        inside = (plate.point[loaded, :2] > low) & (plate.point[loaded, :2] < high)
        assert inside.mean() > 0.95
