"""suite: a whole library judged every night, compared with what was accepted."""

from __future__ import annotations

import fnmatch
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from physretarget.cli import app
from physretarget.cli.common import command, messages, say
from physretarget.errors import UsageError

if TYPE_CHECKING:
    # The store needs an extra; every other command must do without it.
    from physretarget.suite.file import Suite
    from physretarget.suite.records import Entry, Run
    from physretarget.suite.store import Store

group = typer.Typer(
    help="Judge a whole library every night and report what changed.",
    epilog="Example: physretarget suite run nightly.toml",
    no_args_is_help=True,
)
app.add_typer(group, name="suite")

File = Annotated[
    Path, typer.Argument(metavar="SUITE.toml", help="Clips and models; see docs/validate.md.")
]
History = Annotated[
    str | None,
    typer.Option(
        "--history",
        metavar="URL",
        help=(
            "Database of runs, instead of the suite file's: sqlite:///FILE or postgresql://…/DB."
        ),
    ),
]
Out = Annotated[
    Path | None,
    typer.Option(
        "--out", metavar="SITE", help="Folder for the report, instead of the suite file's."
    ),
]
_TOLD = 20


@command(group, "run", example="physretarget suite run nightly.toml --workers 4 --out site")
def run_command(
    suite: File,
    out: Out = None,
    workers: Annotated[
        int | None, typer.Option(
            "--workers", metavar="N", min=1, help="Number of processes [default: one per core].")
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            "--scheduler", metavar="ADDR",
            help="Dask scheduler (tcp://host:8786), or 'local' for a Dask cluster here.",
        ),
    ] = None,
    history: History = None,
) -> None:  # fmt: skip
    """Judge what changed and write the report.

    Compares with the accepted baseline; exit code 1 if something is worse.
    """
    from physretarget.suite.plan import plan
    from physretarget.suite.run import local, run_suite
    from physretarget.suite.site import write_site

    told = _suite(suite, history)
    planned = plan(told)
    for note in planned.notes:
        say(f"note: {note}")
    count = workers or len(os.sched_getaffinity(0))
    with _open(told) as store:
        with _bar(told.name) as progress:
            if scheduler is None:
                run = run_suite(told, planned, store, execute=local(count), progress=progress)
            else:
                from physretarget.suite.dask import distributed

                with distributed(scheduler, count) as execute:
                    run = run_suite(told, planned, store, execute=execute, progress=progress)
        entries = store.entries(run.id)
        index = write_site(store, run, entries, out or told.out)
    _tell(run, entries)
    say(f"report: {index}")
    if any(entry.blocking for entry in entries):
        raise typer.Exit(1)


@command(group, "accept", example="physretarget suite accept nightly.toml --note 'new key poses'")
def accept_command(
    suite: File,
    note: Annotated[
        str,
        typer.Option(
            "--note", metavar="TEXT", help="Why it is accepted; every report shows this note."
        ),
    ] = "",
    clip: Annotated[
        list[str] | None,
        typer.Option(
            "--clip", metavar="GLOB", help="Only these clips; may be given several times."
        ),
    ] = None,
    number: Annotated[
        int | None,
        typer.Option("--run", metavar="N", help="Number of the run to accept [default: the last]."),
    ] = None,
    history: History = None,
) -> None:
    """Make a run's results the baseline of later runs."""
    told = _suite(suite, history)
    with _open(told) as store:
        run = _run(store, told, number)
        entries = store.entries(run.id)
        if clip:
            entries = [e for e in entries if any(fnmatch.fnmatch(e.clip, g) for g in clip)]
            if not entries:
                raise UsageError(f"no clip of run {run.id} is called {' or '.join(clip)}.")
        accepted = {e.clip: e.address for e in entries if e.verdict != "errored"}
        store.accept(told.name, accepted, run=run.id, note=note)
    gone = sum(address is None for address in accepted.values())
    say(
        f"{told.name}: run {run.id} accepted for {len(accepted) - gone} clips"
        + (f"; {gone} accepted as gone" if gone else "")
        + "."
    )
    if len(accepted) < len(entries):
        say(f"{len(entries) - len(accepted)} errored clips keep the baseline that they had.")


@command(group, "report", example="physretarget suite report nightly.toml --out site")
def report_command(
    suite: File,
    out: Out = None,
    number: Annotated[
        int | None,
        typer.Option("--run", metavar="N", help="Number of an earlier run [default: the last]."),
    ] = None,
    history: History = None,
) -> None:
    """Write a run's report again, without judging anything."""
    from physretarget.suite.site import write_site

    told = _suite(suite, history)
    with _open(told) as store:
        run = _run(store, told, number)
        entries = store.entries(run.id)
        index = write_site(store, run, entries, out or told.out)
    _tell(run, entries)
    say(f"report: {index}")
    if any(entry.blocking for entry in entries):
        raise typer.Exit(1)


def _suite(path: Path, history: str | None) -> Suite:
    from physretarget.suite.file import database_url, load_suite

    suite = load_suite(path)
    return replace(suite, history=database_url(history, Path.cwd())) if history else suite


def _open(suite: Suite) -> Store:
    from physretarget.suite.store import Store

    return Store(suite.history)


def _run(store: Store, suite: Suite, number: int | None) -> Run:
    runs = store.runs(suite.name, 1 if number is None else 100_000)
    found = [run for run in runs if number in (None, run.id)]
    if not found:
        which = "no finished run" if number is None else f"no finished run {number}"
        raise UsageError(f"the history of {suite.name!r} has {which}: 'suite run' comes first.")
    return found[-1]


def _tell(run: Run, entries: list[Entry]) -> None:
    """Results to stdout: what changed, the worst first."""
    from physretarget.suite.compare import VERDICTS

    counts = ", ".join(f"{run.counts[v]} {v}" for v in VERDICTS if run.counts.get(v))
    typer.echo(f"run {run.id}: {len(entries)} clips, {run.done} judged anew, {run.seconds:.1f} s")
    typer.echo(counts)
    changed = [e for v in VERDICTS for e in entries if e.verdict == v and v not in ("same", "new")]
    for entry in changed[:_TOLD]:
        typer.echo(f"{entry.verdict:8} {entry.clip}: {entry.reason}")
    if len(changed) > _TOLD:
        typer.echo(f"and {len(changed) - _TOLD} more in the report.")


@contextmanager
def _bar(what: str) -> Iterator[Callable[[int, int, str], None]]:
    """A progress bar on a terminal, nothing when piped."""
    if not messages.is_terminal or messages.quiet:
        yield lambda done, total, clip: None
        return
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(),
        TimeRemainingColumn(), TextColumn("{task.fields[clip]}", markup=False),
    )  # fmt: skip
    with Progress(*columns, console=messages, transient=True) as bar:
        task = bar.add_task(what, total=None, clip="")
        yield lambda done, total, clip: bar.update(task, completed=done, total=total, clip=clip)
