"""A confined child: what it may not do, how it ends, and that nothing of it stays."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from physretarget.errors import PhysretargetError, UsageError
from physretarget.sandbox import child, confine
from physretarget.sandbox.child import ChildError, open_result
from physretarget.sandbox.limits import GIB, MIB, Limits
from physretarget.sandbox.pool import Pool

Run = Callable[..., dict[str, Any]]
TRIALS = "physretarget.sandbox.trials:"
LIMITS = Limits(
    seconds=10, cpu_seconds=5, memory_bytes=GIB // 2, file_bytes=8 * MIB, folder_bytes=24 * MIB
)


@pytest.fixture(scope="module")
def pool() -> Iterator[Pool]:
    with Pool(("physretarget.sandbox.trials",)) as pool:
        yield pool


@pytest.fixture(params=["spawned", "forked"])
def run(request: pytest.FixtureRequest, pool: Pool, tmp_path: Path) -> Run:
    runner = child.run if request.param == "spawned" else pool.run
    folder = tmp_path / "job"
    folder.mkdir()

    def go(task: str, limits: Limits = LIMITS, **asked: Any) -> dict[str, Any]:
        how = {k: asked.pop(k) for k in ("inputs", "progress", "cancelled") if k in asked}
        return runner(TRIALS + task, asked, folder=folder, limits=limits, **how)

    return go


def fails(run: Run, task: str, **asked: Any) -> ChildError:
    with pytest.raises(ChildError) as caught:
        run(task, **asked)
    return caught.value


def test_answers_and_tells_progress(run: Run) -> None:
    told: list[tuple[float, str]] = []
    answer = run("nothing", progress=lambda fraction, stage: told.append((fraction, stage)), a=[1])
    assert answer == {"request": {"a": [1]}}
    assert told == [(0.5, "half")]


def test_only_listed_tasks(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no task"):
        child.run("os:system", {}, folder=tmp_path, limits=LIMITS)


@pytest.mark.skipif(
    confine.available().landlock < 6 or not confine.available().seccomp,
    reason="this kernel lacks Landlock or seccomp",
)
def test_every_way_out_is_shut(run: Run, tmp_path: Path) -> None:
    outside = tmp_path / "elsewhere" / "secret"
    outside.parent.mkdir()
    outside.write_text("canary")
    found = run("reach", outside=str(outside), server=os.getpid())
    assert len(found) > 25
    assert {name for name, how in found.items() if not how.startswith("refused")} == set()
    assert outside.read_text() == "canary"
    assert [p.name for p in outside.parent.iterdir()] == ["secret"]


def test_reads_what_is_declared(run: Run, tmp_path: Path) -> None:
    told = tmp_path / "input.txt"
    told.write_text("hello")
    assert run("read", inputs=(told,), path=str(told)) == {"content": "hello"}
    if confine.available().landlock:
        assert fails(run, "read", path=str(told)).error == "PermissionError"


def test_environment_is_scrubbed(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DATABASE_PASSWORD", "canary")
    content = run("read", path="/proc/self/environ")["content"]
    assert "canary" not in content
    assert "OMP_NUM_THREADS=1" in content


def test_memory_is_bounded(run: Run) -> None:
    assert fails(run, "hold").kind == "memory"


def test_processor_time_is_bounded(run: Run) -> None:
    limits = Limits(seconds=20, cpu_seconds=1)
    assert fails(run, "burn", limits=limits).kind == "timeout"


def test_wall_clock_is_bounded(run: Run) -> None:
    began = time.monotonic()
    assert fails(run, "wait", limits=Limits(seconds=0.5), seconds=60).kind == "timeout"
    assert time.monotonic() - began < 3


def test_cancelled(run: Run) -> None:
    began = time.monotonic()
    error = fails(run, "wait", seconds=60, cancelled=lambda: time.monotonic() - began > 0.3)
    assert error.kind == "cancelled"
    assert time.monotonic() - began < 3


def test_files_are_bounded(run: Run) -> None:
    assert fails(run, "fill", files=1, bytes=9 * MIB).kind == "crash"
    assert "wrote more" in fails(run, "fill", files=100, bytes=7 * MIB).message


@pytest.mark.parametrize(("first", "last"), [(1, 64), (1, 1), (2, 2), (3, 64)])
def test_floods_are_bounded(run: Run, first: int, last: int) -> None:
    error = fails(run, "flood", first=first, last=last)
    # Where the machine is busy the flood may use up its processor time before it is read.
    assert "sent more" in error.message or error.kind == "timeout"
    assert len(error.log) < 20_000


@pytest.mark.parametrize(
    ("how", "kind", "says"),
    [
        ("input", "input", "clip.npz, frame 3: no good."),
        ("bug", "crash", "KeyError"),
        ("answer", "crash", "no plain data"),
        ("number", "crash", "no plain data"),
        ("exit", "crash", "status 3"),
        ("print", "crash", "status 4"),
        ("SIGSEGV", "crash", "signal 11"),
        ("SIGKILL", "crash", "signal 9"),
    ],
)
def test_ends(run: Run, how: str, kind: str, says: str) -> None:
    error = fails(run, "fail", how=how)
    assert error.kind == kind
    assert says in error.message
    assert error.frame == (3 if how == "input" else None)


def test_long_answers_are_refused(run: Run) -> None:
    limits = Limits(answer_bytes=MIB)
    assert "too long" in fails(run, "fail", limits=limits, how="long", bytes=MIB).message


def test_long_requests_are_refused(run: Run) -> None:
    assert fails(run, "nothing", limits=Limits(request_bytes=100), a="x" * 100).kind == "input"


def test_nothing_stays(run: Run, tmp_path: Path) -> None:
    fails(run, "wait", limits=Limits(seconds=1), seconds=60)
    pid = int((tmp_path / "job" / "pid").read_text())
    assert gone(pid)


def gone(pid: int, within: float = 5.0) -> bool:
    until = time.monotonic() + within
    while time.monotonic() < until:
        try:
            if Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z":
                return True
        except OSError:
            return True
        time.sleep(0.02)
    return False


SERVER = """
import sys
from pathlib import Path
from physretarget.sandbox import child
from physretarget.sandbox.limits import Limits
from physretarget.sandbox.pool import Pool
run = Pool(("physretarget.sandbox.trials",)).run if sys.argv[2] == "forked" else child.run
run("physretarget.sandbox.trials:wait", {"seconds": 600}, folder=Path(sys.argv[1]), limits=Limits())
"""


@pytest.mark.parametrize("how", ["spawned", "forked"])
def test_dies_with_the_server(how: str, tmp_path: Path) -> None:
    server = subprocess.Popen([sys.executable, "-c", SERVER, str(tmp_path), how])
    told = tmp_path / "pid"
    until = time.monotonic() + 30
    while not (told.exists() and told.read_text()) and time.monotonic() < until:
        time.sleep(0.05)
    pid = int(told.read_text())
    server.send_signal(signal.SIGKILL)
    server.wait()
    assert gone(pid)


def test_many_threads_share_a_pool(pool: Pool, tmp_path: Path) -> None:
    def job(number: int) -> int:
        answer = pool.run(f"{TRIALS}nothing", {"n": number}, folder=tmp_path, limits=LIMITS)
        return int(answer["request"]["n"])

    with ThreadPoolExecutor(8) as threads:
        assert list(threads.map(job, range(60))) == list(range(60))


def test_pool_outlives_its_process(tmp_path: Path) -> None:
    with Pool(("physretarget.sandbox.trials",)) as pool:
        pool.start()
        assert pool._process is not None
        pool._process.kill()
        assert pool.run(f"{TRIALS}nothing", {}, folder=tmp_path, limits=LIMITS)
        before = len(os.listdir("/proc/self/fd"))
        pool.run(f"{TRIALS}nothing", {}, folder=tmp_path, limits=LIMITS)
        with pytest.raises(ChildError):
            pool.run(f"{TRIALS}fail", {"how": "exit"}, folder=tmp_path, limits=LIMITS)
        assert len(os.listdir("/proc/self/fd")) == before


def test_pool_may_be_started_by_a_thread_that_ends(tmp_path: Path) -> None:
    with Pool(("physretarget.sandbox.trials",)) as pool:
        thread = threading.Thread(target=pool.start)
        thread.start()
        thread.join()
        first = pool._process
        pool.run(f"{TRIALS}nothing", {}, folder=tmp_path, limits=LIMITS)
        assert pool._process is first


def test_pool_says_why_it_does_not_start() -> None:
    with (
        pytest.raises(PhysretargetError, match="No module named"),
        Pool(("physretarget.nowhere",)) as pool,
    ):
        pool.start()


@pytest.mark.parametrize("name", ["link", "folder", "missing", "../job/file", "hard", "large"])
def test_results_are_plain_files(name: str, tmp_path: Path) -> None:
    folder = tmp_path / "job"
    (folder / "folder").mkdir(parents=True)
    (folder / "file").write_text("good")
    (tmp_path / "secret").write_text("canary")
    (folder / "link").symlink_to(tmp_path / "secret")
    (folder / "hard").hardlink_to(tmp_path / "secret")
    (folder / "large").write_bytes(bytes(LIMITS.file_bytes + 1))
    with open_result(folder, "file", limits=LIMITS) as file:
        assert file.read() == b"good"
    with pytest.raises(ChildError):
        open_result(folder, name, limits=LIMITS)


def test_machines_without_the_walls_say_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(confine, "available", lambda: confine.Walls(landlock=0, seccomp=False))
    assert len(confine.available().missing) == 2
    assert confine.Walls(landlock=1, seccomp=True).missing == ()
    # Both do nothing then; this process could not be tested further otherwise.
    confine.restrict_files([], [])
    confine.restrict_calls()
    Path("/proc/self/status").read_text()


def test_limits_are_checked() -> None:
    assert Limits.from_dict(Limits(seconds=3).to_dict()) == Limits(seconds=3)
    with pytest.raises(UsageError, match="above zero"):
        Limits(seconds=0)
    with pytest.raises(UsageError, match="no limit 'minutes'"):
        Limits.from_dict({"minutes": 5})
