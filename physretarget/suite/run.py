"""A run: what is not known yet is done, everything is compared, the verdicts are kept.

Results are kept one by one as they arrive, so an interrupted run resumes by being run again.
"""

from __future__ import annotations

import os
import sys
import time as clock
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict
from multiprocessing import get_context

from physretarget._version import __version__
from physretarget.suite.compare import Comparison, State, compare
from physretarget.suite.file import Suite
from physretarget.suite.job import Job, Outcome
from physretarget.suite.plan import Plan
from physretarget.suite.records import Entry, Run
from physretarget.suite.store import Store

Execute = Callable[[Sequence[Job]], Iterator[Outcome]]
"""Does jobs in any order and yields what each gave; never raises because of a job."""
Progress = Callable[[int, int, str], None]
"""Called with jobs done, jobs to do, and the clip last done."""


def _silent(done: int, total: int, clip: str) -> None:
    return None


def run_suite(
    suite: Suite,
    plan: Plan,
    store: Store,
    *,
    execute: Execute,
    progress: Progress = _silent,
) -> Run:
    """Do what has no result yet, compare everything with its baseline, keep the verdicts.

    Returns:
        The run as kept; its entries are in the store.
    """
    started = clock.perf_counter()
    number = store.begin_run(suite.name, __version__)
    known = store.known(job.address for job in plan.jobs)
    # Copies of one clip have one address: done once, told for each.
    todo = {job.address: job for job in plan.jobs if job.address not in known}
    if todo:
        # Solvers are loaded here, not above: most of a quiet night would go into that.
        from physretarget.suite.work import check_ready

        check_ready(suite, {job.case for job in todo.values()})
    progress(0, len(todo), "")
    for count, outcome in enumerate(execute(list(todo.values())) if todo else (), 1):
        store.save(outcome)
        progress(count, len(todo), todo[outcome.address].clip_id)
    entries = judge(suite, plan, store)
    seconds = clock.perf_counter() - started
    store.finish_run(number, entries, seconds=seconds, done=len(todo))
    return store.runs(suite.name, 1)[-1]


def judge(suite: Suite, plan: Plan, store: Store) -> list[Entry]:
    """The verdict on every clip of the plan and on every accepted one that is gone."""
    accepted = store.baseline(suite.name)
    addresses = {job.address for job in plan.jobs}
    addresses |= {a.address for a in accepted.values() if a.address}
    states = store.states(addresses)
    entries = []
    for job in plan.jobs:
        before = accepted[job.clip_id].address if job.clip_id in accepted else None
        # The tolerance of a measure may be the suite's own.
        verdict = compare(states[job.address], _state(states, before), suite.tolerances)
        entries.append(_entry(job.clip_id, job.address, before, verdict, job))
    present = {job.clip_id for job in plan.jobs}
    for clip, entry in accepted.items():
        if clip not in present and entry.address is not None:
            verdict = compare(None, _state(states, entry.address))
            entries.append(_entry(clip, None, entry.address, verdict, None))
    return entries


def _state(states: dict[str, State], address: str | None) -> State | None:
    return None if address is None else states.get(address)


def _entry(
    clip: str, address: str | None, baseline: str | None, verdict: Comparison, job: Job | None
) -> Entry:
    return Entry(
        clip=clip,
        address=address,
        baseline=baseline,
        case_name=job.case if job else clip.split("/", 1)[0],
        kind=job.kind if job else "clip",
        tags=job.tags if job else (),
        owner=job.owner if job else "",
        verdict=verdict.verdict,
        reason=verdict.reason,
        blocking=verdict.blocking,
        changes=tuple(asdict(change) for change in verdict.changes),
    )


def perform(job: Job) -> Outcome:
    """Do a job in whatever process this is; see :func:`physretarget.suite.work.perform`."""
    from physretarget.suite import work

    return work.perform(job)


# ---- on this machine ---------------------------------------------------------------------------


def local(workers: int) -> Execute:
    """Processes on this machine; one that dies costs its own clip at most, and is replaced."""

    def execute(jobs: Sequence[Job]) -> Iterator[Outcome]:
        waiting = deque(jobs)
        suspects: list[Job] = []
        while waiting:
            suspects += yield from _until_broken(waiting, min(workers, len(waiting)))
            # Whoever was in the hands of a broken pool is tried again, each alone.
            while suspects:
                yield from _alone(suspects.pop())

    return execute


def _pool(workers: int) -> ProcessPoolExecutor:
    # Spawned, not forked: BLAS and MuJoCo keep threads, which a fork would cut off half-way.
    return ProcessPoolExecutor(
        workers, mp_context=get_context("spawn"), initializer=_begin, initargs=(os.getpid(),)
    )


def _begin(parent: int) -> None:
    """A worker's first act: end when the suite does, killed with -9 too."""
    if sys.platform == "linux":
        from physretarget.sandbox.confine import die_with_parent

        die_with_parent(parent)
    one_thread()


def one_thread() -> None:
    """One BLAS thread per process: the processes share the cores already."""
    from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

    threadpool_limits(limits=1)


def _until_broken(waiting: deque[Job], workers: int) -> Generator[Outcome, None, list[Job]]:
    """Work off the queue; returns the jobs that were running when the pool broke, if it did."""
    running: dict[Future[Outcome], Job] = {}
    with _pool(workers) as pool:
        try:
            while waiting or running:
                # Few in flight: a break then puts few under suspicion.
                while waiting and len(running) < workers + 1:
                    job = waiting.popleft()
                    try:
                        running[pool.submit(perform, job)] = job
                    except BrokenProcessPool:
                        waiting.appendleft(job)
                        return list(running.values())
                done, _ = wait(running, return_when=FIRST_COMPLETED)
                broken = [f for f in done if isinstance(f.exception(), BrokenProcessPool)]
                for future in done:
                    if future not in broken:
                        del running[future]
                        yield future.result()
                if broken:
                    return list(running.values())
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return []


def _alone(job: Job) -> Iterator[Outcome]:
    with _pool(1) as pool:
        try:
            yield pool.submit(perform, job).result()
        except BrokenProcessPool:
            yield Outcome(
                address=job.address,
                status="errored",
                message="the process that judged it died, twice (killed, or out of memory).",
                transient=True,
            )
