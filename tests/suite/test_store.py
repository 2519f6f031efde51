"""The history, on SQLite and on PostgreSQL alike."""

from __future__ import annotations

import sqlite3
import threading
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa

from physretarget.errors import InputError, UsageError
from physretarget.suite import database
from physretarget.suite import store as store_module
from physretarget.suite.job import Outcome
from physretarget.suite.records import Entry
from physretarget.suite.store import Store


def outcome(address: str, **changes: Any) -> Outcome:
    document = {
        "measures": {"depth": {"value": 0.1, "unit": "m", "frame": 3}},
        "findings": [
            {"code": "CON001", "severity": "error"},
            {"code": "CON001", "severity": "warning"},
        ],
    }
    values: dict[str, Any] = {
        "status": "ok", "document": document,
        "artifacts": {"motion": b"\0motion", "model/" + "a" * 64: b"shapes"},
    }  # fmt: skip
    return Outcome(address=address, **(values | changes))


def entry(clip: str, **changes: Any) -> Entry:
    values: dict[str, Any] = {
        "address": "1", "baseline": None, "case_name": "c", "kind": "clip", "tags": ("t", "é"),
        "owner": "", "verdict": "new", "reason": "r", "blocking": False,
        "changes": ({"name": "depth", "before": 0.1, "now": 0.2, "unit": "m", "worse": True},),
    }  # fmt: skip
    return Entry(clip=clip, **(values | changes))


def test_results_come_back(url: str) -> None:
    with Store(url) as store:
        assert store.known(["1"]) == set()
        store.save(outcome("1"))
        store.save(outcome("1"))  # another machine did it too
        assert store.known(["1", "2"]) == {"1"}
        state = store.states(["1"])["1"]
        assert (state.errors, state.warnings, state.passed) == (1, 1, False)
        assert state.measures == {"depth": {"value": 0.1, "unit": "m"}}
        assert store.artifact("1", "motion") == b"\0motion"
        assert store.artifact("a" * 64, "model") == b"shapes"
        assert store.artifact("2", "motion") is None
        assert store.documents(["1"])["1"]["measures"]["depth"]["frame"] == 3


def test_a_transient_failure_is_done_again(url: str) -> None:
    with Store(url) as store:
        store.save(outcome("1", status="errored", document=None, artifacts={}, transient=True))
        assert store.known(["1"]) == set()
        store.save(outcome("1"))
        assert store.known(["1"]) == {"1"}
        assert store.states(["1"])["1"].status == "ok"


def test_runs_and_entries_come_back(url: str) -> None:
    with Store(url) as store:
        unfinished = store.begin_run("night", "1")
        run = store.begin_run("night", "1")
        store.finish_run(run, [entry("x"), entry("y", verdict="worse")], seconds=1.5, done=2)
        other = store.begin_run("day", "1")
        store.finish_run(other, [], seconds=0.0, done=0)
        found = store.runs("night")
        assert [r.id for r in found] == [run]
        assert run > unfinished
        assert found[0].counts == {"new": 1, "worse": 1}
        assert store.entries(run) == [entry("x"), entry("y", verdict="worse")]
        assert store.tracks([run]) == {"x": [(run, "1")], "y": [(run, "1")]}


def test_the_latest_acceptance_is_in_force(url: str) -> None:
    with Store(url) as store:
        store.accept("night", {"x": "1", "y": "1"}, run=1, note="first")
        store.accept("night", {"x": "2", "y": None}, run=2, note="naïve")
        store.accept("day", {"x": "9"}, run=3, note="")
        found = store.baseline("night")
        assert (found["x"].address, found["x"].note, found["x"].run) == ("2", "naïve", 2)
        assert found["y"].address is None


def test_many_addresses(url: str) -> None:
    with Store(url) as store:
        store.save(outcome("1"))
        assert store.known([str(i) for i in range(3000)]) == {"1"}


def test_opened_again_nothing_is_lost(url: str) -> None:
    with Store(url) as store:
        store.save(outcome("1"))
    with Store(url) as store:
        assert store.known(["1"]) == {"1"}


