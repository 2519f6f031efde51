"""Jobs in both databases: claimed once, finished once, never lost."""

from __future__ import annotations

import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest

from physretarget.suite.queue import JobRecord, NewJob, Queue, new_id
from physretarget.suite.store import Store

HOME = "a" * 32


def new(name: str = "walk.npz", **told: object) -> NewJob:
    made = NewJob(
        kind="validate", clip_name=name, clip_sha256="0" * 64, model_id="lamp",
        model_name="lamp.xml", options={"fps": 30}, inputs={"blobs": ["b1"]}, fingerprint="f",
    )  # fmt: skip
    return replace(made, **told)  # type: ignore[arg-type]


@pytest.fixture
def queue(url: str) -> Iterator[Queue]:
    with Store(url) as store:
        yield Queue(store, HOME)


def submitted(queue: Queue, name: str = "walk.npz", **told: object) -> JobRecord:
    return queue.submit(new(name, **told))[0]


def claimed(queue: Queue, owner: str = "w", lease: float = 60.0) -> JobRecord:
    job = queue.claim(owner, lease)
    assert job is not None
    return job


def test_a_job_goes_its_way(queue: Queue) -> None:
    job = submitted(queue)
    assert (job.status, job.attempts, job.started) == ("queued", 0, None)
    mine = claimed(queue)
    assert (mine.id, mine.status, mine.attempts) == (job.id, "running", 1)
    assert queue.beat(mine, 60, progress=0.5, stage="judge") == "go on"
    seen = queue.get(job.id)
    assert seen is not None
    assert (seen.progress, seen.stage, seen.options) == (0.5, "judge", {"fps": 30})
    assert seen.revision > mine.revision > job.revision
    assert queue.finish(mine, "done", result="1", summary={"errors": 0})
    ended = queue.get(job.id)
    assert ended is not None
    assert (ended.status, ended.progress, ended.owner, ended.result) == ("done", 1.0, None, "1")
    assert ended.finished is not None
    assert queue.claim("w", 60) is None


def test_it_ends_once(queue: Queue) -> None:
    submitted(queue)
    mine = claimed(queue)
    assert queue.finish(mine, "done", result="1")
    assert not queue.finish(mine, "failed", error={"code": "x", "message": "y"})
    found = queue.get(mine.id)
    assert found is not None
    assert (found.status, found.error) == ("done", None)


def test_the_oldest_comes_first_and_each_once(queue: Queue) -> None:
    jobs = []
    for n in range(3):
        jobs.append(submitted(queue, f"{n}"))
        time.sleep(0.002)  # ids sort by the millisecond
    assert [claimed(queue).id for _ in jobs] == [job.id for job in jobs]
    assert queue.claim("w", 60) is None


def test_many_workers_at_once_share_the_jobs(queue: Queue) -> None:
    ids = {submitted(queue, f"{n}").id for n in range(40)}

    def work(owner: str) -> list[str]:
        found = []
        while (job := queue.claim(owner, 60)) is not None:
            found.append(job.id)
            assert queue.finish(job, "done", result="1")
        return found

    with ThreadPoolExecutor(6) as pool:
        done = [id for part in pool.map(work, "abcdef") for id in part]
    assert sorted(done) == sorted(ids)


def test_a_lease_that_runs_out_frees_the_job(queue: Queue) -> None:
    submitted(queue)
    lost = claimed(queue, "first", lease=0.05)
    time.sleep(0.1)
    again = claimed(queue, "second")
    assert (again.id, again.attempts) == (lost.id, 2)
    # Who lost it can write nothing any more.
    assert queue.beat(lost, 60, progress=0.9, stage="late") == "lost"
    assert not queue.finish(lost, "done", result="1")
    assert not queue.give_back(lost)
    assert queue.finish(again, "done", result="2")
    found = queue.get(lost.id)
    assert found is not None
    assert found.result == "2"


def test_the_same_owner_that_lost_its_claim_has_lost_it(queue: Queue) -> None:
    submitted(queue)
    lost = claimed(queue, "me", lease=0.02)
    time.sleep(0.05)
    claimed(queue, "me")
    assert not queue.finish(lost, "done", result="1")


