"""Worker threads: claim a job, run it in a child process, put its results in place, finish it.

The order is what makes a kill harmless: results are renamed into a folder of this attempt, then
one conditional UPDATE ends the job and names that folder. Died before: the job is claimed again.
Died after: it has ended. A claim that was lost finds that its UPDATE changes nothing.
"""

from __future__ import annotations

import logging
import os
import secrets
import shutil
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal, Protocol, get_args

from physretarget.errors import PhysretargetError
from physretarget.options.judging import Verdict
from physretarget.sandbox.child import ChildError, open_result
from physretarget.sandbox.limits import Limits
from physretarget.service.home import Home, remove
from physretarget.service.metrics import Metrics
from physretarget.service.work import prepare
from physretarget.suite.queue import ATTEMPTS, JobRecord, Queue

log = logging.getLogger("physretarget.service.worker")

RESULTS = (
    "report.json", "report.html", "report.sarif", "report.junit.xml", "report.md", "report.txt",
    "replay.html", "motion.z", "model.z", "clip.npz",
)  # fmt: skip
_NEEDED = frozenset(RESULTS) - {"clip.npz"}
_IDLE_S = 1.0  # another process may have queued something, or a lease have run out
_TELL_S = 0.2
_LONGEST_PAUSE_S = 30.0
_CRASHES = 2  # a job whose process died that often has itself to blame
_LONGEST_TEXT = 1000  # characters of a reason or a cause that a child may give


class Runner(Protocol):
    """Runs a task in a child process: :class:`physretarget.sandbox.pool.Pool`."""

    def run(
        self,
        task: str,
        request: Mapping[str, Any],
        *,
        folder: Path,
        limits: Limits,
        inputs: Any = (),
        progress: Callable[[float, str], None] | None = None,
        cancelled: Callable[[], bool] | None = None,
    ) -> dict[str, Any]:
        """As :func:`physretarget.sandbox.child.run`."""


class Supervisor:
    """The worker threads of one service."""

    def __init__(
        self,
        queue: Queue,
        home: Home,
        runner: Runner,
        *,
        limits: Limits,
        workers: int,
        lease: float,
        heartbeat: float,
        metrics: Metrics,
        released: Callable[[JobRecord], None],
        full: Callable[[], bool] = lambda: False,
    ) -> None:
        self._queue, self._home, self._runner = queue, home, runner
        self._limits, self._lease, self._heartbeat = limits, lease, heartbeat
        self._metrics = metrics
        self._released, self._full = released, full
        self._wake = threading.Condition()
        self._stopping = threading.Event()
        self._cancelled: set[str] = set()
        self._pause = _Pause()
        # In a container every server has the same process id: a claim needs more of a name.
        me = f"{os.getpid()}-{secrets.token_hex(4)}"
        self._threads = [
            threading.Thread(target=self._work, args=(f"{me}-{n}",), name=f"worker-{n}")
            for n in range(workers)
        ]

    @property
    def workers(self) -> int:
        """Worker threads that live."""
        return sum(thread.is_alive() for thread in self._threads)

    def start(self) -> None:
        """Begin to claim jobs."""
        for thread in self._threads:
            thread.start()

    def notify(self) -> None:
        """A job was queued."""
        with self._wake:
            self._wake.notify()

    def cancel(self, id: str) -> None:
        """A job was cancelled: end its child now rather than at the next heartbeat."""
        self._cancelled.add(id)

    def stop(self) -> None:
        """End the children, give their jobs back to the queue, and wait for the threads."""
        self._stopping.set()
        with self._wake:
            self._wake.notify_all()
        for thread in self._threads:
            if thread.ident is not None:
                thread.join()

    # ---- a worker ------------------------------------------------------------------------------

    def _work(self, owner: str) -> None:
        while not self._stopping.is_set():
            try:
                # What begins on a full disk ends half done: it waits, and is no failure.
                job = None if self._full() else self._queue.claim(owner, self._lease)
                if job is not None:
                    self._do(job)
                    continue
            except PhysretargetError as error:
                log.error("the queue cannot be reached: %s", error)
            except Exception:
                # The thread goes on: the job's lease runs out and it is tried again.
                log.exception("a worker met a bug")
            with self._wake:
                if not self._stopping.is_set():
                    self._wake.wait(_IDLE_S)

    def _do(self, job: JobRecord) -> None:
        began = time.monotonic()
        if job.attempts > ATTEMPTS:
            told = {"code": "crash", "message": f"given up after {ATTEMPTS} attempts."}
            self._finish(job, "failed", began, error=told)
            return
        folder = self._home.job(job.id)
        work = folder / f".work-{job.attempts}"
        watch = _Watch(self, job)
        try:
            remove(work)
            work.mkdir(parents=True, mode=0o700)
            task = prepare(job, self._home, work, self._limits)
            answer = self._runner.run(
                task.name, task.request, folder=work, limits=self._limits, inputs=task.inputs,
                progress=watch.progress, cancelled=watch.cancelled,
            )  # fmt: skip
            result = self._keep(job, work, folder)
            self._finish(job, "done", began, result=result, summary=_summary(answer))
        except ChildError as error:
            self._failed(job, watch, error, began)
        except (OSError, PhysretargetError) as error:
            # The disk or the database, not the job: it waits for better times, unjudged.
            log.error("job %s waits: %s", job.id, error, extra={"job": job.id})
            self._insist(lambda: self._queue.give_back(job))
            self._stopping.wait(self._pause.next())
        except Exception:
            # A bug of ours: the client is told, the worker goes on.
            log.exception("job %s cannot be run", job.id, extra={"job": job.id})
            told = {"code": "internal", "message": "The service could not run the job."}
            self._finish(job, "failed", began, error=told)
        else:
            self._pause.reset()
        finally:
            self._cancelled.discard(job.id)
            remove(work)

    def _failed(self, job: JobRecord, watch: _Watch, error: ChildError, began: float) -> None:
        if watch.verdict == "lost":
            log.warning("job %s was lost to another claim", job.id, extra={"job": job.id})
        elif watch.verdict == "stop":
            self._queue.give_back(job)
        elif error.kind == "cancelled":
            self._finish(job, "cancelled", began)
        elif error.kind == "crash" and job.attempts < _CRASHES:
            # Who killed it is not known: once more, and only then is it the job's fault.
            log.warning("job %s crashed and is tried again", job.id, extra={"job": job.id})
            self._insist(lambda: self._queue.give_back(job, counted=True))
        else:
            self._metrics.failures.labels(error.kind).inc()
            if error.log:
                log.warning(
                    "job %s failed (%s)", job.id, error.kind,
                    extra={"job": job.id, "child": error.log[-2000:]},
                )  # fmt: skip
            told = {"code": error.kind, "message": error.message}
            self._finish(job, "failed", began, error=told)

    def _insist(self, step: Callable[[], bool]) -> bool:
        """Do a step of the queue as soon as the database lets us; False when stopping first.

        A job's end must not be lost to an outage: its lease may run out meanwhile, and then the
        step changes nothing.
        """
        pause = _Pause()
        while True:
            try:
                return step()
            except PhysretargetError as error:
                log.error("the queue cannot be reached: %s", error)
                if self._stopping.wait(pause.next()):
                    return False

    def _keep(self, job: JobRecord, work: Path, folder: Path) -> str:
        """Move what the child left, as far as it is what it should be, into the attempt's folder.

        It died before, so nothing changes any more; what else it may have left goes away.
        """
        name = f"{job.attempts}"
        beside, place = folder / f".work-{name}-kept", folder / name
        remove(beside)
        beside.mkdir(mode=0o700)
        for each in RESULTS:
            try:
                with open_result(work, each, limits=self._limits):
                    os.rename(work / each, beside / each)
            except ChildError:
                if each in _NEEDED:
                    remove(beside)
                    raise
        remove(place)
        os.rename(beside, place)
        return name

    def _finish(
        self,
        job: JobRecord,
        status: Literal["done", "failed", "cancelled"],
        began: float,
        *,
        result: str | None = None,
        summary: Mapping[str, Any] | None = None,
        error: Mapping[str, Any] | None = None,
    ) -> None:
        ended = self._insist(
            lambda: self._queue.finish(job, status, result=result, summary=summary, error=error)
        )
        if not ended:
            log.warning("job %s was lost to another claim", job.id, extra={"job": job.id})
            return
        seconds = time.monotonic() - began
        self._metrics.finished.labels(job.kind, status).inc()
        self._metrics.seconds.labels(job.kind).observe(seconds)
        log.info(
            "job %s %s", job.id, status,
            extra={"job": job.id, "status": status, "seconds": round(seconds, 3)},
        )  # fmt: skip
        self._released(job)
        for other in self._home.job(job.id).glob("*"):
            if other.name != result:
                shutil.rmtree(other, ignore_errors=True)


