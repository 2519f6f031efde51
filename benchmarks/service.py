"""Many clients, one service that is killed again and again: every job ends once, none is lost.

    python -m benchmarks.service [--jobs 500] [--clients 20] [--kills 3] [--workers 2]

A real server process over loopback with a history in SQLite. A trigger in the database writes
down every end of a job, so that one that ended twice would show. Meanwhile /health is asked
twenty times a second. Clients send each job until it is accepted, with an idempotency key.
"""

from __future__ import annotations

import argparse
import collections
import json
import os
import signal
import socket
import sqlite3
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path

import httpx
import numpy as np

from physretarget.clip import Clip

BOX = """<mujoco model="box">
  <worldbody>
    <geom name="floor" type="plane" size="5 5 0.1"/>
    <body name="box" pos="0 0 0.1">
      <freejoint name="root"/>
      <geom name="box" type="box" size="0.2 0.1 0.1" density="500"/>
    </body>
  </worldbody>
</mujoco>
"""
_PATIENCE_S = 60.0


def box_clip(slide: float = 0.0) -> bytes:
    """A box that stands for a second, or slides at m/s."""
    time_ = np.arange(31) / 30.0
    qpos = np.zeros((31, 7))
    qpos[:, 0], qpos[:, 2], qpos[:, 3] = slide * time_, 0.1, 1.0
    return Clip(qpos=qpos, time=time_, joint_names=("root",)).to_bytes()


class Server:
    """A ``physretarget serve`` that can be killed and started again on the same port."""

    def __init__(self, data: Path, *, workers: int = 2, more: tuple[str, ...] = ()) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = int(free.getsockname()[1])
        self.data = data
        self.url = f"http://127.0.0.1:{self.port}"
        self._workers = workers
        self._more = more
        self.log = data.parent / "server.log"
        self.process: subprocess.Popen[bytes] | None = None
        self.stopped_at = 0.0

    def start(self) -> None:
        """Start it and wait until it answers."""
        with open(self.log, "ab") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "physretarget", "serve", "--port", str(self.port),
                 "--data", str(self.data), "--workers", str(self._workers), "--rate", "0",
                 *self._more],
                stdout=subprocess.DEVNULL, stderr=log,
            )  # fmt: skip
        until = time.monotonic() + _PATIENCE_S
        while time.monotonic() < until:
            try:
                httpx.get(f"{self.url}/health", timeout=2)
                return
            except httpx.HTTPError:
                if self.process.poll() is not None:
                    raise RuntimeError(self.log.read_text()[-2000:]) from None
                time.sleep(0.05)
        raise RuntimeError("the server does not answer")

    def children(self) -> list[int]:
        """Processes that the server has started, and theirs."""
        assert self.process is not None
        found, waiting = [], [self.process.pid]
        while waiting:
            out = subprocess.run(["ps", "-o", "pid=", "--ppid", str(waiting.pop())],
                                 capture_output=True, text=True, check=False).stdout  # fmt: skip
            pids = [int(word) for word in out.split()]
            found += pids
            waiting += pids
        return found

    def kill(self) -> None:
        """As the kernel would."""
        assert self.process is not None
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()

    def stop(self) -> int:
        """As an administrator would."""
        assert self.process is not None
        self.process.send_signal(signal.SIGTERM)
        return self.process.wait(60)


@dataclass
class Told:
    """What a drill found."""

    jobs: int
    seconds: float = 0.0
    statuses: dict[str, int] = field(default_factory=dict)
    ended_twice: int = 0
    never_ended: int = 0
    attempts: dict[int, int] = field(default_factory=dict)
    folders: int = 0
    orphans: int = 0
    health_ms: list[float] = field(default_factory=list)

    @property
    def fine(self) -> bool:
        """Every job ended once, and well."""
        return (
            self.statuses == {"done": self.jobs} and not self.ended_twice and not self.never_ended
            and self.folders == self.jobs and not self.orphans
        )  # fmt: skip


