from __future__ import annotations

import contextlib
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from physretarget.capture.bvh import read_bvh
from physretarget.capture.recording import JointRecording
from physretarget.errors import InputError

MINIMAL = """HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Spine: the 1st
  {
    OFFSET 0 10 0
    CHANNELS 1 Xrotation
    End Site
    {
      OFFSET 0 5 0
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.0333333
1 2 3 0 0 0 0
1 2 3 0 0 90 90
"""


@pytest.fixture
def write(tmp_path: Path):
    def put(text: str | bytes) -> Path:
        path = tmp_path / "clip.bvh"
        path.write_bytes(text.encode() if isinstance(text, str) else text)
        return path

    return put


def test_values_by_hand(write) -> None:
    got = read_bvh(write(MINIMAL), unit="cm", up="y")
    assert got.names == ("Hips", "Spine: the 1st")
    assert got.parents == (-1, 0)
    assert got.source.fps == 30.0
    np.testing.assert_allclose(got.time, [0, 1 / 30])
    # y up becomes z up: file (x, y, z) stands at world (z, x, y)
    np.testing.assert_allclose(got.position[0], [[0.03, 0.01, 0.02], [0.03, 0.01, 0.12]])
    joint, offset = got.end_sites["Spine: the 1st_end"]
    tip = got.position[:, joint] + got.rotation[:, joint] @ offset
    # frame 1: Ry(90) Rx(90) takes y to z and then to x (file), which is the world's y
    np.testing.assert_allclose(tip[1], [0.03, 0.06, 0.12], atol=1e-9)


def test_line_ends_tabs_and_blank_lines_do_not_matter(write) -> None:
    plain = read_bvh(write(MINIMAL), unit="cm", up="y")
    mangled = MINIMAL.replace("  ", "\t").replace("\n", "\r\n\r\n").replace("Frames: ", "Frames:\t")
    got = read_bvh(write("\ufeff" + mangled), unit="cm", up="y")
    np.testing.assert_array_equal(got.position, plain.position)
    assert got.names == plain.names


def test_brace_on_the_name_s_line(write) -> None:
    text = MINIMAL.replace("ROOT Hips\n{", "ROOT Hips {")
    assert read_bvh(write(text), unit="cm").names[0] == "Hips"


@pytest.mark.parametrize("up", ["x", "y", "z"])
def test_turning_the_world_keeps_it_right_handed(write, up: str) -> None:
    got = read_bvh(write(MINIMAL), unit="m", up=up)
    np.testing.assert_allclose(np.linalg.det(got.rotation), 1.0)
    axis = "xyz".index(up)
    np.testing.assert_allclose(got.position[0, 0, 2], [1, 2, 3][axis])


