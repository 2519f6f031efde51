"""validate, rules and inspect: judging clips and models."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import Progress

from physretarget.cli import app
from physretarget.cli.common import Given, command, fail, messages, say
from physretarget.cli.validate_out import Judged, Output, check_copies, copy_clips
from physretarget.clip.load import CLIP_SUFFIXES
from physretarget.errors import InputError, PhysretargetError, UsageError
from physretarget.job import load_character, run_job
from physretarget.options import VALIDATE, build
from physretarget.options.judging import ReportOptions, ValidationOptions
from physretarget.report.curation import Condition, parse_condition, row
from physretarget.report.html import render_html
from physretarget.report.rules import render_rule, render_rules
from physretarget.report.words import count, duration
from physretarget.validation import (
    BY_CODE,
    RULES,
    apply_baseline,
    load_baseline,
    save_baseline,
    settings_of,
)
from physretarget.validation.baseline import Accepted


@command(
    app,
    "validate",
    VALIDATE,
    example="physretarget validate walk.csv --model g1.xml --fps 30 --profile robot --lowpass 6",
)
def validate_command(
    clips: Annotated[
        list[Path], typer.Argument(metavar="CLIP...", help="Clips, or folders of them.")
    ],
    given: Given,
) -> None:
    """Judge clips, or all clips of a folder, by physics.

    Several clips make one document: a summary (text), an array of reports (json), one run (sarif),
    a suite per clip (junit), or a row per clip (csv, parquet). If --out is a folder, each clip gets
    its own report there; HTML always needs a folder for several clips.

    A clip passes, fails, or is not judged if the floor's forces could not be determined; --require
    dynamics makes that a failure too. Exit code 1 if a clip fails, 2 if one could not be read.
    """
    told = build(ReportOptions, given)
    several = len(clips) > 1 or clips[0].is_dir()
    output = Output(format=told.format, fail_on=told.fail_on, path=told.out, several=several)
    output.check()
    keeps = parse_condition(told.where) if told.where is not None else None
    job = _Job(
        given=given,
        accepted=load_baseline(told.baseline) if told.baseline else None,
        format=told.format,
    )
    load_character(given["model"])  # a broken model is one error, not one for every clip
    settings_of(given, RULES, ValidationOptions)
    files = _files(clips)
    if told.copy_passed is not None:
        check_copies(files, told.copy_passed)
    outcomes = _outcomes(files, job, told.jobs)
    judged, kept, unread = _judged(files, outcomes, several=several, keeps=keeps)
    reports = [one.report for one in judged]
    if told.accept is not None:
        save_baseline(reports, told.accept)
        accepted = count(sum(len(r.findings) for r in reports), "finding")
        say(f"{told.accept}: {accepted} accepted.")
    output.put(kept, unread)
    if keeps is not None:
        say(f"--where: {_amount(kept)} of {_amount(judged)} kept.")
    if told.copy_passed is not None:
        passed = [one for one in kept if one.report.verdict == "passed"]
        copy_clips([one.path for one in passed], told.copy_passed)
        say(f"{told.copy_passed}: {_amount(passed)} copied.")
    if unread:
        raise typer.Exit(2)
    for report in reports:
        for what, why in report.unmet(told.require).items():
            say(f"{report.clip.path}: {what} not judged, {why}.")
    if any(report.fails(told.fail_on, told.require) for report in reports):
        raise typer.Exit(1)


def _amount(judged: list[Judged]) -> str:
    length = duration(sum(one.report.clip.duration_s for one in judged))
    return f"{count(len(judged), 'clip')} ({length})"


@dataclass(frozen=True, kw_only=True)
class _Job:
    """What is done with every clip; plain data, so that another process can do it."""

    given: Given
    accepted: Accepted | None
    format: str


def _judge(path: Path, job: _Job, progress: Callable[[float], None]) -> Judged:
    done = run_job(
        "validate", path, VALIDATE.of_job(job.given), progress=lambda stage, share: progress(share)
    )
    report = done.report
    assert report is not None
    if job.accepted is not None:
        report = apply_baseline(report, job.accepted)
    page = render_html(report, done.clip.whole(), done.character) if job.format == "html" else None
    # What is drawn has been drawn: the arrays need not travel between processes.
    return Judged(path, replace(report, series={}, forces=None), page)


def _attempt(
    path: Path, job: _Job, progress: Callable[[float], None] = lambda share: None
) -> Judged | PhysretargetError:
    try:
        return _judge(path, job, progress)
    except PhysretargetError as error:
        return error


def _from_elsewhere(path: Path, job: _Job) -> Judged | str:
    """In another process: errors come back as their sentence."""
    found = _attempt(path, job)
    return str(found) if isinstance(found, PhysretargetError) else found


def _outcomes(paths: list[Path], job: _Job, jobs: int) -> Iterator[Judged | PhysretargetError]:
    """Every clip's outcome in the order of the paths, with a bar on a terminal."""
    shown = messages.is_terminal and not messages.quiet
    with Progress(console=messages, transient=True, disable=not shown) as bar:
        task = bar.add_task("validate", total=len(paths))
        if min(jobs, len(paths)) == 1:
            for number, path in enumerate(paths):
                bar.update(task, description=f"validate {path.name}")

                def within(share: float, number: int = number) -> None:
                    bar.update(task, completed=number + share)

                yield _attempt(path, job, within)
                bar.update(task, completed=number + 1)
            return
        # Fresh processes: a fork would copy locks that BLAS threads may hold.
        with ProcessPoolExecutor(min(jobs, len(paths)), mp_context=get_context("spawn")) as pool:
            for outcome in pool.map(partial(_from_elsewhere, job=job), paths):
                yield PhysretargetError(outcome) if isinstance(outcome, str) else outcome
                bar.advance(task)


