"""Every malicious upload against a real server: what it answers, how fast, with how much memory.

    python benchmarks/hostile.py

Starts ``physretarget serve`` on a free port, sends all uploads of tests/sandbox/malicious.py one
after the other, and meanwhile asks ``/health`` all the time. Prints a line for every upload and
a summary; exit code 1 if one was not refused, met a 5xx, or something outside was opened.
"""

from __future__ import annotations

import importlib.util
import os
import re
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path
from types import ModuleType
from typing import Any

import httpx

TESTS = Path(__file__).resolve().parents[1] / "tests" / "sandbox"


def _load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, TESTS / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


malicious = _load("malicious")
Watch = _load("watch").Watch


class Observer(threading.Thread):
    """Asks for the server's health and looks at the memory of all its processes."""

    def __init__(self, url: str, server: int) -> None:
        super().__init__(daemon=True)
        self.url, self.server = url, server
        self.seconds: list[float] = []
        self.largest: Counter[str] = Counter()  # kB by what the process is
        self.stopped = threading.Event()

    def run(self) -> None:
        with httpx.Client(timeout=30) as client:
            while not self.stopped.wait(0.02):
                began = time.perf_counter()
                client.get(f"{self.url}/health").raise_for_status()
                self.seconds.append(time.perf_counter() - began)
                self._weigh()

    def _weigh(self) -> None:
        parents = {}
        for entry in Path("/proc").glob("[0-9]*/stat"):
            try:
                parents[int(entry.parent.name)] = int(
                    entry.read_text().rpartition(")")[2].split()[1]
                )
            except OSError:
                continue
        for pid in parents:
            depth, at = 0, pid
            while at in parents and at != self.server and depth < 5:
                at, depth = parents[at], depth + 1
            if at == self.server:
                what = ("server", "warm process", "job")[min(depth, 2)]
                try:
                    status = Path(f"/proc/{pid}/status").read_text()
                except OSError:
                    continue
                found = re.search(r"VmRSS:\s+(\d+)", status)
                if found:
                    self.largest[what] = max(self.largest[what], int(found[1]))


def send(client: httpx.Client, case: Any) -> tuple[int, str]:
    """The status and message of the refusal; status 0 for a job that failed as it should."""
    content = {"file": (case.filename, case.content())}
    if case.kind == "model":
        answer = client.post("/api/v1/models", files=content)
        return answer.status_code, answer.text
    kind, role, model = (
        ("validate", "clip", "model")
        if case.kind == "clip"
        else ("retarget", "capture", "character")
    )
    data = {"kind": kind, model: "lamp"}
    if case.options:
        data["options"] = '{"fps": 30}'
    answer = client.post("/api/v1/jobs", data=data, files={role: content["file"]})
    if answer.status_code != 202:
        return answer.status_code, answer.text
    place = answer.headers["Location"]
    for _ in range(600):
        job = client.get(place).json()
        if job["status"] not in ("queued", "running"):
            told = job["error"] or {}
            refused = job["status"] == "failed" and told.get("code") in (
                "input",
                "timeout",
                "memory",
            )
            return (0 if refused else 599), f"{job['status']} {told}"
        time.sleep(0.05)
    return 599, "never ended"


def main() -> int:
    watch = Watch(malicious.write_canaries())
    wrong = []
    with tempfile.TemporaryDirectory() as folder:
        server = subprocess.Popen(
            [sys.executable, "-m", "physretarget", "serve", "--port", "0", "--data", folder,
             "--rate", "0"],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip
        assert server.stdout is not None
        url = ""
        for line in server.stdout:
            found = re.search(r"http://[\w.:]+", line)
            if found:
                url = found[0]
                break
        threading.Thread(target=server.stdout.read, daemon=True).start()
        client = httpx.Client(base_url=url, timeout=120)
        client.get("/health").raise_for_status()
        # The first job waits for the imports, which is not what is measured.
        client.post("/api/v1/models", files={"file": ("box.xml", malicious.MODEL)})
        observer = Observer(url, server.pid)
        observer.start()
        took = {}
        for case in malicious.CASES:
            watch.seen()
            began = time.perf_counter()
            status, text = send(client, case)
            took[case.name] = time.perf_counter() - began
            seen = watch.seen()
            good = (status == 0 or 400 <= status < 500) and not seen
            good = good and malicious.CANARY not in text and folder not in text
            print(f"{'' if good else 'NOT REFUSED '}{case.name:24} {took[case.name]:6.2f} s "
                  f"{status or 'job'} {' '.join(text.split())[:110]} {seen or ''}")  # fmt: skip
            if not good:
                wrong.append(case.name)
        observer.stopped.set()
        observer.join()
        server.terminate()
        server.wait(30)
    health = sorted(observer.seconds)
    slowest = max(took, key=lambda name: took[name])
    print(f"\n{len(took)} uploads, not refused as they should: {wrong or 0}")
    print(f"slowest: {slowest} {took[slowest]:.2f} s, all {sum(took.values()):.0f} s")
    middle, late, last = (
        1e3 * x for x in (statistics.median(health), health[int(0.99 * len(health))], health[-1])
    )
    print(f"health, {len(health)} times: {middle:.1f} ms, 99 % {late:.1f} ms, most {last:.1f} ms")
    print("largest resident memory: "
          + ", ".join(f"{k} {v / 1024:.0f} MiB" for k, v in observer.largest.items()))  # fmt: skip
    print(f"processors: {os.cpu_count()}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