def test_nan_is_kept_for_the_caller_to_judge(write) -> None:
    got = read_bvh(write(MINIMAL.replace("1 2 3 0 0 90 90", "1 nan 3 0 0 90 90")), unit="cm")
    assert np.isfinite(got.position[0]).all()
    assert np.isnan(got.position[1]).any()


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("MOTION\n", "", 20, "MOTION"),
        ("HIERARCHY\n", "", 1, "HIERARCHY"),
        ("Frames: 2", "Frames: 3", 21, "declared"),
        ("Frames: 2", "Frames: 2000000000", 21, "declared"),
        ("Frames: 2", "Frames: many", 17, "Frames"),
        ("0.0333333", "0", 18, "frame time"),
        ("0.0333333", "1e9", 18, "frame time"),
        ("0.0333333", "nan", 18, "frame time"),
        ("0.0333333", "30", 18, "0.0333333 for 30"),
        ("Frame Time: 0.0333333\n", "", 18, "Frame Time"),
        (" 0.0333333", "", 18, "Expected 'Frame Time"),
        ("1 2 3 0 0 90 90", "1 2 3 0 0 90", 20, "7 values"),
        ("1 2 3 0 0 90 90", "1 2 3 0 0 90 9O", 20, "number"),
        ("1 2 3 0 0 90 90", "1 2 3 0 0 90 inf", 20, "infinite"),
        ("1 2 3 0 0 90 90", "1 2 3 0 0 90 1e300", 20, "infinite"),
        ("CHANNELS 1 Xrotation", "CHANNELS 2 Xrotation", 9, "CHANNELS"),
        ("CHANNELS 1 Xrotation", "CHANNELS 1 Wrotation", 9, "channel"),
        ("OFFSET 0 10 0", "OFFSET 0 10", 8, "OFFSET"),
        ("OFFSET 0 10 0", "OFFSET 0 nan 0", 8, "OFFSET"),
        ("    OFFSET 0 10 0\n", "", 13, "OFFSET"),
        ("OFFSET 0 10 0", "OFFSETS 0 10 0", 8, "OFFSETS"),
        ("  }\n}\nMOTION", "}\nMOTION", 14, "truncated"),
        ("  }\n}\nMOTION", "  }\n}\n}\nMOTION", 16, "too many"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(
    write, old: str, new: str, line: int, words: str
) -> None:
    assert old in MINIMAL
    with pytest.raises(InputError) as caught:
        read_bvh(write(MINIMAL.replace(old, new)))
    assert caught.value.line == line
    assert words in caught.value.message
    assert "clip.bvh" in str(caught.value)


def test_truncation_anywhere_is_an_input_error(write) -> None:
    end = len(MINIMAL.rstrip())
    for cut in range(end - 1):
        if MINIMAL[:cut].rstrip().endswith("1 2 3 0 0 90 9"):
            continue  # the last number lost a digit: nobody could tell
        with pytest.raises(InputError):
            read_bvh(write(MINIMAL[:cut]))


@pytest.mark.parametrize("content", [b"", b"  \n\n", b"\x00" * 100, b"\xff\xfe\x00HIER"])
def test_no_bvh_at_all(write, content: bytes) -> None:
    with pytest.raises(InputError):
        read_bvh(write(content))


def test_added_position_channels_are_told_from_replacing_ones(write) -> None:
    text = MINIMAL.replace(
        "CHANNELS 1 Xrotation", "CHANNELS 4 Xposition Yposition Zposition Xrotation"
    )
    added = text.replace("0 0 0 0\n", "0 0 0 0 0.1 0 0\n").replace("90 90\n", "90 0 0.1 0 90\n")
    replaced = text.replace("0 0 0 0\n", "0 0 0 0 10 0 0\n").replace("90 90\n", "90 0 10 0 90\n")
    one, two = (read_bvh(write(t), unit="cm", up="y") for t in (added, replaced))
    np.testing.assert_allclose(one.position[0, 1], [0.03, 0.01, 0.121], atol=1e-9)
    np.testing.assert_allclose(two.position[0, 1], [0.03, 0.01, 0.12], atol=1e-9)
    assert any("added" in note for note in one.notes)


# ------------------------------------------------------------------------------- round trip

ORDERS = ["XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX", "XYX", "ZXZ"]


@st.composite
def skeletons(draw: st.DrawFn):
    count = draw(st.integers(1, 6))
    parents = [-1] + [draw(st.integers(0, j - 1)) for j in range(1, count)]
    orders = [draw(st.sampled_from(ORDERS)) for _ in range(count)]
    seed = draw(st.integers(0, 2**31))
    return parents, orders, draw(st.integers(1, 4)), seed


def bvh_text(parents, orders, offsets, moves, angles) -> str:
    """A writer: the tests' twin of the reader (recursive, one joint at a time)."""
    lines = ["HIERARCHY"]
    order: list[int] = []

    def joint(j: int, depth: int) -> None:
        pad = "\t" * depth
        order.append(j)
        lines.append(f"{pad}{'JOINT' if parents[j] >= 0 else 'ROOT'} joint {j}")
        lines.append(pad + "{")
        lines.append(f"{pad}\tOFFSET " + " ".join(map(repr, offsets[j].tolist())))
        turns = " ".join(f"{a}rotation" for a in orders[j])
        if parents[j] < 0:
            lines.append(f"{pad}\tCHANNELS 6 {turns} Zposition Xposition Yposition")
        else:
            lines.append(f"{pad}\tCHANNELS 3 {turns}")
        children = [k for k in range(len(parents)) if parents[k] == j]
        for k in children:
            joint(k, depth + 1)
        if not children:
            lines.append(f"{pad}\tEnd Site\n{pad}\t{{\n{pad}\t\tOFFSET 0 1 0\n{pad}\t}}")
        lines.append(pad + "}")

    joint(0, 0)
    lines += ["MOTION", f"Frames: {len(moves)}", "Frame Time: 0.01"]
    for t in range(len(moves)):
        row: list[float] = []
        for j in order:
            row += angles[t, j].tolist()
            if parents[j] < 0:
                row += moves[t][[2, 0, 1]].tolist()
        lines.append(" ".join(map(repr, row)))
    return "\n".join(lines)


@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(skeletons())
def test_round_trip_through_a_writer(write, skeleton) -> None:
    parents, orders, frames, seed = skeleton
    rng = np.random.default_rng(seed)
    offsets = rng.normal(size=(len(parents), 3))
    moves, angles = rng.normal(size=(frames, 3)), rng.uniform(-180, 180, (frames, len(parents), 3))
    path = write(bvh_text(parents, orders, offsets, moves, angles))
    got = read_bvh(path, unit="m", up="z")
    for j, parent in enumerate(parents):
        at = got.names.index(f"joint {j}")
        for t in range(frames):
            turn = Rotation.from_euler(orders[j], angles[t, j], degrees=True).as_matrix()
            if parent < 0:
                place = moves[t]
            else:
                above = got.names.index(f"joint {parent}")
                place = got.position[t, above] + got.rotation[t, above] @ offsets[j]
                turn = got.rotation[t, above] @ turn
            np.testing.assert_allclose(got.position[t, at], place, atol=1e-9)
            np.testing.assert_allclose(got.rotation[t, at], turn, atol=1e-9)


# ------------------------------------------------------------------------------------ garbage


def _sound(got: JointRecording) -> None:
    frames = len(got.time)
    assert frames >= 1
    assert got.position.shape == (frames, len(got.names), 3)
    assert got.rotation.shape == (frames, len(got.names), 3, 3)
    assert all(-1 <= parent < j for j, parent in enumerate(got.parents))
    assert not np.isinf(got.position).any()


words = st.sampled_from(
    [
        *MINIMAL.split(), "ROOT a", "JOINT b", "\n", "{", "}", "nan", "-1e999", "1e6", "9" * 30,
        "Zrotation", "CHANNELS 3 Xrotation Xrotation Xrotation", "End", "\x00", "é",
    ]
)  # fmt: skip


@settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(st.lists(words, max_size=60), st.integers(0, len(MINIMAL)))
def test_garbage_gives_an_input_error_or_a_sound_result(write, junk: list[str], at: int) -> None:
    text = MINIMAL[:at] + " ".join(junk) + MINIMAL[at:]
    with contextlib.suppress(InputError):
        _sound(read_bvh(write(text)))


@settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(st.data())
def test_damaged_lines_give_an_input_error_or_a_sound_result(write, data: st.DataObject) -> None:
    lines = MINIMAL.split("\n")
    for _ in range(data.draw(st.integers(1, 3))):
        i = data.draw(st.integers(0, len(lines) - 1))
        what = data.draw(st.sampled_from(["drop", "double", "swap", "junk"]))
        if what == "drop":
            lines[i] = ""
        elif what == "double":
            lines[i] = lines[i] + "\n" + lines[i]
        elif what == "swap":
            j = data.draw(st.integers(0, len(lines) - 1))
            lines[i], lines[j] = lines[j], lines[i]
        else:
            lines[i] = data.draw(st.text(max_size=30))
    with contextlib.suppress(InputError):
        _sound(read_bvh(write("\n".join(lines).encode("utf-8", "surrogatepass"))))


def test_forty_three_seconds_of_a_hundred_channels_are_read_in_a_second(write) -> None:
    rng = np.random.default_rng(0)
    parents = [-1, *range(31)]
    frames = 43 * 120
    angles = rng.uniform(-30, 30, (frames, 32, 3)).round(4)
    text = bvh_text(parents, ["ZXY"] * 32, rng.normal(size=(32, 3)), np.zeros((frames, 3)), angles)
    path = write(text)
    start = time.process_time()
    got = read_bvh(path, unit="cm", up="y")
    assert len(got.time) == frames
    assert time.process_time() - start < 1.0


# --------------------------------------------------------------------------------- real files


@pytest.mark.data
def test_every_real_file_is_read_and_its_unit_and_up_axis_found(data: Path) -> None:
    units = {"bandai": "cm", "cmu": "cmu", "reactidle": "m"}
    files = sorted((data / "bvh").glob("*/*.bvh"))
    assert len(files) >= 34
    for path in files:
        got = read_bvh(path)
        _sound(got)
        assert got.source.unit == units[path.parent.name]
        assert got.source.up == "y"
        assert any("guessed" in note for note in got.notes)
        assert np.isfinite(got.position).all()
