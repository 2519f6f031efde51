from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from physretarget.suite.compare import State, Tolerance, badness, compare


def state(
    address: str = "now", *, errors: dict[str, int] | None = None, unit: str = "m", **values: Any
) -> State:
    return State(
        address=address,
        status="ok",
        measures={name: {"value": value, "unit": unit} for name, value in values.items()},
        findings={c: {"errors": n, "warnings": 0} for c, n in (errors or {}).items()},
    )


BAD = State(address="bad", status="errored", message="no clip")


@pytest.mark.parametrize(
    ("now", "before", "verdict", "blocking"),
    [
        (state(), None, "new", False),
        (state(errors={"CON001": 2}), None, "new", False),  # young: nothing was accepted
        (BAD, None, "errored", False),
        (BAD, state("old"), "errored", True),
        (BAD, BAD, "errored", False),
        (None, state("old"), "missing", True),
        (state("same"), state("same"), "same", False),
        (state(), BAD, "fixed", False),
        (state(), state("old", errors={"CON001": 1}), "fixed", False),
        (state(errors={"CON001": 1}), state("old"), "worse", True),
        (state(errors={"CON001": 1}), state("old", errors={"DYN001": 1}), "worse", True),
        (state(depth=0.2), state("old", depth=0.1), "worse", True),
        (state(depth=0.1), state("old", depth=0.2), "better", False),
        (state(depth=0.1009), state("old", depth=0.1), "same", False),
        (state(depth=None), state("old", depth=0.1), "same", False),
    ],
)
def test_verdicts(now: State | None, before: State | None, verdict: str, blocking: bool) -> None:
    found = compare(now, before)
    assert (found.verdict, found.blocking) == (verdict, blocking)


def test_a_slow_drift_is_caught() -> None:
    """Every night 1 % more: never worse than yesterday, but worse than what was accepted."""
    accepted, value, nights = state("old", depth=0.1), 0.1, []
    for night in range(20):
        yesterday, value = value, value * 1.01
        now = state(f"n{night}", depth=value)
        assert compare(now, state("y", depth=yesterday)).verdict == "same"
        nights.append(compare(now, accepted).verdict)
    assert nights[0] == "same"
    assert nights[-1] == "worse"


@pytest.mark.parametrize(
    ("name", "before", "now", "verdict"),
    [
        ("required_force_vertical_min_bw", -0.5, 0.0, "better"),  # higher is better
        ("required_force_vertical_min_bw", 0.0, -0.5, "worse"),
        ("required_force_vertical_mean_bw", 0.8, 1.0, "better"),  # nearer to 1 is better
        ("required_force_vertical_mean_bw", 1.2, 1.0, "better"),
        ("required_force_vertical_mean_bw", 1.0, 0.8, "worse"),
        ("flight_frames_fraction", 0.1, 0.6, "same"),  # choreography
        ("skate_speed_max_m_s", 0.1, 0.6, "worse"),
    ],
)
def test_each_measure_has_its_direction(name: str, before: float, now: float, verdict: str) -> None:
    found = compare(state(**{name: now}, unit="BW"), state("old", **{name: before}, unit="BW"))
    assert found.verdict == verdict


def test_tolerances_can_be_set() -> None:
    now, before = state(depth=0.2), state("old", depth=0.1)
    assert compare(now, before, {"depth": {"absolute": 1.0}}).verdict == "same"
    assert compare(now, before, {"depth": {"direction": "none"}}).verdict == "same"
    assert compare(now, before, {"depth": {"direction": "higher"}}).verdict == "better"


def test_the_worst_change_comes_first() -> None:
    found = compare(state(a=0.2, b=0.5, c=0.01), state("old", a=0.1, b=0.1, c=0.1))
    assert [c.name for c in found.changes] == ["b", "a", "c"]
    assert "and 1 more" in found.reason


@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.sampled_from(["m", "BW", "1", ""]))
def test_better_and_worse_are_mirror_images(a: float, b: float, unit: str) -> None:
    """Swapping the clips swaps the verdict, but for the tolerance's share of the baseline."""
    forth = compare(state("x", v=a, unit=unit), state("y", v=b, unit=unit)).verdict
    back = compare(state("y", v=b, unit=unit), state("x", v=a, unit=unit)).verdict
    assert (forth, back) != ("worse", "worse")
    assert (forth, back) != ("better", "better")
    if a == b:
        assert forth == back == "same"


@given(st.floats(-10, 10))
def test_badness_grows_toward_bad(value: float) -> None:
    assert badness(value + 1, Tolerance()) > badness(value, Tolerance())
    up = Tolerance(direction="higher")
    assert badness(value + 1, up) < badness(value, up)
    assert badness(1.0, Tolerance(direction="one")) == 0.0