def test_a_heartbeat_keeps_the_lease(queue: Queue) -> None:
    submitted(queue)
    mine = claimed(queue, lease=0.1)
    assert queue.beat(mine, 60) == "go on"
    time.sleep(0.15)
    assert queue.claim("other", 60) is None


def test_cancelling(queue: Queue) -> None:
    waiting, running = submitted(queue, "a"), None
    found = queue.cancel(waiting.id)
    assert found is not None
    assert found.status == "cancelled"
    submitted(queue, "b")
    running = claimed(queue)
    told = queue.cancel(running.id)
    assert told is not None
    assert (told.status, told.cancelling) == ("running", True)
    assert queue.beat(running, 60, progress=0.4, stage="judge") == "cancel"
    assert queue.finish(running, "cancelled")
    assert queue.cancel("0" * 26) is None
    ended = queue.cancel(running.id)
    assert ended is not None
    assert ended.status == "cancelled"


def test_a_server_that_died_gives_all_back(queue: Queue) -> None:
    submitted(queue)
    lost = claimed(queue)
    assert queue.recover() == 1
    again = queue.claim("another server's", 60)
    assert again is not None
    assert again.attempts == 1
    assert not queue.finish(lost, "done", result="1")


def test_giving_back_costs_no_attempt(queue: Queue) -> None:
    submitted(queue)
    assert queue.give_back(claimed(queue))
    assert claimed(queue).attempts == 1


def test_a_key_makes_one_job_even_at_the_same_moment(queue: Queue) -> None:
    with ThreadPoolExecutor(8) as pool:
        made = list(pool.map(lambda _: queue.submit(new(idempotency="k")), range(16)))
    assert len({job.id for job, _ in made}) == 1
    assert sum(fresh for _, fresh in made) == 1
    found = queue.find("k")
    assert found is not None
    assert found.id == made[0][0].id
    # No key, no sameness.
    assert submitted(queue).id != submitted(queue).id


def test_pages_and_searches(queue: Queue) -> None:
    ids = []
    for n in range(5):
        ids.append(submitted(queue, f"clip_{n}%", model_name=f"M{n % 2}.xml").id)
        time.sleep(0.002)
    newest = ids[::-1]
    first = queue.page(limit=2)
    assert [job.id for job in first] == newest[:2]
    assert [job.id for job in queue.page(limit=9, before=first[-1].id)] == newest[2:]
    assert [job.id for job in queue.page(q="CLIP_3")] == [ids[3]]
    assert len(queue.page(q="%")) == 5
    assert queue.page(q="clip%3") == []
    assert len(queue.page(model="M0.xml")) == 3
    assert len(queue.page(model="lamp")) == 5
    claimed(queue)
    assert [job.id for job in queue.page(status="running")] == [ids[0]]
    assert queue.page(kind="retarget") == []
    assert queue.counts()["queued"] == 4


def test_what_is_still_needed(queue: Queue) -> None:
    submitted(queue, kind="retarget", inputs={"blobs": ["b1", "b2"], "model": {"folder": "m1"}})
    submitted(queue, clip_sha256="b4", inputs={"blobs": ["b4"]})
    assert queue.needed_blobs({"b1", "b2", "b3", "b4"}) == {"b1", "b2", "b4"}
    assert queue.needed_models() == {"m1"}
    for _ in range(2):
        queue.finish(claimed(queue), "done", result="1")
    assert queue.needed_blobs({"b1", "b4"}) == queue.needed_models() == set()


def test_only_what_has_ended_is_deleted(queue: Queue) -> None:
    job = submitted(queue)
    assert not queue.delete(job.id)
    queue.cancel(job.id)
    assert queue.delete(job.id)
    assert queue.get(job.id) is None


def test_two_data_folders_share_a_database_and_nothing_else(url: str) -> None:
    with Store(url) as store:
        mine, theirs = Queue(store, HOME), Queue(store, "b" * 32)
        job = submitted(mine, idempotency="k")
        assert theirs.get(job.id) is None
        assert theirs.claim("w", 60) is None
        assert theirs.page() == []
        assert submitted(theirs, idempotency="k").id != job.id


def test_ids_sort_by_time_and_differ() -> None:
    made = [new_id() for _ in range(200)]
    assert len(set(made)) == 200
    time.sleep(0.002)
    assert new_id() > max(made)
    assert all((len(id) == 26 and id.isalnum() and id.islower()) or id.isdigit() for id in made)
