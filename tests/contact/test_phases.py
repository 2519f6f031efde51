from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from physretarget.contact import Phases, read_phases, write_phases
from physretarget.contact.phases import from_intervals
from physretarget.errors import InputError
from physretarget.kinematics import runs

NAMES = ("left_toe", "right_heel", "pelvis")


def test_runs():
    assert runs(np.array([1, 1, 0, 0, 1], dtype=bool)) == [(0, 1), (4, 4)]
    assert runs(np.zeros(3, dtype=bool)) == []
    assert runs(np.zeros(0, dtype=bool)) == []


@given(
    active=st.lists(st.tuples(*[st.booleans()] * 3), min_size=2, max_size=60),
    fps=st.sampled_from([24.0, 30.0, 59.94, 120.0]),
)
def test_what_is_written_is_read(tmp_path_factory, active, fps):
    path = tmp_path_factory.mktemp("phases") / "contacts.toml"
    time = np.arange(len(active)) / fps
    phases = Phases(NAMES, np.array(active), time)
    write_phases(phases, path)
    assert not list(path.parent.glob("*.part"))
    np.testing.assert_array_equal(read_phases(path, time=time).active, phases.active)
    alone = read_phases(path)
    assert alone.names == NAMES
    np.testing.assert_array_equal(alone.active, phases.active)


def test_sampled_at_other_times():
    time = np.arange(61) / 60.0
    phases = from_intervals([("left_toe", 0.2, 0.5)], time, NAMES)
    half = phases.at(time[::2])
    np.testing.assert_array_equal(half.active, phases.active[::2])
    later = phases.at(np.array([-1.0, 0.3, 9.0]))
    np.testing.assert_array_equal(later.active[:, 0], [False, True, False])
    assert not phases.of("left_heel").any()
    assert not phases.of(None).any()


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "by_hand.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_file_by_hand_needs_only_phases(tmp_path):
    path = written(tmp_path, '[[phase]]\npoint = "right_toe"\nstart = 0\nend = 1.5\n')
    phases = read_phases(path)
    assert phases.names == ("right_toe",)
    assert phases.active.all()
    assert phases.time[-1] == pytest.approx(1.5)


@pytest.mark.parametrize(
    ("text", "line", "says"),
    [
        ("[[phase]]\npoint = \n", 2, "TOML"),
        ('# a\n\n[[phase]]\npoint = "nose"\nstart = 0\nend = 1\n', 3, "nose"),
        ('[[phase]]\npoint = "head"\nstart = 0\n', 1, "end"),
        (
            '[[phase]]\npoint = "head"\nstart = 0\nend = 1\n'
            '[[phase]]\npoint = "head"\nstart = 2\nend = 1\n',
            5,
            "start",
        ),
        ('[[phase]]\npoint = "head"\nstart = -1\nend = nan\n', 1, "seconds"),
        ('[[phase]]\npoint = "head"\nstart = true\nend = 1\n', 1, "seconds"),
        ("feet = 2\n", None, "feet"),
        ('points = ["tail"]\n', None, "points"),
        ("fps = 0\n", None, "fps"),
        ("phase = 3\n", None, "list"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(tmp_path, text, line, says):
    with pytest.raises(InputError, match=says) as raised:
        read_phases(written(tmp_path, text))
    assert raised.value.line == line


def test_a_missing_file(tmp_path):
    with pytest.raises(InputError, match=r"none\.toml"):
        read_phases(tmp_path / "none.toml")


def test_an_empty_file_is_no_timetable(tmp_path: Path) -> None:
    path = tmp_path / "contacts.toml"
    path.write_text("")
    with pytest.raises(InputError, match="empty"):
        read_phases(path)