def drill(folder: Path, *, jobs: int, clients: int, kills: int, workers: int = 2) -> Told:
    """Submit, kill, restart, wait, count."""
    server = Server(folder / "data", workers=workers)
    server.start()
    _watch_ends(folder / "data" / "history.db")
    told = Told(jobs)
    began = time.monotonic()
    over = threading.Event()
    asked = threading.Thread(target=_health, args=(server, told, over))
    asked.start()
    with httpx.Client(base_url=server.url, timeout=30) as client:
        model = _until_accepted(
            client, "/api/v1/models", {}, {"file": ("box.xml", BOX.encode())}, "", over
        )["id"]
    ids: list[str] = []
    threads = [
        threading.Thread(target=_client, args=(server, model, range(n, jobs, clients), ids, over))
        for n in range(clients)
    ]
    for thread in threads:
        thread.start()
    try:
        for number in range(kills):
            _wait(server, folder, jobs * (number + 1) // (kills + 1))
            children = server.children()
            server.kill()
            time.sleep(0.3)
            told.orphans += sum(_alive(pid) for pid in children)
            server.start()
        for thread in threads:
            thread.join()
        _wait(server, folder, jobs)
        told.seconds = time.monotonic() - began
    finally:
        over.set()
        asked.join()
        server.stop()
    _count(folder / "data", told, ids)
    return told


def _watch_ends(database: Path) -> None:
    with sqlite3.connect(database, timeout=30) as connection:
        connection.execute("CREATE TABLE ends (job TEXT, status TEXT)")
        connection.execute(
            "CREATE TRIGGER ended AFTER UPDATE OF status ON service_jobs "
            "WHEN NEW.status IN ('done', 'failed', 'cancelled') "
            "BEGIN INSERT INTO ends VALUES (NEW.id, NEW.status); END"
        )
    connection.close()


def _health(server: Server, told: Told, over: threading.Event) -> None:
    with httpx.Client(timeout=10) as client:
        while not over.wait(0.05):
            began = time.perf_counter()
            try:
                client.get(f"{server.url}/health")
            except httpx.HTTPError:
                continue  # it was just killed
            told.health_ms.append(1e3 * (time.perf_counter() - began))


def _client(
    server: Server, model: str, numbers: range, ids: list[str], over: threading.Event
) -> None:
    with httpx.Client(base_url=server.url, timeout=30) as client:
        _submit(client, model, numbers, ids, over)


def _submit(
    client: httpx.Client, model: str, numbers: range, ids: list[str], over: threading.Event
) -> None:
    for number in numbers:
        content = box_clip(1e-3 * number)
        files = {"clip": (f"box-{number:04d}.npz", content)}
        made = _until_accepted(
            client, "/api/v1/jobs", {"model": model}, files, f"drill-{number}", over
        )
        ids.append(made["id"])


def _until_accepted(
    client: httpx.Client, path: str, data: dict[str, str], files: dict[str, tuple[str, bytes]],
    key: str, over: threading.Event,
) -> dict[str, str]:  # fmt: skip
    while not over.is_set():
        try:
            answer = client.post(
                path, data=data, files=files,
                headers={"Idempotency-Key": key} if key else {},
            )  # fmt: skip
        except httpx.HTTPError:
            time.sleep(0.1)
            continue
        if answer.status_code in (201, 202):
            made: dict[str, str] = answer.json()
            return made
        if answer.status_code not in (429, 503):
            raise RuntimeError(answer.text)
        time.sleep(0.2)
    raise RuntimeError("the drill is over")


def _wait(server: Server, folder: Path, ended: int) -> None:
    until = time.monotonic() + 1800
    while time.monotonic() < until:
        with sqlite3.connect(folder / "data" / "history.db", timeout=30) as connection:
            found = connection.execute("SELECT count(*) FROM ends").fetchone()[0]
        connection.close()
        if found >= ended:
            return
        if server.process is not None and server.process.poll() is not None:
            raise RuntimeError("the server has ended by itself")
        time.sleep(0.1)
    raise RuntimeError(f"only {found} jobs have ended")


def _alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


def _count(data: Path, told: Told, ids: list[str]) -> None:
    with sqlite3.connect(data / "history.db") as connection:
        rows = connection.execute("SELECT id, status, attempts FROM service_jobs").fetchall()
        ends = collections.Counter(
            job for (job,) in connection.execute("SELECT job FROM ends").fetchall()
        )
    connection.close()
    told.statuses = dict(collections.Counter(status for _, status, _ in rows))
    told.attempts = dict(collections.Counter(attempts for _, _, attempts in rows))
    told.ended_twice = sum(count > 1 for count in ends.values())
    told.never_ended = sum(ends[job] == 0 for job in {*ids, *(row[0] for row in rows)})
    told.folders = sum(
        (data / "jobs" / id).is_dir() and len(os.listdir(data / "jobs" / id)) == 1 for id in ids
    )


def main() -> None:
    """Run the drill and print what it found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jobs", type=int, default=500)
    parser.add_argument("--clients", type=int, default=20)
    parser.add_argument("--kills", type=int, default=3)
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="physretarget-drill-") as folder:
        told = drill(
            Path(folder), jobs=asked.jobs, clients=asked.clients, kills=asked.kills,
            workers=asked.workers,
        )  # fmt: skip
    latency = sorted(told.health_ms)
    print(f"{asked.jobs} jobs from {asked.clients} clients, {asked.kills} kills: "
          f"{told.seconds:.0f} s, {json.dumps(told.statuses)}")  # fmt: skip
    print(f"ended twice {told.ended_twice}, never {told.never_ended}, "
          f"jobs with one folder of results {told.folders}, orphans {told.orphans}")  # fmt: skip
    print(f"attempts {json.dumps(told.attempts)}")
    if latency:
        at = [latency[min(int(len(latency) * q), len(latency) - 1)] for q in (0.5, 0.95, 0.99, 1)]
        print("health, ms: " + ", ".join(
            f"{name} {value:.1f}" for name, value in zip(("median", "95 %", "99 %", "most"), at,
                                                         strict=True)))  # fmt: skip
    sys.exit(0 if told.fine else 1)


if __name__ == "__main__":
    main()
