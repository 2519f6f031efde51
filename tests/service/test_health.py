"""Health tells the truth: a full disk, a database that does not answer; and nothing is lost."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import pytest

from physretarget.service.service import Service
from physretarget.service.state import free_bytes, troubles
from physretarget.suite.queue import Queue


def wait(held: Callable[[], bool], seconds: float = 20.0) -> None:
    end = time.monotonic() + seconds
    while not held():
        assert time.monotonic() < end, "it did not come"
        time.sleep(0.05)


def names(client: Any) -> set[str]:
    return {each["what"] for each in client.get("/health").json()["troubles"]}


def test_a_service_that_is_well_is_ready(live: Any) -> None:
    assert live.client.get("/health/live").json()["status"] == "ok"
    answer = live.client.get("/health/ready")
    assert answer.status_code == 200
    health = answer.json()
    assert health["troubles"] == []
    assert health["disk"]["free_bytes"] > health["disk"]["reserve_bytes"] > 0
    assert health["database_age_s"] < 4.0


def test_a_full_disk_pauses_and_loses_nothing(
    start: Callable[..., Any], clip: Callable[..., bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing is taken in, queued jobs wait, what is there can be deleted, and all goes on."""
    live = start(workers=1)
    client = live.client
    done = live.submit(clip()).json()["id"]
    assert live.wait(done)["status"] == "done"
    full = [True]
    monkeypatch.setattr(Service, "free", property(lambda self: 0 if full[0] else 2**40))
    monkeypatch.setattr(
        "physretarget.service.uploads.free_bytes", lambda folder: 0 if full[0] else 2**40
    )
    assert names(client) == {"disk"}
    answer = client.get("/health/ready")
    assert answer.status_code == 503
    assert client.get("/health/live").status_code == 200
    refused = live.submit(clip())
    assert refused.status_code == 507
    assert refused.json()["error"]["code"] == "insufficient_storage"
    assert client.delete(f"/api/v1/jobs/{done}").status_code == 204
    full[0] = False
    assert names(client) == set()
    assert live.wait(live.submit(clip()).json()["id"])["status"] == "done"


def test_a_queued_job_waits_for_the_disk(
    start: Callable[..., Any], clip: Callable[..., bytes]
) -> None:
    live = start(workers=1)
    full = [True]
    live.service.supervisor._full = lambda: full[0]
    job = live.submit(clip()).json()["id"]
    time.sleep(1.5)
    told = live.client.get(f"/api/v1/jobs/{job}").json()
    assert told["status"] == "queued"
    wait(lambda: live.client.get("/health").json()["queue"]["oldest"] is not None)
    full[0] = False
    assert live.wait(job)["status"] == "done"


def test_a_frozen_database_is_told_within_seconds(
    start: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The look hangs, as it does on a server that is stopped: health does not hang with it."""
    live = start(workers=1)
    frozen = [True]
    counts = Queue.counts

    def slow(self: Queue) -> dict[str, int]:
        while frozen[0]:
            time.sleep(0.05)
        return counts(self)

    monkeypatch.setattr(Queue, "counts", slow)
    began = time.monotonic()
    wait(lambda: names(live.client) == {"database"}, 6.5)
    assert time.monotonic() - began < 6.5
    assert live.client.get("/health/ready").status_code == 503
    frozen[0] = False
    wait(lambda: names(live.client) == set())


def test_troubles_are_told_apart() -> None:
    now = time.monotonic()
    well = {"free": 10, "reserve": 5, "looked": now, "reachable": True, "alive": 2, "wanted": 2}

    def told(**other: Any) -> list[str]:
        return [each.what for each in troubles(**{**well, **other})]  # type: ignore[arg-type]

    assert told() == []
    assert told(free=4) == ["disk"]
    assert told(looked=now - 60) == ["database"]
    assert told(reachable=False) == ["database"]
    assert told(alive=1) == ["workers"]


def test_a_folder_that_is_gone_has_no_room(tmp_path: Any) -> None:
    assert free_bytes(tmp_path) > 0
    assert free_bytes(tmp_path / "gone") == 0
