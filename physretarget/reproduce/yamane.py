"""Yamane, Ariki, Hodgins 2010, its evaluation from end to end, on real captures."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from pathlib import Path

from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from physretarget.errors import PhysretargetError
from physretarget.files import write_file
from physretarget.reproduce.page import render
from physretarget.reproduce.plan import ACTIONS, CHARACTERS, Plan, Take, make_plan
from physretarget.reproduce.results import Results
from physretarget.reproduce.store import Piece
from physretarget.reproduce.studies import do_dimensions, do_iterations, do_mappers, do_reach
from physretarget.reproduce.takes import do_take
from physretarget.reproduce.workers import each_done

Progress = Callable[[str], None]
Job = tuple[str, str, Take | None]
Work = list[Job]
STUDIES = {
    "mappers": do_mappers,
    "dimensions": do_dimensions,
    "iterations": do_iterations,
    "reach": do_reach,
}


def reproduce_yamane2010(
    data: str | Path,
    out: str | Path,
    *,
    models: Path,
    processes: int = 2,
    characters: tuple[str, ...] = CHARACTERS,
    actions: tuple[str, ...] = ACTIONS,
    dances: bool = True,
    progress: Progress = lambda _: None,
) -> tuple[Path, Results]:
    """Every sequence and study of the paper into one page, ``out/index.html``.

    Args:
        data: folder of captures, with ``bvh/bandai`` in it.
        out: folder for the page, clips and a page for each take; work that is finished there
            is not done again.
        models: folder of the characters and their key poses.
        processes: how many work at the same time.
        characters: a part of the three, as ``actions`` is of the five and ``dances`` says
            whether those are danced; the tests use it.
        progress: called as each piece of work is done.

    Raises:
        InputError: the captures are not there.
    """
    began = clock.perf_counter()
    out = Path(out)
    plan = make_plan(data, models, characters=characters, actions=actions, dances=dances)
    results = Results(plan, out)
    for kind in STUDIES:
        results.studies[kind] = {}
    work = _work(plan)
    for done, (kind, name, piece) in enumerate(_done(work, plan, out, processes), start=1):
        if kind == "take":
            results.takes[name] = piece
        else:
            results.studies[kind][name] = piece
        progress(f"{done} of {len(work)} done, last {kind} {name}")
    # Whoever finished first, the page has the plan's order.
    results.takes = {t.name: results.takes[t.name] for t in plan.takes}
    for kind, found in results.studies.items():
        results.studies[kind] = {c: found[c] for c in plan.characters if c in found}
    results.seconds = clock.perf_counter() - began
    progress("page")
    page = out / "index.html"
    write_file(page, render(results).encode())
    return page, results


def _work(plan: Plan) -> Work:
    """All pieces of work, the longest first, so that no process is left alone at the end."""
    # Iterations matter alike to all characters: one is enough, and spares two minutes.
    studies: Work = [
        (kind, character, None)
        for kind in STUDIES
        for character in (plan.characters[:1] if kind == "iterations" else plan.characters)
    ]
    return studies + [("take", take.name, take) for take in plan.takes]


def _do_one(job: Job, plan: Plan, out: Path) -> Piece:
    kind, name, take = job
    with threadpool_limits(limits=1):
        return do_take(take, plan.models, out) if take else STUDIES[kind](plan, name, out)


def _done(work: Work, plan: Plan, out: Path, processes: int) -> Iterator[tuple[str, str, Piece]]:
    """Do all work and yield (kind, name, piece) as each is finished."""
    do = partial(_do_one, plan=plan, out=out)
    if processes < 2:
        for job in work:
            yield *job[:2], do(job)
        return
    try:
        for job, piece in each_done(do, work, processes):
            yield *job[:2], piece
    except BrokenProcessPool as error:
        raise PhysretargetError(
            "a worker process was ended from outside, perhaps for want of memory; run the "
            "command again, it goes on where it stopped."
        ) from error
