"""What a curator reads first: verdicts before changes, and no green where nothing is known."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from physretarget.suite.compare import State
from physretarget.suite.records import Entry
from physretarget.suite.summaries import headline

STATES = {
    "good": State(address="good", status="ok"),
    "bad": State(address="bad", status="ok", findings={"DYN001": {"errors": 2, "warnings": 0}}),
    "lost": State(address="lost", status="errored", message="cannot be read"),
}


def entry(address: str, *, baseline: str | None = None, blocking: bool = False) -> Entry:
    return Entry(
        clip=f"{address}.csv", case_name="walks", kind="case", tags=(), owner="",
        verdict="worse" if blocking else "new" if baseline is None else "same",
        reason="", blocking=blocking, changes=(), address=address, baseline=baseline,
    )  # fmt: skip


def test_nothing_accepted_is_no_green() -> None:
    """52 of 62 fail and nothing was accepted: that is not "no regressions"."""
    head = headline([*[entry("bad")] * 52, *[entry("good")] * 10], STATES)
    assert head.tone == "open"
    assert head.change == "nothing to compare with"
    assert head.title == "62 clips, none accepted yet"
    assert head.counts == "52 failed, 10 passed"


def test_what_got_worse_comes_first() -> None:
    head = headline([entry("bad", baseline="good", blocking=True), entry("good")], STATES)
    assert (head.tone, head.title) == ("bad", "1 clip to look at")


def test_failures_that_were_accepted_are_not_hidden() -> None:
    head = headline([entry("bad", baseline="bad"), entry("good", baseline="good")], STATES)
    assert (head.tone, head.title) == ("open", "Nothing got worse, but 1 clip fails")


@pytest.mark.parametrize(
    ("addresses", "counts"),
    [(["good"], "1 passed"), (["lost", "bad", "good"], "1 failed, 1 errored, 1 passed"), ([], "")],
)
def test_verdicts_in_words(addresses: list[str], counts: str) -> None:
    states: Mapping[str, State] = STATES
    assert headline([entry(a, baseline=a) for a in addresses], states).counts == counts


def test_all_well_is_green() -> None:
    assert headline([entry("good", baseline="good")], STATES).tone == "ok"