class _Pause:
    """Seconds to wait after one failure of disk or database upon another: 1, 2, 4 … 30."""

    def __init__(self) -> None:
        self._seconds = 0.5

    def next(self) -> float:
        self._seconds = min(2 * self._seconds, _LONGEST_PAUSE_S)
        return self._seconds

    def reset(self) -> None:
        self._seconds = 0.5


class _Watch:
    """Between a running child and its row: progress out, lease prolonged, cancellation in."""

    def __init__(self, supervisor: Supervisor, job: JobRecord) -> None:
        self._of = supervisor
        self._job = job
        self._told = self._beat = time.monotonic()
        self._news: tuple[float, str] | None = None
        self.verdict: Literal["go on", "cancel", "lost", "stop"] = "go on"

    def progress(self, fraction: float, stage: str) -> None:
        self._news = (fraction, stage)

    def cancelled(self) -> bool:
        """Asked several times a second by whoever waits for the child."""
        now = time.monotonic()
        if self._of._stopping.is_set():
            self.verdict = "stop"
        elif self._job.id in self._of._cancelled:
            self.verdict = "cancel"
        elif now - self._beat > self._of._heartbeat or (self._news and now - self._told > _TELL_S):
            self._ask(now)
        return self.verdict != "go on"

    def _ask(self, now: float) -> None:
        news, self._news = self._news, None
        try:
            if news is None:
                self.verdict = self._of._queue.beat(self._job, self._of._lease)
            else:
                self.verdict = self._of._queue.beat(
                    self._job, self._of._lease, progress=min(news[0], 0.99), stage=news[1]
                )
        except PhysretargetError as error:
            # The database may be back before the lease runs out.
            log.error("no heartbeat for job %s: %s", self._job.id, error)
        self._beat = self._told = now


def _summary(answer: Mapping[str, Any]) -> dict[str, Any]:
    """The verdict and the numbers that a child gives, taken only as what they should be."""
    given = answer.get("summary")
    told = given if isinstance(given, dict) else {}
    errors, warnings = told.get("errors"), told.get("warnings")
    if not (isinstance(errors, int) and isinstance(warnings, int)):
        raise ChildError("crash", "the job gave no usable summary.")
    verdict = "failed" if errors else told.get("verdict", "passed")
    if verdict not in get_args(Verdict):
        raise ChildError("crash", "the job gave no usable verdict.")
    texts = {key: str(told.get(key, ""))[:_LONGEST_TEXT] for key in ("reason", "cause")}
    return {
        "errors": errors, "warnings": warnings, "passed": verdict == "passed",
        "verdict": verdict, **texts,
    }  # fmt: skip
