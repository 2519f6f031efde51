"""What an option takes, what it refuses, and that the refusal says what is allowed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from physretarget.errors import UsageError
from physretarget.options import SCHEMAS, build, check, find, option, options_of, read


@dataclass(frozen=True, kw_only=True)
class Sample:
    """One option of every kind."""

    rate: float | None = option(None, help="A rate.", unit="Hz", above=0, most=100)
    filter_hz: float | None = option(
        6.0, name="filter", help="0 for none.", unit="Hz", above=0, zero_for_none=True,
        aliases=("smooth",),
    )  # fmt: skip
    count: int = option(3, help="How many.", least=1, most=9)
    shape: Literal["round", "square"] = option("round", help="The shape.")
    unit: str = option("m", help="The unit.", choices=("m", "cm"), or_metres=True)
    source: str = option("gp", help="A name or a file.", choices=("gp",), or_file=".npz")
    loud: bool = option(False, help="Loud.")
    codes: tuple[str, ...] = option((), help="Codes.")
    limits: Mapping[str, Mapping[str, float]] = option({}, help="Limits.")
    file: Path | None = option(None, help="A file.")

    def __post_init__(self) -> None:
        check(self)


OPTIONS = options_of(Sample)
GOOD: list[tuple[str, Any, str]] = [  # name, value as TOML and JSON have it, as it is typed
    ("rate", 0.5, "0.5"),
    ("filter", 0.0, "0"),
    ("smooth", 5.0, "5"),
    ("count", 9, "9"),
    ("shape", "square", "square"),
    ("unit", "0.0254", "0.0254"),
    ("unit", "cm", "cm"),
    ("source", "a.NPZ", "a.NPZ"),
    ("codes", ("DYN", "CON1"), "DYN,CON1"),
    ("limits", {"DYN001": {"error": 0.5, "warning": 0.1}}, "DYN001.error=0.5,DYN001.warning=0.1"),
]
BAD: list[tuple[str, Any, str]] = [  # name, value, what the refusal says
    ("rate", 0, "rate is 0; it must be a number above 0 and at most 100 Hz."),
    ("rate", 100.5, "above 0 and at most 100 Hz"),
    ("rate", math.nan, "rate is nan"),
    ("rate", True, "it must be a number"),
    ("rate", "5", "it must be a number"),
    ("filter", -1, "filter is -1; it must be a number of 0 Hz or more."),
    ("smooth", -1, "smooth is -1"),
    ("count", 0, "count is 0; it must be a whole number from 1 to 9."),
    ("count", 2.5, "a whole number"),
    ("shape", "oval", "shape is 'oval'; it must be one of round, square."),
    ("unit", "furlong", "one of m, cm, or metres per unit as a number."),
    ("unit", "1e9", "metres per unit"),
    ("source", "a.csv", "one of gp, or a file that ends in .npz."),
    ("loud", "yes", "true or false"),
    ("codes", [1], "it must be a text"),
    ("limits", {"DYN001": {"error": "x"}}, "limits.DYN001.error is 'x'; it must be a number."),
    ("limits", 3, "CODE.NAME=number"),
    ("file", "", "a path"),
    ("raet", 1, "there is no option 'raet': did you mean 'rate'?"),
]


@pytest.mark.parametrize(("name", "value", "typed"), GOOD)
def test_what_is_typed_and_what_is_written_in_a_file_mean_the_same(
    name: str, value: Any, typed: str
) -> None:
    entry = find(name, OPTIONS)
    assert read({name: value}, OPTIONS) == {entry.name: value}
    assert entry.parse(typed) == value
    build(Sample, {entry.name: value})


@pytest.mark.parametrize(("name", "value", "says"), BAD)
def test_what_is_refused_is_refused_in_one_sentence(name: str, value: Any, says: str) -> None:
    with pytest.raises(UsageError) as refused:
        read({name: value}, OPTIONS)
    assert says in str(refused.value)
    assert str(refused.value).endswith(".")


@pytest.mark.parametrize(("field", "value"), [("rate", 0.0), ("filter_hz", 0.0), ("count", 10),
                                              ("shape", "oval"), ("unit", "ell")])  # fmt: skip
def test_settings_made_in_python_are_held_to_the_same(field: str, value: Any) -> None:
    with pytest.raises(UsageError, match=field):
        Sample(**{field: value})


def test_nought_and_nothing() -> None:
    assert build(Sample, {"filter": 0.0}).filter_hz is None
    assert build(Sample, {}).filter_hz == 6.0
    assert Sample(filter_hz=None).filter_hz is None
    assert read({"filter": None}, OPTIONS) == {}


ANY = st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=9)) | (
    st.lists(st.text(max_size=5), max_size=3)
    | st.dictionaries(st.text(max_size=5), st.floats() | st.text(max_size=5), max_size=3)
)


@given(st.data())
def test_whatever_is_given_is_read_or_refused(data: st.DataObject) -> None:
    """Nothing else than UsageError comes out of it, and what is read is read again unchanged."""
    schema = data.draw(st.sampled_from(SCHEMAS))
    entry = data.draw(st.sampled_from(schema.command_line))
    with suppress(UsageError):
        value = entry.read(data.draw(ANY))
        assert entry.read(value) == value


@given(st.data())
def test_whatever_is_typed_is_read_or_refused(data: st.DataObject) -> None:
    schema = data.draw(st.sampled_from(SCHEMAS))
    entry = data.draw(st.sampled_from(schema.command_line))
    typed = data.draw(st.text(min_size=1, max_size=9) | st.floats().map(str))
    with suppress(UsageError):
        value = entry.parse(typed)
        assert entry.read(value) == value
