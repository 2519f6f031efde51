from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from physretarget.capture.amc import read_amc
from physretarget.errors import InputError

ASF = """# made by hand
:version 1.10
:name tiny
:units
  mass 1.0
  length 0.45
  angle deg
:root
  order TX TY TZ RX RY RZ
  axis XYZ
  position 0 0 0
  orientation 0 0 0
:bonedata
  begin
    id 1
    name upper
    direction 0 -1 0
    length 2
    axis 0 0 90 XYZ
    dof rx rz
    limits (-10 10)
           (-10 10)
  end
  begin
    id 2
    name lower
    direction 0 -1 0
    length 3
    axis 0 0 0 XYZ
  end
:hierarchy
  begin
    root upper
    upper lower
  end
"""
AMC = """#!OML:ASF tiny.asf
:FULLY-SPECIFIED
:DEGREES
1
root 1 2 3 0 0 0
upper 0 0
2
root 1 2 3 0 90 0
upper 90 0
"""
INCH = 0.0254 / 0.45


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "tiny.asf").write_text(ASF)
    (tmp_path / "tiny_01.amc").write_text(AMC)
    return tmp_path


def test_values_by_hand(folder: Path) -> None:
    got = read_amc(folder / "tiny_01.amc", up="y")
    assert got.names == ("root", "upper", "lower")
    assert got.source.unit == "cmu"
    # file (x, y, z) stands at world (z, x, y)
    np.testing.assert_allclose(got.position[0, 2], np.array([3, 1, 0]) * INCH, atol=1e-9)
    # upper turns by 90 about its own x, which "axis" makes the file's y: straight down stays
    np.testing.assert_allclose(got.position[1, 2], np.array([3, 1, 0]) * INCH, atol=1e-9)
    joint, offset = got.end_sites["lower_end"]
    assert got.names[joint] == "lower"
    np.testing.assert_allclose(offset, np.array([0, -3, 0]) * INCH)
    # rest pose: all joint frames equal
    np.testing.assert_allclose(got.rotation[0, 1], got.rotation[0, 0], atol=1e-12)
    assert any("tiny.asf" in note for note in got.notes)
    assert any("120" in note for note in got.notes)


def test_the_skeleton_beside_is_found_by_name(folder: Path) -> None:
    (folder / "other.asf").write_text("junk")
    assert read_amc(folder / "tiny_01.amc").names[1] == "upper"


def test_without_a_skeleton_the_error_says_what_is_needed(folder: Path) -> None:
    (folder / "tiny.asf").unlink()
    with pytest.raises(InputError, match="needs its ASF"):
        read_amc(folder / "tiny_01.amc")
    with pytest.raises(InputError, match="does not exist"):
        read_amc(folder / "tiny_01.amc", skeleton=folder / "gone.asf")


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("upper 90 0\n", "", 7, "missing"),
        ("upper 90 0", "upper 90", 9, "2 values"),
        ("upper 90 0", "upper 90 x", 9, "number"),
        ("upper 90 0", "upper 90 1e300", 9, "too large"),
        ("upper 90 0", "uper 90 0", 9, "not in the skeleton"),
        ("upper 90 0", "upper 90 0\nupper 90 0", 10, "twice"),
        ("1\nroot 1 2 3 0 0 0", "root 1 2 3 0 0 0", 4, "before the first"),
    ],
)
def test_a_broken_motion_is_said_with_its_line(
    folder: Path, old: str, new: str, line: int, words: str
) -> None:
    path = folder / "tiny_01.amc"
    path.write_text(AMC.replace(old, new, 1))
    with pytest.raises(InputError, match=words) as caught:
        read_amc(path)
    assert caught.value.line == line


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("upper lower", "upper nobody", "unknown bone"),
        ("upper lower", "", "hangs from nothing"),
        ("upper lower", "upper lower\n lower upper", "two parents"),
        ("axis 0 0 90 XYZ", "axis 0 0 90 XXZ", "order"),
        ("dof rx rz", "dof rx rq", "degrees of freedom"),
        ("direction 0 -1 0", "direction 0 -1", "Three"),
        ("length 0.45", "length 0", "no size"),
        ("name lower", "name upper", "two of one name"),
    ],
)
def test_a_broken_skeleton_is_an_input_error(folder: Path, old: str, new: str, words: str) -> None:
    (folder / "tiny.asf").write_text(ASF.replace(old, new))
    with pytest.raises(InputError, match=words):
        read_amc(folder / "tiny_01.amc")


@pytest.mark.parametrize("which", ["tiny.asf", "tiny_01.amc"])
def test_truncation_never_gives_anything_but_an_input_error_or_fewer_frames(
    folder: Path, which: str
) -> None:
    text = (folder / which).read_text()
    for cut in range(0, len(text), 3):
        (folder / which).write_text(text[:cut])
        try:
            got = read_amc(folder / "tiny_01.amc")
        except InputError:
            continue
        assert np.isfinite(got.position).all()


@pytest.mark.data
def test_the_real_motion_has_rigid_bones(data: Path) -> None:
    got = read_amc(data / "bvh" / "cmu" / "11_01.amc")
    at = {name: i for i, name in enumerate(got.names)}
    knee, ankle = got.position[:, at["ltibia"]], got.position[:, at["lfoot"]]
    length = np.linalg.norm(knee - ankle, axis=1)
    np.testing.assert_allclose(length, 7.80828 * INCH, rtol=1e-5)
    assert got.source.up == "y"
