"""Nights on a library of boxes: what is done, what is not done again, what is told."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any
from xml.etree import ElementTree as Xml

import pytest

from physretarget.errors import InputError
from physretarget.suite.file import load_suite
from physretarget.suite.job import Job, Outcome
from physretarget.suite.plan import Plan, plan
from physretarget.suite.records import Entry, Run
from physretarget.suite.run import local, run_suite
from physretarget.suite.site import write_site
from physretarget.suite.store import Store
from physretarget.suite.work import perform

Library = Any  # of conftest.py, which importlib mode gives no name


def here(jobs: Sequence[Job]) -> Iterator[Outcome]:
    """Do jobs in this process: a process pool takes longer to start than these take."""
    return map(perform, jobs)


def night(library: Library, url: str | None = None) -> tuple[Run, dict[str, Entry]]:
    suite = load_suite(library.file)
    with Store(url or suite.history) as store:
        run = run_suite(suite, plan(suite), store, execute=here)
        entries = store.entries(run.id)
        write_site(store, run, entries, suite.out)
    return run, {entry.clip.removeprefix("box/clips/"): entry for entry in entries}


def accept(library: Library, url: str | None = None) -> None:
    suite = load_suite(library.file)
    with Store(url or suite.history) as store:
        run = store.runs(suite.name)[-1]
        found = {e.clip: e.address for e in store.entries(run.id) if e.verdict != "errored"}
        store.accept(suite.name, found, run=run.id, note="as it is")


def test_exactly_what_changed_is_named(library: Library, url: str) -> None:
    run, entries = night(library, url)
    assert run.done == 4
    assert {e.verdict for e in entries.values()} == {"new"}
    assert not any(e.blocking for e in entries.values())
    accept(library, url)

    library.clip("a", sink=0.08)  # worse
    library.clip("bad", sink=0.0)  # fixed
    library.path("b").unlink()  # removed
    library.path("c").write_bytes(b"PK no clip")  # broken
    library.clip("d")  # new
    run, entries = night(library, url)
    assert {name: e.verdict for name, e in entries.items()} == {
        "a.npz": "worse", "bad.npz": "fixed", "b.npz": "missing", "c.npz": "errored",
        "d.npz": "new",
    }  # fmt: skip
    assert {name for name, e in entries.items() if e.blocking} == {"a.npz", "b.npz", "c.npz"}
    assert entries["a.npz"].changes[0]["worse"]
    data = json.loads((library.folder / "night-report" / "data.json").read_text())
    assert data["counts"] == {
        "errored": 1, "worse": 1, "missing": 1, "fixed": 1, "better": 0, "new": 1, "same": 0,
    }  # fmt: skip
    junit = Xml.parse(library.folder / "night-report" / "junit.xml").getroot()
    failed = {t.get("name") for t in junit.iter("testcase") if t.find("failure") is not None}
    assert failed == {"box/clips/a.npz", "box/clips/b.npz"}
    broken = {t.get("name") for t in junit.iter("testcase") if t.find("error") is not None}
    assert broken == {"box/clips/c.npz"}


def test_unchanged_work_is_not_done_again(library: Library) -> None:
    assert night(library)[0].done == 4
    assert night(library)[0].done == 0
    library.clip("a", slide=1.0)
    assert night(library)[0].done == 1
    (library.folder / "box.xml").write_text((library.folder / "box.xml").read_text() + "<!-- -->")
    assert night(library)[0].done == 4


def test_a_moved_library_keeps_its_results(library: Library) -> None:
    suite = load_suite(library.file)
    addresses = {job.clip_id: job.address for job in plan(suite).jobs}
    moved = library.folder.with_name("moved")
    library.folder.rename(moved)
    again = plan(load_suite(moved / "night.toml"))
    assert {job.clip_id: job.address for job in again.jobs} == addresses


@pytest.mark.parametrize(
    "line", ["profile = 'robot'", "lowpass = 5", "config = 'rules.toml'", "fps = 25"]
)
def test_every_setting_is_in_the_address(library: Library, line: str) -> None:
    (library.folder / "rules.toml").write_text("friction = 0.5\n")
    before = {job.address for job in plan(load_suite(library.file)).jobs}
    library.file.write_text(library.file.read_text() + line + "\n")
    assert before.isdisjoint(job.address for job in plan(load_suite(library.file)).jobs)


def test_an_interrupted_run_resumes(library: Library) -> None:
    suite = load_suite(library.file)
    planned = plan(suite)

    def interrupted(jobs: Sequence[Job]) -> Iterator[Outcome]:
        yield perform(jobs[0])
        yield perform(jobs[1])
        raise KeyboardInterrupt

    with Store(suite.history) as store:
        with pytest.raises(KeyboardInterrupt):
            run_suite(suite, planned, store, execute=interrupted)
        assert store.runs(suite.name) == []
        assert run_suite(suite, planned, store, execute=here).done == 2


def test_a_slow_drift_is_caught_and_acceptance_ends_it(library: Library) -> None:
    night(library)
    accept(library)
    verdicts = []
    for step in range(1, 7):
        library.clip("a", sink=0.0005 * step)
        verdicts.append(night(library)[1]["a.npz"].verdict)
    assert verdicts[0] == "same"
    assert verdicts[-1] == "worse"
    accept(library)
    assert night(library)[1]["a.npz"].verdict == "same"


def test_accepting_a_removal_ends_it(library: Library) -> None:
    night(library)
    accept(library)
    library.path("b").unlink()
    assert night(library)[1]["b.npz"].verdict == "missing"
    accept(library)
    assert "b.npz" not in night(library)[1]


def test_copies_are_done_once(library: Library) -> None:
    library.path("a2").write_bytes(library.path("a").read_bytes())
    run, entries = night(library)
    assert run.done == 4
    assert entries["a.npz"].address == entries["a2.npz"].address


def test_a_missing_model_is_named_with_its_case(library: Library) -> None:
    (library.folder / "box.xml").unlink()
    with pytest.raises(InputError, match=r"box\.xml") as caught:
        plan(load_suite(library.file))
    assert caught.value.line == 4


def test_one_clip_in_two_cases_needs_two_names(library: Library) -> None:
    text = library.file.read_text()
    case = text[text.index("[[case]]") :]
    library.file.write_text(text + case)
    with pytest.raises(InputError, match="twice"):
        plan(load_suite(library.file))
    library.file.write_text(text + case + 'name = "again"\n')
    assert len(plan(load_suite(library.file)).jobs) == 8


def test_a_glob_that_finds_nothing_is_told(library: Library) -> None:
    library.file.write_text(library.file.read_text().replace('npz"]', 'npz", "none/*.csv"]'))
    planned = plan(load_suite(library.file))
    assert len(planned.jobs) == 4
    assert "none/*.csv" in planned.notes[0]


def test_processes_give_the_same_as_this_one(library: Library) -> None:
    jobs = plan(load_suite(library.file)).jobs
    alone = {o.address: o for o in here(jobs)}
    pooled = {o.address: o for o in local(2)(jobs)}
    assert pooled.keys() == alone.keys()
    for address, outcome in pooled.items():
        assert outcome.document == alone[address].document
        assert outcome.artifacts == alone[address].artifacts


def test_a_process_that_dies_costs_its_own_clip(
    library: Library, monkeypatch: pytest.MonkeyPatch
) -> None:
    jobs = plan(load_suite(library.file)).jobs
    deadly = replace(jobs[1], kind="deadly")  # type: ignore[arg-type]
    monkeypatch.setattr("physretarget.suite.run.perform", _perform_or_die)
    outcomes = {o.address: o for o in local(2)([jobs[0], deadly, *jobs[2:]])}
    assert outcomes.keys() == {job.address for job in jobs}
    assert outcomes[deadly.address].status == "errored"
    assert outcomes[deadly.address].transient
    assert sum(o.status == "ok" for o in outcomes.values()) == 3


def _perform_or_die(job: Job) -> Outcome:
    if job.kind == "deadly":  # type: ignore[comparison-overlap]
        os._exit(9)
    return perform(job)


def test_a_bug_is_told_and_the_night_goes_on(
    library: Library, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("oh")

    monkeypatch.setattr("physretarget.job.validate", broken)
    run, entries = night(library)
    assert run.counts == {"errored": 4}
    assert "ZeroDivisionError" in entries["a.npz"].reason


def test_plans_are_alike(library: Library) -> None:
    suite = load_suite(library.file)
    assert plan(suite) == plan(suite)
    assert isinstance(plan(suite), Plan)
