from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from physretarget.capture.mot import read_mot
from physretarget.capture.trc import read_trc
from physretarget.errors import InputError

LABELS = ("C7", "r.ASIS", "L_calc", "Odd")
PLACES = np.array([[0.0, 1.4, 0.1], [0.1, 0.9, 0.2], [0.0, 0.05, -0.1], [0.5, 0.5, 0.5]])


def text(frames: int = 5, unit: str = "m", scale: float = 1.0, promised: int | None = None) -> str:
    lines = [
        "PathFileType\t4\t(X/Y/Z)\tsome file.trc",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate",
        f"100\t100\t{promised or frames}\t{len(LABELS)}\t{unit}\t100",
        "Frame#\tTime\t" + "\t\t\t".join(LABELS) + "\t\t\t",
        "\t\t" + "\t".join(f"{c}{i + 1}" for i in range(len(LABELS)) for c in "XYZ"),
        "",
    ]
    for i in range(frames):
        values = (PLACES + np.array([0.01 * i, 0, 0])) * scale
        lines.append(f"{i + 1}\t{i / 100:.3f}\t" + "\t".join(f"{v:.6g}" for v in values.ravel()))
    return "\n".join(lines) + "\n"


def write(tmp_path: Path, content: str) -> Path:
    path = tmp_path / "a.trc"
    path.write_text(content)
    return path


def test_reads_metres_and_turns_y_up(tmp_path: Path):
    recording = read_trc(write(tmp_path, text()))
    assert recording.labels == LABELS
    assert (recording.source.unit, recording.source.up, recording.source.fps) == ("m", "y", 100)
    np.testing.assert_allclose(recording.position[0, :, 2], PLACES[:, 1], atol=1e-6)
    # Right-handed: distances and the handedness of any three axes survive.
    moved = recording.position[1] - recording.position[0]
    np.testing.assert_allclose(np.linalg.norm(moved, axis=1), 0.01, atol=1e-6)


def test_the_files_own_first_time_is_kept(tmp_path: Path):
    # A recording's time starts at 0; forces in another file are found by the file's own time.
    kept = text(frames=8, promised=3).split("\n")
    del kept[6:11]
    recording = read_trc(write(tmp_path, "\n".join(kept)))
    assert recording.time[0] == 0
    assert recording.source.start == pytest.approx(0.05)


def test_decimal_commas_are_read_as_points(tmp_path: Path):
    plain = read_trc(write(tmp_path, text()))
    head, rows = text().split("\n\n")
    got = read_trc(write(tmp_path, f"{head}\n\n{rows.replace('.', ',')}"))
    np.testing.assert_array_equal(got.position, plain.position)
    assert "decimal commas were read as points" in got.notes


def test_milliseconds_in_the_time_column_are_noticed(tmp_path: Path):
    lines = text().split("\n")
    for i in range(6, 11):
        number, seconds, rest = lines[i].split("\t", 2)
        lines[i] = f"{number}\t{1000 * float(seconds):g}\t{rest}"
    recording = read_trc(write(tmp_path, "\n".join(lines)))
    assert recording.source.fps == 100
    assert len(recording.time) == 5
    assert "the time column counts milliseconds" in recording.notes


def test_what_windows_prints_for_no_number_is_a_gap(tmp_path: Path):
    recording = read_trc(write(tmp_path, text().replace("\t1.4\t", "\t-1.#IND\t")))
    assert np.isnan(recording.position[:, 0]).all()
    assert np.isfinite(recording.position[:, 1:]).all()


@pytest.mark.parametrize("coding", ["utf-16", "utf-8-sig"])
def test_other_codings_and_cases(tmp_path: Path, coding: str):
    plain = read_trc(write(tmp_path, text()))
    path = tmp_path / "b.trc"
    path.write_bytes(text().replace("PathFileType", "PATHFILETYPE").encode(coding))
    np.testing.assert_array_equal(read_trc(path).position, plain.position)


@pytest.mark.parametrize(("unit", "scale"), [("mm", 1000), ("cm", 100), ("m", 1)])
def test_units(tmp_path: Path, unit: str, scale: float):
    recording = read_trc(write(tmp_path, text(unit=unit, scale=scale)))
    np.testing.assert_allclose(recording.position[0, :, 2], PLACES[:, 1], atol=1e-5)


def test_gaps_ragged_rows_and_windows_line_ends(tmp_path: Path):
    lines = text().split("\n")
    lines[7] = "2\t0.01\t\t\t\t0.1\t0.9\t0.2"  # first marker missing, the row stops early
    lines[8] = (
        "3\t0.02\t" + "\t".join(["0"] * 3 + ["0.1", "0.9", "0.2", "nan"] + ["1"] * 5) + "\t\t"
    )
    path = tmp_path / "a.trc"
    path.write_bytes("\r\n".join(lines).encode())
    missing = np.asarray(np.isnan(read_trc(path).position).all(axis=-1))
    assert missing[1].tolist() == [True, False, True, True]
    assert missing[2].tolist() == [True, False, True, False]


def test_labels_separated_by_spaces(tmp_path: Path):
    content = text().replace("\t\t\t", " ")
    assert read_trc(write(tmp_path, content)).labels == LABELS


def test_frames_that_the_clock_skips_have_no_markers(tmp_path: Path):
    lines = text(frames=8, promised=6).split("\n")
    del lines[9:11]
    recording = read_trc(write(tmp_path, "\n".join(lines)))
    missing = np.isnan(recording.position).all(axis=(1, 2))
    assert missing.tolist() == [False, False, False, True, True, False, False, False]
    assert any("2 frames" in note for note in recording.notes)


