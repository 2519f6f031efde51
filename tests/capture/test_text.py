from __future__ import annotations

import pytest

from physretarget.capture.text import plain_numbers


@pytest.mark.parametrize(
    ("line", "plain"),
    [
        ("1.5 -2 3e-05", "1.5 -2 3e-05"),
        ("1,5 -2 3,1e-05", "1.5 -2 3.1e-05"),
        ("1,5;-,2;3", "1.5 -.2 3"),
        ("1.5;-2;3", "1.5 -2 3"),
        ("1,2,3", "1 2 3"),
        ("1.5,2.5", "1.5 2.5"),
        ("1, 2, 3", "1  2  3"),
    ],
)
def test_what_a_comma_is_follows_from_the_others(line: str, plain: str) -> None:
    (got,), _ = plain_numbers([line])
    assert got.split() == plain.split()


def test_it_is_decided_for_all_lines_at_once() -> None:
    lines, notes = plain_numbers(["1,2 3", "1.5 2"])
    assert [line.split() for line in lines] == [["1", "2", "3"], ["1.5", "2"]]
    assert notes == ()
    assert plain_numbers(["1,2 3", "1 2"])[1] == ("decimal commas were read as points",)
