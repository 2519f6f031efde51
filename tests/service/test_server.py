"""A real server process over loopback: started, stopped, killed, refused."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import httpx
import pytest

Clip = Callable[..., bytes]
TRIES = 400


def program(*arguments: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "physretarget", *arguments], capture_output=True, text=True,
        cwd=cwd, check=False, timeout=60,
    )  # fmt: skip


@pytest.fixture
def server(tmp_path: Path, drills: ModuleType) -> Iterator[Any]:
    made = drills.Server(tmp_path / "data")
    made.start()
    yield made
    if made.process.poll() is None:
        made.stop()


def submit(server: Any, clip: bytes, **headers: str) -> str:
    answer = httpx.post(
        f"{server.url}/api/v1/jobs", data={"model": "lamp"}, files={"clip": ("box.npz", clip)},
        headers=headers, timeout=30,
    )  # fmt: skip
    assert answer.status_code == 202, answer.text
    id: str = answer.json()["id"]
    return id


def ended(server: Any, id: str) -> dict[str, Any]:
    for _ in range(TRIES):
        job: dict[str, Any] = httpx.get(f"{server.url}/api/v1/jobs/{id}").json()
        if job["status"] in ("done", "failed", "cancelled"):
            return job
        time.sleep(0.05)
    raise AssertionError(job)


def lamp_clip() -> bytes:
    import numpy as np

    from physretarget.clip import Clip as Motion
    from physretarget.mjcf import Character

    lamp = Character.load(Path(__file__).parent.parent.parent / "models" / "lamp.xml")
    qpos = np.repeat(lamp.reference_qpos[None], 31, axis=0)
    return Motion(
        qpos=qpos, time=np.arange(31) / 30.0, joint_names=tuple(lamp.joint_names)
    ).to_bytes()  # fmt: skip


def test_a_day_of_a_server(server: Any, tmp_path: Path) -> None:
    """Submit, follow, read; stop while a job runs, start again: it is done then."""
    clip = lamp_clip()
    id = submit(server, clip)
    with httpx.stream("GET", f"{server.url}/api/v1/jobs/{id}/events", timeout=30) as answer:
        names = [line[7:] for line in answer.iter_lines() if line.startswith("event: ")]
    assert names[-1] == "done"
    report = httpx.get(f"{server.url}/api/v1/jobs/{id}/report").json()
    assert report["summary"]["passed"] is True
    waiting = [submit(server, clip, **{"Idempotency-Key": f"{n}"}) for n in range(6)]
    children = server.children()
    assert children
    assert server.stop() == 0
    assert not any(alive(pid) for pid in children)
    log = [json.loads(line) for line in server.log.read_text().splitlines()]
    assert all({"time", "level", "message"} <= set(line) for line in log)
    assert not any(line["level"] == "error" for line in log), log
    server.start()
    found = [ended(server, id) for id in waiting]
    assert [job["status"] for job in found] == ["done"] * 6, found
    assert submit(server, clip, **{"Idempotency-Key": "3"}) == waiting[3]
    again = httpx.get(f"{server.url}/api/v1/jobs/{id}/report").json()
    assert again == report
    # One that was given back at the stop has lost no attempt by it.
    jobs = httpx.get(f"{server.url}/api/v1/jobs").json()["items"]
    assert {job["attempts"] for job in jobs} == {1}


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_killed_it_leaves_no_process_behind(server: Any, clip: Clip) -> None:
    submit(server, lamp_clip())
    children: list[int] = []
    for _ in range(TRIES):
        children = server.children()
        if children:
            break
        time.sleep(0.02)
    server.kill()
    for _ in range(TRIES):
        if not any(alive(pid) for pid in children):
            return
        time.sleep(0.02)
    raise AssertionError("a child outlives its server")


def test_killed_again_and_again_it_loses_nothing(tmp_path: Path, drills: ModuleType) -> None:
    told = drills.drill(tmp_path, jobs=40, clients=8, kills=2)
    assert told.fine, told
    assert sum(told.attempts.values()) == 40


@pytest.mark.slow
def test_five_hundred_jobs_and_three_kills(tmp_path: Path, drills: ModuleType) -> None:
    told = drills.drill(tmp_path, jobs=500, clients=20, kills=3)
    assert told.fine, told


def test_a_data_folder_has_one_server(server: Any) -> None:
    second = program("serve", "--port", "0", "--data", str(server.data))
    assert second.returncode == 2
    assert "in use by another server" in second.stderr


def test_a_port_that_is_taken(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        ran = program("serve", "--port", str(taken.getsockname()[1]), "--data", str(tmp_path / "d"))
    assert ran.returncode == 2
    assert "choose another port" in ran.stderr
    assert ran.stderr.count("\n") == 1


def test_a_data_folder_that_cannot_be(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    ran = program("serve", "--port", "0", "--data", str(tmp_path / "file" / "data"))
    assert ran.returncode == 2
    assert "cannot be written to" in ran.stderr
    assert ran.stderr.count("\n") == 1


def test_beyond_loopback_a_token_is_needed(tmp_path: Path) -> None:
    ran = program("serve", "--host", "0.0.0.0", "--port", "0", "--data", str(tmp_path))
    assert ran.returncode == 2
    assert "token create" in ran.stderr


def test_tokens_from_the_command_line(tmp_path: Path, drills: ModuleType) -> None:
    data = ("--data", str(tmp_path / "data"))
    made = program("token", "create", "--scope", "read", "--name", "me", *data)
    assert made.returncode == 0
    token = made.stdout.strip()
    listed = program("token", "list", *data).stdout
    assert token not in listed
    assert "read" in listed
    assert "me" in listed
    id = listed.split()[0]
    server = drills.Server(tmp_path / "data", more=("--host", "0.0.0.0"))
    server.start()
    try:
        headers = {"Authorization": f"Bearer {token}"}
        assert httpx.get(f"{server.url}/api/v1/jobs").status_code == 401
        assert httpx.get(f"{server.url}/api/v1/jobs", headers=headers).status_code == 200
        assert program("token", "revoke", id, *data).returncode == 0
        for _ in range(TRIES):
            if httpx.get(f"{server.url}/api/v1/jobs", headers=headers).status_code == 401:
                break
            time.sleep(0.05)
        else:
            raise AssertionError("a revoked token still opens")
        assert token not in server.log.read_text()
    finally:
        server.stop()
    assert program("token", "revoke", id, *data).returncode == 2
    assert program("token", "create", "--scope", "all", "--name", "x", *data).returncode == 2


def test_help_has_an_example() -> None:
    ran = program("serve", "--help")
    assert ran.returncode == 0
    assert "Example: physretarget serve" in ran.stdout
    assert "Example: physretarget token" in program("token", "--help").stdout


@pytest.mark.parametrize(
    ("limit", "says"),
    [("nothing=1", "there are"), ("seconds=x", "needs a number"), ("seconds=-1", "above zero")],
)
def test_limits_that_make_no_sense(tmp_path: Path, limit: str, says: str) -> None:
    ran = program("serve", "--port", "0", "--data", str(tmp_path), "--limit", limit)
    assert ran.returncode == 2
    assert says in ran.stderr


def test_a_missing_extra_is_one_sentence(tmp_path: Path) -> None:
    hide = tmp_path / "sitecustomize.py"
    hide.write_text(
        "import importlib.util\nfind = importlib.util.find_spec\n"
        "importlib.util.find_spec = lambda n, *a: None if n == 'fastapi' else find(n, *a)\n"
    )
    ran = subprocess.run(
        [sys.executable, "-m", "physretarget", "serve", "--port", "0"], capture_output=True,
        text=True, cwd=tmp_path, check=False, env={**os.environ, "PYTHONPATH": str(tmp_path)},
    )  # fmt: skip
    assert ran.returncode == 2
    assert "physretarget[service]" in ran.stderr
    assert ran.stderr.count("\n") == 1


def test_the_server_does_not_load_what_only_jobs_need() -> None:
    """It starts in a second, and files of strangers could not reach MuJoCo here by mistake."""
    ran = subprocess.run(
        [sys.executable, "-c", "import physretarget.service.server, sys; "
         "print(sorted({'mujoco', 'scipy', 'casadi'} & set(sys.modules)))"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert ran.stdout.strip() == "[]"
