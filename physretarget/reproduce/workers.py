"""Worker processes that never outlive the run, however it ends."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from multiprocessing.connection import Connection
from types import FrameType
from typing import TypeVar

Job = TypeVar("Job")
Done = TypeVar("Done")

_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")


def each_done(
    work: Callable[[Job], Done], jobs: Sequence[Job], processes: int
) -> Iterator[tuple[Job, Done]]:
    """Do all jobs in ``processes`` new processes and yield each with its result when finished.

    When the caller leaves early, by an error, Ctrl-C or SIGTERM (turned into SystemExit(143)),
    or when this process dies in whatever way, the workers end at once.

    Raises:
        BrokenProcessPool: a worker was ended from outside.
    """
    spawn = multiprocessing.get_context("spawn")
    watched, lifeline = spawn.Pipe(duplex=False)
    with (
        _environment(_ONE_THREAD),  # libraries read it as they are loaded
        _terminated_as_exit(),
        ProcessPoolExecutor(
            processes, mp_context=spawn, initializer=_begin, initargs=(watched,)
        ) as pool,
    ):
        try:
            running = {pool.submit(work, job): job for job in jobs}
            for future in as_completed(running):
                yield running[future], future.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
        finally:
            lifeline.close()  # finished or given up: what still runs may end
            watched.close()


def _begin(watched: Connection) -> None:
    """In a worker: Ctrl-C is for the parent to answer, and the lifeline is watched."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(watched,), daemon=True).start()


def _end_with(watched: Connection) -> None:
    """End this process when nobody holds the other end: the kernel closes it with the parent."""
    try:
        watched.recv_bytes()
    except (EOFError, OSError):
        os._exit(1)


@contextmanager
def _environment(values: dict[str, str]) -> Iterator[None]:
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


@contextmanager
def _terminated_as_exit() -> Iterator[None]:
    """SIGTERM unwinds the stack like Ctrl-C does; only a main thread may say so."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def leave(number: int, _: FrameType | None) -> None:
        raise SystemExit(128 + number)

    before = signal.signal(signal.SIGTERM, leave)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
