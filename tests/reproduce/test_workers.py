from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from physretarget.reproduce.workers import each_done

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="there are no signals there")

# Run as a program: each job says who does it, and all but the first last for a minute.
LONG = """
import os, signal, sys, time
from pathlib import Path
from physretarget.reproduce.workers import each_done

def work(job):
    Path(sys.argv[1], f"{os.getpid()}").touch()
    time.sleep(60 if job else 0)
    return job

if __name__ == "__main__":
    # A shell lets its background jobs ignore SIGINT, and what they start inherits that.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for job, done in each_done(work, [0, 1, 2], 2):
        print("done", job, flush=True)
"""


def double(job: int) -> int:
    return 2 * job


def test_every_job_comes_back_with_its_result() -> None:
    threads = os.environ.get("OMP_NUM_THREADS")
    assert sorted(each_done(double, [1, 2, 3], 2)) == [(1, 2), (2, 4), (3, 6)]
    assert os.environ.get("OMP_NUM_THREADS") == threads
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


def fail(job: int) -> int:
    raise ValueError(f"job {job}")


def test_an_error_of_a_job_is_the_callers() -> None:
    with pytest.raises(ValueError, match="job"):
        list(each_done(fail, [1], 2))


@pytest.mark.parametrize(
    ("sent", "code"),
    [(signal.SIGTERM, 143), (signal.SIGINT, -signal.SIGINT), (signal.SIGKILL, -signal.SIGKILL)],
)
def test_workers_end_with_the_run(tmp_path: Path, sent: signal.Signals, code: int) -> None:
    program = tmp_path / "program.py"
    program.write_text(LONG)
    pids = tmp_path / "pids"
    pids.mkdir()
    run = subprocess.Popen(
        [sys.executable, program, pids], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
    assert run.stdout is not None
    assert run.stdout.readline() == b"done 0\n"
    _until(lambda: len(list(pids.iterdir())) == 2, 20.0)
    os.kill(run.pid, sent)
    assert run.wait(timeout=20.0) == code
    for pid in (int(file.name) for file in pids.iterdir()):
        _until(lambda p=pid: not _alive(p), 10.0)


def _until(true: object, seconds: float) -> None:
    assert callable(true)
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end
        time.sleep(0.05)


def _alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except OSError:
        return False
    return state != "Z"