def _judged(
    paths: list[Path], outcomes: Iterator[Judged | PhysretargetError], *, several: bool,
    keeps: Condition | None,
) -> tuple[list[Judged], list[Judged], dict[str, str]]:  # fmt: skip
    """The outcomes of clips that could be judged, those to keep, and why others were not judged.

    One of ``several`` is told as it fails; one alone raises its error. A condition that makes no
    sense is refused with the first clip, not after the last.
    """
    judged: list[Judged] = []
    kept: list[Judged] = []
    unread: dict[str, str] = {}
    for path, outcome in zip(paths, outcomes, strict=True):
        if isinstance(outcome, Judged):
            judged.append(outcome)
            if keeps is None or keeps(row(outcome.report)):
                kept.append(outcome)
        elif several:
            fail(outcome)
            unread[str(path)] = str(outcome)
        else:
            raise outcome
    return judged, kept, unread


def _files(clips: list[Path]) -> list[Path]:
    """The clips themselves: of a folder all files that can be clips, sorted."""
    files: list[Path] = []
    for path in clips:
        if not path.is_dir():
            files.append(path)
            continue
        inside = sorted(p for p in path.iterdir() if p.suffix.lower() in CLIP_SUFFIXES)
        if not inside:
            raise InputError(f"holds no clips ({', '.join(CLIP_SUFFIXES)}).", path=path)
        files += inside
    return files


@command(app, "rules", example="physretarget rules DYN001")
def rules_command(
    code: Annotated[
        str | None,
        typer.Argument(
            metavar="[CODE]",
            help="Code of one rule.",
            autocompletion=lambda incomplete: [c for c in BY_CODE if c.startswith(incomplete)],
        ),
    ] = None,
) -> None:
    """Explain the rules: meaning, threshold, source."""
    if code is None:
        typer.echo(render_rules(RULES))
        return
    rule = BY_CODE.get(code.upper())
    if rule is None:
        raise UsageError(f"there is no rule {code!r}; there are {', '.join(BY_CODE)}.")
    typer.echo(render_rule(rule))