def test_migrations_run_once_and_in_order(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with Store(url) as store:
        store.save(outcome("1"))

    def add(connection: sa.Connection) -> None:
        connection.execute(sa.text("ALTER TABLE results ADD COLUMN later INTEGER DEFAULT 7"))

    monkeypatch.setattr(store_module, "MIGRATIONS", (*store_module.MIGRATIONS, add))
    for _ in range(2):
        with Store(url) as store, store.begin() as connection:
            assert connection.execute(sa.text("SELECT later FROM results")).scalars().all() == [7]
    monkeypatch.undo()
    with pytest.raises(InputError, match="newer version"):
        Store(url)


def test_a_failed_migration_leaves_nothing(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def half(connection: sa.Connection) -> None:
        connection.execute(sa.text("CREATE TABLE half (x INTEGER)"))
        connection.execute(sa.text("THIS IS NO SQL"))

    monkeypatch.setattr(store_module, "MIGRATIONS", (*store_module.MIGRATIONS, half))
    with pytest.raises(InputError, match="history fails"):
        Store(url)
    monkeypatch.undo()
    with Store(url) as store, store.begin() as connection:
        assert not sa.inspect(connection).has_table("half")


def test_many_at_once(url: str) -> None:
    """Eight writers open the same new history at the same moment: all their results are there."""
    gate, errors = threading.Barrier(8), []

    def write(number: int) -> None:
        try:
            gate.wait()
            with Store(url) as store:
                for k in range(5):
                    store.save(outcome(f"{number}-{k}"))
                    store.save(outcome("shared"))
        except Exception as error:
            errors.append(error)

    threads = [threading.Thread(target=write, args=(i,)) for i in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert errors == []
    with Store(url) as store:
        wanted = {f"{i}-{k}" for i in range(8) for k in range(5)} | {"shared"}
        assert store.known(wanted) == wanted


def test_a_locked_history_is_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The switch of the journal asks again while another holds the file, and gives up in time."""
    path = tmp_path / "x.db"
    holder = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
    holder.execute("BEGIN EXCLUSIVE")
    threading.Timer(0.3, lambda: holder.execute("COMMIT")).start()
    with Store(f"sqlite:///{path}") as store:
        assert store.known(["nothing"]) == set()
    other = tmp_path / "y.db"
    monkeypatch.setattr(database, "_PATIENCE", 0.1)
    monkeypatch.setattr(database, "_BUSY_MS", 100)
    with closing(sqlite3.connect(other, isolation_level=None)) as stuck:
        stuck.execute("BEGIN EXCLUSIVE")
        with pytest.raises(InputError, match="locked"):
            Store(f"sqlite:///{other}")


@pytest.mark.parametrize("bad", ["mysql://x/y", "nonsense", "sqlite:////proc/nowhere/x.db"])
def test_bad_histories_are_one_sentence(bad: str) -> None:
    from physretarget.errors import PhysretargetError

    with pytest.raises((InputError, UsageError, PhysretargetError, OSError)):
        Store(bad)


def test_a_password_is_never_shown(tmp_path: Path) -> None:
    pytest.importorskip("psycopg", reason="PostgreSQL needs the extra 'postgresql'")
    with pytest.raises(InputError) as caught:
        Store("postgresql+psycopg://me:secret@127.0.0.1:1/x")
    assert "secret" not in str(caught.value)


def test_connections_that_the_server_closed_are_made_anew(url: str) -> None:
    """A PostgreSQL that was restarted has closed what the pool still holds."""
    if not url.startswith("postgresql"):
        pytest.skip("about PostgreSQL")
    with Store(url) as store:
        with store.read() as connection:
            mine = connection.execute(sa.text("SELECT pg_backend_pid()")).scalar()
            limit = connection.execute(sa.text("SHOW statement_timeout")).scalar()
        assert limit == "1min"
        with Store(url) as other, other.begin() as connection:
            connection.execute(sa.text(f"SELECT pg_terminate_backend({mine})"))
        with store.read() as connection:
            assert connection.execute(sa.text("SELECT 1")).scalar() == 1


def test_what_is_committed_is_on_the_disk(tmp_path: Path) -> None:
    """SQLite writes through to the disk at every commit, not only at checkpoints."""
    with Store(f"sqlite:///{tmp_path / 'h.db'}") as store, store.read() as connection:
        assert connection.execute(sa.text("PRAGMA synchronous")).scalar() == 2  # FULL
