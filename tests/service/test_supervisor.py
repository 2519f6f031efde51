"""Workers and children that go wrong, with a child that is only played."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from physretarget.errors import InputError
from physretarget.sandbox.child import ChildError
from physretarget.sandbox.limits import Limits
from physretarget.service.home import Home
from physretarget.service.metrics import Metrics
from physretarget.service.supervisor import RESULTS, Supervisor
from physretarget.suite.queue import JobRecord, NewJob, Queue
from physretarget.suite.store import Store

Play = Callable[[Path, dict[str, Any]], Any]
SUMMARY = {
    "summary": {
        "errors": 0, "warnings": 1, "passed": True, "verdict": "passed", "reason": "", "cause": "",
    }
}  # fmt: skip


class Player:
    """Runs what a test says instead of a child."""

    def __init__(self, play: Play) -> None:
        self.play = play
        self.runs = 0

    def run(self, task: str, request: Any, *, folder: Path, **told: Any) -> dict[str, Any]:
        self.runs += 1
        answer: dict[str, Any] = self.play(folder, {"request": request, **told})
        return answer


def leave(folder: Path) -> dict[str, Any]:
    """What a good child leaves."""
    for name in RESULTS:
        if name != "clip.npz":
            (folder / name).write_text("x")
    return SUMMARY


class Shop:
    """A queue in a folder, and workers with a played child."""

    def __init__(self, folder: Path) -> None:
        self.home = Home(folder)
        self.store = Store(self.home.history)
        self.queue = Queue(self.store, self.home.id)
        self.released: list[str] = []
        self.made: list[Supervisor] = []

    def open(self, play: Play, *, lease: float = 60.0, heartbeat: float = 0.05) -> Supervisor:
        supervisor = Supervisor(
            self.queue, self.home, Player(play), limits=Limits(), workers=1, lease=lease,
            heartbeat=heartbeat, metrics=Metrics(),
            released=lambda job: self.released.append(job.id),
        )  # fmt: skip
        self.made.append(supervisor)
        supervisor.start()
        return supervisor

    def submit(self) -> str:
        new = NewJob(
            kind="validate", clip_name="a.npz", clip_sha256="1" * 64, model_id="lamp",
            model_name="lamp.xml", options={}, fingerprint="f",
            inputs={"clip": {"name": "a.npz", "sha256": "1" * 64}, "model": {"builtin": "lamp"}},
        )  # fmt: skip
        return self.queue.submit(new)[0].id

    def get(self, id: str) -> JobRecord:
        found = self.queue.get(id)
        assert found is not None
        return found

    def until(self, true: Callable[[], bool]) -> None:
        end = time.monotonic() + 15
        while not true():
            assert time.monotonic() < end
            time.sleep(0.01)

    def done(self, id: str) -> JobRecord:
        self.until(lambda: self.get(id).ended)
        return self.get(id)


@pytest.fixture
def shop(tmp_path: Path) -> Iterator[Shop]:
    made = Shop(tmp_path / "data")
    yield made
    for supervisor in made.made:
        supervisor.stop()
    made.store.__exit__(None, None, None)


def test_results_are_put_in_place(shop: Shop) -> None:
    id = shop.submit()
    shop.open(lambda folder, told: leave(folder))
    job = shop.done(id)
    assert (job.status, job.summary) == ("done", SUMMARY["summary"])
    shop.until(lambda: shop.released == [id])
    shop.until(lambda: [p.name for p in shop.home.job(id).iterdir()] == [job.result])
    assert not (shop.home.job(id) / str(job.result) / "inputs").exists()


def test_the_child_sees_the_client_s_name_and_the_place_of_nothing_else(shop: Shop) -> None:
    seen: dict[str, Any] = {}

    def play(folder: Path, told: dict[str, Any]) -> dict[str, Any]:
        seen.update(told)
        return leave(folder)

    shop.home.blob("1" * 64).write_text("clip")
    shop.open(play)
    shop.done(shop.submit())
    assert Path(seen["request"]["clip"]).name == "a.npz"
    assert shop.home.blob("1" * 64) in seen["inputs"]
    assert shop.home.blobs not in seen["inputs"]
    assert shop.home.folder not in seen["inputs"]


@pytest.mark.parametrize("what", ["link", "hard link", "pipe", "folder", "missing"])
def test_a_result_that_is_no_plain_file_is_never_served(
    shop: Shop, tmp_path: Path, what: str
) -> None:
    secret = tmp_path / "secret"
    secret.write_text("secret")

    def play(folder: Path, told: dict[str, Any]) -> dict[str, Any]:
        leave(folder)
        place = folder / "report.html"
        place.unlink()
        make: dict[str, Callable[[], object]] = {
            "link": lambda: place.symlink_to(secret), "hard link": lambda: os.link(secret, place),
            "pipe": lambda: os.mkfifo(place), "folder": place.mkdir, "missing": lambda: None,
        }  # fmt: skip
        make[what]()
        return SUMMARY

    shop.open(play)
    job = shop.done(shop.submit())
    assert job.status == "failed"
    assert job.error is not None
    assert job.error["code"] == "crash"
    shop.until(lambda: not any(shop.home.job(job.id).iterdir()))
    assert secret.read_text() == "secret"


@pytest.mark.parametrize("answer", [{}, {"summary": 3}, {"summary": {"errors": "0"}}])
def test_an_answer_that_is_none(shop: Shop, answer: dict[str, Any]) -> None:
    def play(folder: Path, told: dict[str, Any]) -> dict[str, Any]:
        leave(folder)
        return answer

    shop.open(play)
    job = shop.done(shop.submit())
    assert job.status == "failed"


@pytest.mark.parametrize("kind", ["input", "timeout", "memory", "crash"])
def test_a_child_that_fails(shop: Shop, kind: Any) -> None:
    def play(folder: Path, told: dict[str, Any]) -> dict[str, Any]:
        raise ChildError(kind, "it went wrong.", log="secret log")

    shop.open(play)
    job = shop.done(shop.submit())
    assert job.error == {"code": kind, "message": "it went wrong."}


def waiting(folder: Path, told: dict[str, Any]) -> dict[str, Any]:
    """A child that works until it is told to stop."""
    told["progress"](0.5, "judge")
    while not told["cancelled"]():
        time.sleep(0.01)
    raise ChildError("cancelled", "the job was cancelled.")


def test_progress_reaches_the_row(shop: Shop) -> None:
    id = shop.submit()
    shop.open(waiting)
    shop.until(lambda: (shop.get(id).progress, shop.get(id).stage) == (0.5, "judge"))


def test_a_cancellation_in_the_database_reaches_the_child(shop: Shop) -> None:
    id = shop.submit()
    shop.open(waiting)
    shop.until(lambda: shop.get(id).status == "running")
    shop.queue.cancel(id)
    assert shop.done(id).status == "cancelled"


def test_a_stop_gives_the_job_back(shop: Shop) -> None:
    id = shop.submit()
    supervisor = shop.open(waiting)
    shop.until(lambda: shop.get(id).status == "running")
    supervisor.stop()
    job = shop.get(id)
    assert (job.status, job.attempts) == ("queued", 0)
    shop.open(lambda folder, told: leave(folder))
    assert shop.done(id).attempts == 1


def test_who_lost_its_claim_keeps_silent(shop: Shop) -> None:
    """A worker that hung past its lease finishes nothing, whatever it comes back with."""
    id = shop.submit()
    hung, come_back = threading.Event(), threading.Event()

    def hang(folder: Path, told: dict[str, Any]) -> dict[str, Any]:
        hung.set()
        assert come_back.wait(20)
        return leave(folder)

    first = shop.open(hang, lease=0.1)
    assert hung.wait(10)
    time.sleep(0.15)
    again = shop.queue.claim("other", 60)
    assert again is not None
    assert again.attempts == 2
    come_back.set()
    first.stop()
    assert shop.get(id).status == "running"
    assert shop.released == []
    assert shop.queue.finish(again, "done", result="2")


def test_a_bug_ends_the_job_and_not_the_worker(shop: Shop) -> None:
    calls = iter([RuntimeError("bug"), OSError("disk full")])

    def play(folder: Path, told: dict[str, Any]) -> dict[str, Any]:
        error = next(calls, None)
        if error is not None:
            raise error
        return leave(folder)

    supervisor = shop.open(play)
    ids = [shop.submit() for _ in range(3)]
    jobs = [shop.done(id) for id in ids]
    # The first is our bug; the second met a full disk, which is no verdict, and waited.
    assert [job.status for job in jobs] == ["failed", "done", "done"]
    assert jobs[0].error is not None
    assert jobs[0].error["code"] == "internal"
    assert jobs[1].attempts == 1
    assert supervisor.workers == 1


def test_a_crash_is_tried_once_more_and_then_the_jobs_own_fault(shop: Shop) -> None:
    calls: list[str] = []

    def play(folder: Path, told: dict[str, Any]) -> dict[str, Any]:
        calls.append(folder.parent.name)
        if calls.count(folder.parent.name) == 1 or folder.parent.name == calls[0]:
            raise ChildError("crash", "the job's process ended by signal 9 without an answer.")
        return leave(folder)

    shop.open(play)
    ids = [shop.submit() for _ in range(2)]
    jobs = [shop.done(id) for id in ids]
    assert [job.status for job in jobs] == ["failed", "done"]
    assert jobs[0].error is not None
    assert jobs[0].error["code"] == "crash"
    assert calls.count(ids[0]) == 2


def test_a_database_that_is_away_at_the_end_of_a_job_loses_nothing(
    shop: Shop, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, away = Queue.finish, iter([True, True])

    def finish(self: Queue, *given: Any, **told: Any) -> bool:
        if next(away, False):
            raise InputError("the history fails: connection lost.")
        return whole(self, *given, **told)

    monkeypatch.setattr(Queue, "finish", finish)
    shop.open(lambda folder, told: leave(folder))
    job = shop.done(shop.submit())
    assert job.status == "done"
    assert job.attempts == 1
