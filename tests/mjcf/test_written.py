"""Points written into an MJCF text: the text around them stays, MuJoCo sees them where they are."""

from __future__ import annotations

import difflib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from physretarget.errors import InputError
from physretarget.mjcf import Character
from physretarget.mjcf.written import drop_point, put_point

TEXT = """<?xml version="1.0"?>
<mujoco model="box">
  <!-- a "quoted" > comment -->
  <worldbody>
    <body name="trunk" pos="0 0 1">
      <freejoint/>
      <geom name="a>b" size=".1"/>
      <!-- what stands -->
      <site name="contact_left_toe" size="0.01" pos="0.1 0 -0.1"/>
      <body name='arm'><joint/><geom size=".05" pos="0.2 0 0"/></body>
    </body>
  </worldbody>
  <custom>
    <text name="contact_left_toe" data="left_toe"/>
  </custom>
</mujoco>
"""


def changed(new: str, old: str = TEXT) -> list[str]:
    lines = difflib.ndiff(old.splitlines(), new.splitlines())
    return [line[0] + line[1:].strip() for line in lines if line[0] in "+-"]


def test_a_new_point_adds_two_lines_and_changes_none() -> None:
    new = put_point(TEXT, name="contact_head", body="arm", place=[0.1, -0.25, 1e-3], tie="head")
    assert [line[0] for line in changed(new)].count("-") <= 1  # the arm's one line is broken up
    character = Character.from_xml(new)
    at = character.contacts.names.index("contact_head")
    assert character.model.body(character.contacts.body[at]).name == "arm"
    np.testing.assert_allclose(character.contacts.local[at], [0.1, -0.25, 1e-3], atol=1e-9)
    assert character.tied[at] == "head"


def test_a_point_that_stays_on_its_body_is_moved_in_its_line() -> None:
    new = put_point(TEXT, name="contact_left_toe", body="trunk", place=[0, 0, -0.1], tie="left_toe")
    assert changed(new) == [
        '-<site name="contact_left_toe" size="0.01" pos="0.1 0 -0.1"/>',
        '+<site name="contact_left_toe" pos="0 0 -0.1" size="0.01"/>',
    ]


def test_a_point_moves_to_another_body_with_its_look() -> None:
    new = put_point(TEXT, name="contact_left_toe", body="arm", place=[0, 0, 0])
    character = Character.from_xml(new)
    assert character.model.body(character.contacts.body[0]).name == "arm"
    assert float(character.model.site("contact_left_toe").size[0]) == 0.01
    assert character.tied == (None,)
    assert "what stands" in new


def test_dropping_what_was_put_gives_the_text_again() -> None:
    new = put_point(TEXT, name="contact_head", body="trunk", place=[0, 0, 0], tie="head")
    assert drop_point(new, "contact_head") == TEXT
    assert drop_point(TEXT, "contact_tail") == TEXT


def test_a_text_without_custom_gets_one() -> None:
    bare = TEXT[: TEXT.index("  <custom>")] + "</mujoco>\n"
    new = put_point(bare, name="contact_head", body="trunk", place=[0, 0, 0], tie="head")
    assert "head" in Character.from_xml(new).tied


def test_a_body_of_another_file_is_named() -> None:
    with pytest.raises(InputError, match="'tail' has no tag of its own"):
        put_point(TEXT, name="contact_head", body="tail", place=[0, 0, 0])


def test_broken_xml_is_named_with_its_line() -> None:
    with pytest.raises(InputError, match="broken XML") as caught:
        put_point("<mujoco>\n<body", name="contact_a", body="b", place=[0, 0, 0])
    assert caught.value.line == 2


@given(
    st.lists(
        st.tuples(
            st.sampled_from(["contact_a", "contact_b", "contact_left_toe"]),
            st.sampled_from(["trunk", "arm"]),
            st.tuples(*[st.floats(-1, 1)] * 3),
            st.sampled_from([None, "head", "left_toe"]),
        ),
        max_size=6,
    )
)
def test_whatever_is_put_mujoco_finds_the_last_of(
    put: list[tuple[str, str, tuple[float, float, float], str | None]],
) -> None:
    text, last = TEXT, {}
    for name, body, place, tie in put:
        text = put_point(text, name=name, body=body, place=place, tie=tie)
        last[name] = (body, place, tie)
    character = Character.from_xml(text)
    for at, name in enumerate(character.contacts.names):
        if name in last:
            body, place, tie = last[name]
            assert character.model.body(character.contacts.body[at]).name == body
            np.testing.assert_allclose(character.contacts.local[at], place, atol=1e-5)
            assert character.tied[at] == tie
    assert "a>b" in text
    assert "<!-- what stands -->" in text
