"""Every malicious upload is refused, in bounded time, with nothing outside opened."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import malicious
import pytest
from watch import Watch

from physretarget.sandbox.child import ChildError
from physretarget.sandbox.limits import Limits
from physretarget.sandbox.pool import Pool

MODELS = Path(__file__).resolve().parents[2] / "models"
LIMITS = Limits(seconds=30, cpu_seconds=30, memory_bytes=2 * 2**30)


@pytest.fixture(scope="module")
def pool() -> Iterator[Pool]:
    with Pool() as pool:
        yield pool


@pytest.fixture(scope="module")
def watch() -> Iterator[Watch]:
    watch = Watch(malicious.write_canaries())
    yield watch
    watch.close()


def test_the_watch_sees_a_read(watch: Watch) -> None:
    Path(malicious.OUTSIDE).read_text()
    assert watch.seen()


def request_of(case: Any, upload: Path) -> tuple[str, dict[str, Any]]:
    if case.kind == "model":
        return "check_model", {
            "upload": str(upload), "name": case.filename, "main": "", "limits": LIMITS.to_dict(),
        }  # fmt: skip
    about = {
        "model": str(MODELS / "lamp.xml"), "options": case.options, "clip_frames": 10**6,
        "clip_name": case.filename, "model_name": "lamp",
    }  # fmt: skip
    if case.kind == "clip":
        return "validate", {"clip": str(upload), **about}
    return "retarget", {
        "capture": str(upload), "keyposes": [str(MODELS / "lamp.keyposes.toml")], **about,
    }  # fmt: skip


@pytest.mark.parametrize("case", malicious.CASES, ids=lambda case: case.name)
def test_refused(case: Any, pool: Pool, watch: Watch, tmp_path: Path) -> None:
    folder = tmp_path / "job"
    upload = folder / "inputs" / case.filename
    upload.parent.mkdir(parents=True)
    upload.write_bytes(case.content())
    task, request = request_of(case, upload)
    watch.seen()
    began = time.monotonic()
    with pytest.raises(ChildError) as refused:
        pool.run(
            f"physretarget.service.tasks:{task}", request, folder=folder, limits=LIMITS,
            inputs=(MODELS,),
        )  # fmt: skip
    took = time.monotonic() - began
    error = refused.value
    print(f"{took:6.2f} s {error.kind:8} {case.name}: {error.message[:150]}")
    assert error.kind == "input", f"{error.message} {error.log[-2000:]}"
    assert took < 20
    assert watch.seen() == []
    assert malicious.CANARY not in error.message + error.log
    assert str(tmp_path) not in error.message
    assert not Path(f"{malicious.OUTSIDE}.ran").exists()


def test_there_are_many() -> None:
    assert len(malicious.CASES) >= 45
    assert len({case.name for case in malicious.CASES}) == len(malicious.CASES)


def test_the_docs_name_each() -> None:
    page = Path(__file__).resolve().parents[2] / "docs" / "measured" / "malicious-uploads.md"
    table = page.read_text().split("| Tries |")[1]
    named = [word for word in table.replace("\n", " ").split("`")[1::2] if " " not in word]
    assert sorted(named) == sorted(case.name for case in malicious.CASES)
