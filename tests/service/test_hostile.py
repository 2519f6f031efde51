"""Uploads of strangers: refused at the door, nothing read outside, the server unmoved."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from types import ModuleType
from typing import Any

import httpx
import pytest


@pytest.fixture(scope="module")
def door(start: Callable[..., Any]) -> Any:
    # A capture is refused when it does not come to an end: let that be soon.
    return start(check_seconds=10.0)


def send(live: Any, case: Any) -> httpx.Response:
    """Where a file of its kind goes."""
    content = (case.filename, case.content())
    post = live.client.post
    if case.kind == "capture":
        data = {"kind": "retarget", "character": "lamp"}
        return post("/api/v1/jobs", data=data, files={"capture": content})  # type: ignore[no-any-return]
    place = "models" if case.kind == "model" else "clips"
    return post(f"/api/v1/{place}", files={"file": content})  # type: ignore[no-any-return]


def test_every_malicious_upload_is_refused(door: Any, malicious: ModuleType) -> None:
    """4xx for each, no word of a file outside, and health answers meanwhile."""
    waits: list[float] = []
    over = threading.Event()

    def ask() -> None:
        with httpx.Client(base_url=door.url) as client:
            while not over.wait(0.02):
                began = time.perf_counter()
                assert client.get("/health").status_code == 200
                waits.append(time.perf_counter() - began)

    asking = threading.Thread(target=ask)
    asking.start()
    accepted, leaked = [], []
    try:
        with ThreadPoolExecutor(3) as pool:
            answers = list(pool.map(lambda case: send(door, case), malicious.CASES))
        for case, answer in zip(malicious.CASES, answers, strict=True):
            if not 400 <= answer.status_code < 500:
                accepted.append((case.name, answer.status_code))
            if malicious.CANARY in answer.text:
                leaked.append(case.name)
    finally:
        over.set()
        asking.join()
    assert len(malicious.CASES) >= 30
    assert accepted == []
    assert leaked == []
    assert list(door.service.home.incoming.iterdir()) == []
    assert list(door.service.home.blobs.iterdir()) == []
    assert list(door.service.home.models.iterdir()) == []
    # Others use this machine too: half of the answers are a fair sample of the server's own time.
    assert sorted(waits)[len(waits) // 2] < 0.05


@pytest.mark.parametrize("kind", ["clip", "model"])
def test_a_job_refuses_them_as_well(
    door: Any, malicious: ModuleType, clip: Callable[..., bytes], kind: str
) -> None:
    case = next(c for c in malicious.CASES if c.kind == kind)
    files = {"clip": ("box.npz", clip()), **(
        {"clip": (case.filename, case.content())} if kind == "clip"
        else {"model_file": (case.filename, case.content())}
    )}  # fmt: skip
    data = {} if kind == "model" else {"model": "lamp"}
    answer = door.client.post("/api/v1/jobs", data=data, files=files)
    assert answer.status_code == 422
    assert answer.json()["error"]["code"] in ("unsafe", "unusable")
    assert list(door.service.home.jobs.iterdir()) == []
