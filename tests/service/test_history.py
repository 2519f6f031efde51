"""The service on both databases, and what it takes up when it starts again."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from physretarget.service.home import Home
from physretarget.suite.queue import NewJob, Queue
from physretarget.suite.registry import Registry
from physretarget.suite.store import Store

Start = Callable[..., Any]
Clip = Callable[..., bytes]


def test_jobs_live_in_either_database(start: Start, clip: Clip, url: str, tmp_path: Path) -> None:
    live = start(tmp_path / "data", history=url)
    job = live.wait(live.submit(clip(), headers={"Idempotency-Key": "k"}).json()["id"])
    assert job["status"] == "done"
    live.close()
    again = start(tmp_path / "data", history=url)
    assert again.client.get(f"/api/v1/jobs/{job['id']}").json() == job
    assert again.client.get(job["links"]["report"]).status_code == 200
    assert again.client.get("/api/v1/models").json()["items"][3]["name"] == "box.xml"
    again.close()


def test_what_a_dead_server_left_is_taken_up_or_removed(
    start: Start, clip: Clip, tmp_path: Path
) -> None:
    """A running job, halves of results and uploads, contents and models that nobody names."""
    home = Home(tmp_path)
    left = {
        home.incoming / "upload-1", home.blob("0" * 64), home.models / "nobodys",
        home.jobs / "j" / ".work-1",
    }  # fmt: skip
    for place in left:
        place.mkdir(parents=True) if place.parent.name in ("models", "j") else place.touch()
    content = clip()
    home.blob("1" * 64).write_bytes(content)
    with Store(home.history) as store:
        queue = Queue(store, home.id)
        job, _ = queue.submit(
            NewJob(
                kind="validate", clip_name="a.npz", clip_sha256="1" * 64, model_id="lamp",
                model_name="lamp.xml", options={}, fingerprint="f",
                inputs={"clip": {"name": "a.npz", "sha256": "1" * 64},
                        "model": {"builtin": "lamp"}, "blobs": ["1" * 64]},
            )
        )  # fmt: skip
        assert queue.claim("dead", 1000) is not None
        kept = Registry(store, home.id).add_clip("kept.npz", "2" * 64, 1)
    home.blob("2" * 64).touch()
    live = start(tmp_path)
    ended = live.wait(job.id)
    assert ended["attempts"] == 1, "that a server died is no fault of its jobs"
    assert ended["status"] == "failed"  # a box is no lamp; but it was looked at
    assert not any(place.exists() for place in left)
    assert home.blob(kept.sha256).exists()
    live.close()


def test_a_job_that_always_kills_is_given_up(start: Start, tmp_path: Path) -> None:
    home = Home(tmp_path)
    with Store(home.history) as store:
        queue = Queue(store, home.id)
        job, _ = queue.submit(
            NewJob(
                kind="validate", clip_name="a.npz", clip_sha256="1" * 64, model_id="lamp",
                model_name="lamp.xml", options={}, fingerprint="f", inputs={},
            )
        )  # fmt: skip
        for _ in range(10):  # each of these leases has run out: the worker hung
            assert queue.claim("hung", -1) is not None
    live = start(tmp_path)
    assert "given up" in live.wait(job.id)["error"]["message"]
    live.close()
