"""Joints and markers whose names say nothing, told by a map: the same actor as with known names."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from physretarget.capture import inspect, load
from physretarget.capture.bvh import read_bvh
from physretarget.capture.name_map import load_map
from physretarget.capture.names import ROLES, recognise
from physretarget.errors import InputError

sys.path.insert(0, str(Path(__file__).parent))  # its neighbour, which other tests use as well
import walker


def strange_bvh(source: Path, folder: Path) -> tuple[Path, dict[str, str]]:
    """The file with joints that are numbered, and which of them plays which role."""
    recording = read_bvh(source)
    roles = recognise(recording.names, recording.parents).roles
    numbered = {name: f"Bone_{k:03d}" for k, name in enumerate(recording.names)}
    text = source.read_text(encoding="utf-8")
    text = re.sub(
        r"\b(ROOT|JOINT) (\S+)", lambda m: f"{m[1]} {numbered.get(m[2], m[2])}", text
    )  # fmt: skip
    path = folder / "strange.bvh"
    path.write_text(text, encoding="utf-8")
    return path, {r: numbered[recording.names[j]] for r, j in roles.items() if r in ROLES}


def toml(folder: Path, text: str) -> Path:
    path = folder / "names.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.data
def test_numbered_joints_give_the_same_actor(data: Path, tmp_path: Path) -> None:
    source = data / "bvh" / "bandai" / "dataset-1_walk_normal_001.bvh"
    path, roles = strange_bvh(source, tmp_path)
    with pytest.raises(InputError, match="recognised"):
        load(path)
    told = "[joints]\n" + "\n".join(f'{role} = "{name}"' for role, name in roles.items())
    names = toml(tmp_path, told)
    plain, mapped = load(source), load(path, map=names)
    np.testing.assert_allclose(mapped.qpos, plain.qpos, atol=1e-6)
    assert mapped.source.unit == plain.source.unit
    parts = {part.name: part.meaning for part in inspect(path, map=names).parts}
    assert parts["left_shank"] == "left_shank"


def test_numbered_markers_give_the_same_actor(tmp_path: Path) -> None:
    """All but two markers are numbered, and one that is not bears another's name."""
    position = walker.markers()
    plain = load(walker.write_trc(tmp_path / "plain.trc", walker.CMU, position))
    labels = [f"M{k:02d}" for k in range(len(walker.CMU))]
    wrong = walker.CMU.index("LHEE")
    labels[wrong] = "LKNE"  # a lie that the map corrects
    path = walker.write_trc(tmp_path / "strange.trc", labels, position)
    marks = walker.recognise(walker.CMU)
    lines = ["[markers]"]
    for label, mark in zip(labels, marks, strict=True):
        assert mark is not None
        lines.append(f'{mark.name.replace(" ", "_")} = "{label}"')
    mapped = load(path, map=toml(tmp_path, "\n".join(lines)))
    np.testing.assert_allclose(mapped.qpos, plain.qpos, atol=1e-9)


def test_ignored_markers_are_not_used(tmp_path: Path) -> None:
    position = walker.markers()
    knee = walker.CMU.index("LKNE")
    position[:, knee] += [0.0, 0.35, 0.0]  # a cap that was put on a table leg
    path = walker.write_trc(tmp_path / "a.trc", walker.CMU, position)
    ignoring = load(path, map=toml(tmp_path, '[markers]\nignore = ["LKNE"]'))
    truth = load(walker.write_trc(tmp_path / "b.trc", walker.CMU, walker.markers()))
    assert np.abs(ignoring.qpos[:, :3] - truth.qpos[:, :3]).max() < 0.02
    assert ignoring.marker_error_rms < 0.015


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('[joints]\nleft_shin = "a"', r"joints.left_shin is no part of the body.*left_shank"),
        ('[markers]\nleft_knee = "a"', r"left_knee_lateral"),
        ('[markers]\nleft_asis = "M1"\nright_asis = "M1"', r"'M1' is given as markers.left_asis"),
        ("[markers]\nleft_asis = 3", "must be a name in quotes"),
        ('[bones]\na = "b"', r"\[joints\] and \[markers\]"),
        ("[joints", "is no TOML"),
        ('[markers]\nignore = "M1"', "a list of labels"),
        ('[markers]\nleft_asis = "LASJ"', r"'LASJ' is not in the capture, which has LASI"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, text: str, words: str) -> None:
    path = walker.write_trc(tmp_path / "a.trc", walker.CMU, walker.markers(seconds=0.5))
    names = toml(tmp_path, text)
    with pytest.raises(InputError, match=words) as caught:
        load(path, map=names)
    assert str(names) in str(caught.value)


@pytest.mark.data
def test_a_joint_that_hangs_elsewhere_is_refused(data: Path, tmp_path: Path) -> None:
    path, roles = strange_bvh(
        data / "bvh" / "bandai" / "dataset-1_walk_normal_001.bvh", tmp_path
    )  # fmt: skip
    roles["left_shank"], roles["right_foot"] = roles["right_foot"], roles["left_shank"]
    told = "[joints]\n" + "\n".join(f'{role} = "{name}"' for role, name in roles.items())
    with pytest.raises(InputError, match="cannot be the"):
        load(path, map=toml(tmp_path, told))


def test_every_landmark_can_be_told(tmp_path: Path) -> None:
    """Each label that stands for a landmark is read as that landmark."""
    from physretarget.capture.marker_sets import known_landmarks, recognise

    for landmark, label in known_landmarks().items():
        found = recognise(["LASI", "RASI", "SACR", label])[-1]
        assert found is not None
        assert found.name == landmark
    path = toml(tmp_path, "".join(["[markers]\n", *(
        f'{name.replace(" ", "_")} = "x{k}"\n' for k, name in enumerate(known_landmarks())
    )]))  # fmt: skip
    assert len(load_map(path).markers) == len(known_landmarks())
