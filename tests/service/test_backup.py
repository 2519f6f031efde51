"""What a backup holds is what a restored service has."""

from __future__ import annotations

import io
import tarfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from physretarget.errors import InputError, UsageError
from physretarget.service.backup import back_up, restore
from physretarget.service.tokens import hashed, make_token

Start = Callable[..., Any]


def _state(live: Any, headers: dict[str, str]) -> dict[str, Any]:
    state: dict[str, Any] = {}
    for kind in ("jobs", "clips", "models"):
        state[kind] = live.client.get(f"/api/v1/{kind}", headers=headers).json()["items"]
    for job in state["jobs"]:
        for end in ("report", "report?format=html", "replay"):
            answer = live.client.get(f"/api/v1/jobs/{job['id']}/{end}", headers=headers)
            assert answer.status_code == 200
            state[f"{job['id']}/{end}"] = answer.content
    return state


def test_a_restored_service_has_the_same_jobs_and_bytes(
    start: Start, clip: Callable[..., bytes], tmp_path: Path
) -> None:
    live = start(tmp_path / "data")
    for speed in (0.0, 0.5):
        live.wait(live.submit(clip(speed)).json()["id"])
    token = make_token()
    live.service.registry.add_token("root", "admin", hashed(token))
    live.service.tokens._until = -1
    headers = {"Authorization": f"Bearer {token}"}
    before = _state(live, headers)
    counts = back_up(tmp_path / "data", None, tmp_path / "all.tar")
    assert counts["jobs"] == 2
    assert counts["tokens"] == 1
    live.close()
    assert restore(tmp_path / "all.tar", tmp_path / "other", None) == counts
    again = start(tmp_path / "other")
    assert _state(again, headers) == before
    assert again.client.get("/api/v1/jobs").status_code == 401
    assert again.service.home.id != live.service.home.id


def test_what_is_no_backup_restores_nothing(tmp_path: Path) -> None:
    bad = tmp_path / "bad.tar"
    bad.write_bytes(b"x" * 2000)
    with pytest.raises(InputError, match="no readable backup"):
        restore(bad, tmp_path / "new", None)
    with pytest.raises(InputError, match="no data folder"):
        back_up(tmp_path / "absent", None, tmp_path / "a.tar")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "x").touch()
    with pytest.raises(UsageError, match="not empty"):
        restore(bad, tmp_path / "full", None)


@pytest.mark.parametrize("name", ["../escape", "/etc/escape", "blobs/../../escape", "id"])
def test_a_backup_writes_nothing_elsewhere(tmp_path: Path, name: str) -> None:
    bad = tmp_path / "bad.tar"
    with tarfile.open(bad, "w") as archive:
        files = {"backup.json": b'{"schema": "physretarget/backup/1"}'}
        files |= {f"rows/{n}.json": b"[]" for n in ("jobs", "clips", "models", "tokens")}
        files[name] = b"x"
        for each, content in files.items():
            entry = tarfile.TarInfo(each)
            entry.size = len(content)
            archive.addfile(entry, io.BytesIO(content))
    with pytest.raises(InputError, match="which no backup has"):
        restore(bad, tmp_path / "new", None)
    assert not (tmp_path / "escape").exists()
