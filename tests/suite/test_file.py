from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from physretarget.errors import InputError
from physretarget.suite.file import database_url, load_suite

WHOLE = """[suite]
name = "night"
history = "h.sqlite"

[[case]]
clips = ["a/*.csv", "b/*.npz"]
model = "g1.xml"
profile = "robot"
config = "rules.toml"
fps = 30
quat = "wxyz"
lowpass = 6
tags = ["walks"]
owner = "kim"

[[retarget]]
captures = "caps/*.bvh"
character = "lamp.xml"
keyposes = ["lamp.toml"]
mapper = "gp"
physics = "convex"
tags = ["lamp"]

[tolerance.skate_speed_max_m_s]
absolute = 0.5
direction = "lower"
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "night.toml"
    path.write_text(text)
    return path


def test_a_whole_file_is_read(tmp_path: Path) -> None:
    suite = load_suite(write(tmp_path, WHOLE))
    assert suite.history == f"sqlite:///{tmp_path / 'h.sqlite'}"
    case, retarget = suite.cases
    assert (case.name, case.kind, case.owner) == ("g1, robot", "validate", "kim")
    assert (case.given["fps"], case.given["lowpass"]) == (30.0, 6.0)
    assert case.given["config"] == tmp_path / "rules.toml"
    assert (retarget.kind, retarget.sources) == ("retarget", ("caps/*.bvh",))
    assert (retarget.given["mapper"], retarget.given["physics"]) == ("gp", "convex")
    assert retarget.given["keyposes"] == (tmp_path / "lamp.toml",)
    assert suite.tolerances == {"skate_speed_max_m_s": {"absolute": 0.5, "direction": "lower"}}


@pytest.mark.parametrize(
    ("change", "line", "words"),
    [
        (("owner =", "ownr ="), 14, "unknown key 'ownr': did you mean 'owner'?"),
        (('mapper = "gp"', "mapper = 3"), 20, "'mapper' is 3"),
        (('"robot"', '"android"'), 8, "animation, robot"),
        (("fps = 30", "fps = -1"), 10, "above 0"),
        (('model = "g1.xml"\n', ""), 5, "'model' is missing"),
        (("[[case]]", "[case]"), 5, "[[case]]"),
        (("absolute = 0.5", "abs = 0.5"), 25, "unknown key 'abs'"),
        (("[suite]", "speed = 1\n[suite]"), 1, "unknown key 'speed'"),
        (("[suite]", "[suits]"), 1, "unknown key 'suits'"),
        (('keyposes = ["lamp.toml"]', "keyposes = [1]"), 19, "a path"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(
    tmp_path: Path, change: tuple[str, str], line: int, words: str
) -> None:
    assert change[0] in WHOLE
    with pytest.raises(InputError) as caught:
        load_suite(write(tmp_path, WHOLE.replace(*change, 1)))
    assert words in str(caught.value)
    assert caught.value.line == line


def test_the_second_case_has_its_own_lines(tmp_path: Path) -> None:
    text = '[[case]]\nclips = "a"\nmodel = "m"\n\n[[case]]\nclips = "b"\nmodel = "m"\nfoo = 1\n'
    with pytest.raises(InputError, match="foo") as caught:
        load_suite(write(tmp_path, text))
    assert caught.value.line == 8


@pytest.mark.parametrize("text", ["", "[suite]\n", "x", "[[case]]\nclips = []\nmodel = 'm'\n"])
def test_useless_files_are_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(InputError):
        load_suite(write(tmp_path, text))


@given(st.text(max_size=200))
def test_any_text_is_read_or_refused(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    path = tmp_path_factory.mktemp("any") / "s.toml"
    path.write_text(text, encoding="utf-8", errors="replace")
    with pytest.raises(InputError):
        load_suite(path)


def test_histories_become_urls(tmp_path: Path) -> None:
    assert database_url("x.db", tmp_path) == f"sqlite:///{tmp_path}/x.db"
    assert database_url("sqlite:////x.db", tmp_path) == "sqlite:////x.db"
    assert database_url("postgresql://h/d", tmp_path) == "postgresql+psycopg://h/d"