def test_rate_that_contradicts_the_clock(tmp_path: Path):
    recording = read_trc(write(tmp_path, text().replace("\n100\t100", "\n60\t60")))
    assert recording.source.fps == pytest.approx(100)
    assert any("rate taken from the time column" in note for note in recording.notes)


@pytest.mark.parametrize(
    ("change", "message", "line"),
    [
        (lambda t: "", "empty", None),
        (lambda t: "a\tb\n1\t2\n", "must begin with PathFileType", 1),
        (lambda t: "\n".join(t.split("\n")[:3]), "header is cut short", 3),
        (lambda t: t.replace("Frame#", "Bild"), "must begin with Frame#", 4),
        (lambda t: t.replace("\n100\t100\t5\t4", "\n100\t100\t5\t7"), "promises 7 markers", 4),
        (lambda t: t.replace("\n100\t", "\nfast\t"), "as numbers", 3),
        (lambda t: t.replace("\n3\t0.020\t0.02", "\n3\t0.020\tabc"), "'abc' is not a number", 9),
        (lambda t: t.replace("\n3\t0.020", "\n3\t0.020" + "\t1" * 9), "must have 14 cells", 9),
        (lambda t: "\n".join(t.split("\n")[:9]), "promises 5 frames and holds 3", 9),
        (lambda t: t.replace("\n3\t0.020", "\n3\t0.005"), "does not increase", None),
        (lambda t: "\n".join(t.split("\n")[:6]), "no frame after the header", None),
    ],
)
def test_errors_name_the_line(tmp_path: Path, change, message, line):
    with pytest.raises(InputError, match=message) as caught:
        read_trc(write(tmp_path, change(text())))
    assert line is None or caught.value.line == line


@given(st.integers(0, 2**32 - 1), st.integers(1, 12))
@settings(max_examples=80, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damaged_text_gives_a_recording_or_an_input_error(tmp_path: Path, seed: int, times: int):
    rng = np.random.default_rng(seed)
    content = list(text())
    for _ in range(times):
        content[rng.integers(len(content))] = str(rng.choice(list("\t\n 0-9e.nax#\x00é")))
    try:
        recording = read_trc(write(tmp_path, "".join(content)))
    except InputError:
        return
    assert recording.position.shape[1] == len(recording.labels)


MOT = """forces
nColumns=10
endheader
time\tground_force_1_vx\tground_force_1_vy\tground_force_1_vz\tground_force_1_px\tground_force_1_py\
\tground_force_1_pz\tground_force_1_mx\tground_force_1_my\tground_force_1_mz
0\t1\t700\t2\t0.1\t0.0\t0.2\t0\t5\t0
0.01\t1\t710\t2\t0.1\t0.0\t0.2\t0\t5\t0
"""


def test_forces_in_the_world(tmp_path: Path):
    path = tmp_path / "a.mot"
    path.write_text(MOT)
    (force,) = read_mot(path)
    assert force.name == "1"
    np.testing.assert_allclose(force.force[:, 2], [700, 710])
    np.testing.assert_allclose(force.torque[0], [0, 0, 5])
    assert force.point[0, 2] == 0


@pytest.mark.parametrize(
    "columns",
    [
        ("R_ground_force_vx", "R_ground_force_vy", "R_ground_torque_y"),
        ("1_ground_force_vx", "1_ground_force_vy", "1_ground_torque_y"),
        ("ground_force_vx", "ground_force_vy", "ground_torque_y"),
        ("ground_force_r_vx", "ground_force_r_vy", "ground_moment_r_my"),
    ],
)
def test_other_column_names(tmp_path: Path, columns):
    path = tmp_path / "a.sto"
    path.write_text("endheader\ntime\t" + "\t".join(columns) + "\n0\t3\t600\t7\n")
    (force,) = read_mot(path)
    np.testing.assert_allclose(force.force[0, 2], 600)
    np.testing.assert_allclose(force.torque[0, 2], 7)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("time\tx\n0\t1\n", "no endheader"),
        ("endheader\n", "no columns"),
        ("endheader\ntime\tx\n0\t1\n", "no ground force columns"),
        (MOT + "0.02\t1\n", "must have 10 numbers"),
        (MOT.replace("710", "x"), "not a number"),
    ],
)
def test_broken_force_tables(tmp_path: Path, content, message):
    path = tmp_path / "a.mot"
    path.write_text(content)
    with pytest.raises(InputError, match=message):
        read_mot(path)


@pytest.mark.data
def test_measured_forces_stand_under_the_measured_feet(data: Path):
    folder = data / "grf/opencap_subject4"
    recording = read_trc(folder / "squats1.trc")
    forces = read_mot(folder / "squats1_grf.mot", up=recording.source.up)
    total = sum(force.force[:, 2] for force in forces)
    assert np.median(total) == pytest.approx(589, rel=0.03)  # N, standing
    for side, force in (("L", forces[1]), ("r", forces[0])):
        heel = recording.position[:, recording.labels.index(f"{side}_calc"), :2]
        toe = recording.position[:, recording.labels.index(f"{side}_toe"), :2]
        other = recording.position[
            :, recording.labels.index("r_toe" if side == "L" else "L_toe"), :2
        ]
        foot = 0.5 * (heel + toe)
        distance = np.linalg.norm(force.point[:, :2] - foot, axis=1)
        assert np.median(distance) < 0.12
        assert np.median(np.linalg.norm(force.point[:, :2] - other, axis=1)) > 0.2
