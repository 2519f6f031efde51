"""validate, rules and inspect: judging clips and models."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated, cast, get_args

import typer
from rich.progress import Progress

from physretarget.cli import app
from physretarget.cli.common import command, complete, fail, messages, one_of, say
from physretarget.cli.validate_out import SUFFIXES, Judged, Output
from physretarget.clip import open_clip
from physretarget.clip.load import CLIP_SUFFIXES
from physretarget.clip.raw import JointOrder
from physretarget.clip.unit import UNITS
from physretarget.errors import InputError, PhysretargetError, UsageError
from physretarget.mjcf import Character
from physretarget.mjcf.audit import audit
from physretarget.report.html import render_html
from physretarget.report.rules import render_rule, render_rules
from physretarget.report.words import count
from physretarget.validation import (
    BY_CODE,
    RULES,
    Settings,
    apply_baseline,
    load_baseline,
    load_settings,
    save_baseline,
    validate,
)
from physretarget.validation.baseline import Accepted
from physretarget.validation.report import Severity
from physretarget.validation.rule import Profile

FORMATS = tuple(SUFFIXES)
PROFILES = get_args(Profile)
ORDERS = get_args(JointOrder)


@command(
    app,
    "validate",
    example="physretarget validate walk.csv --model g1.xml --fps 30 --profile robot --lowpass 6",
)
def validate_command(
    clips: Annotated[
        list[Path], typer.Argument(metavar="CLIP...", help="Clips, or folders of them.")
    ],
    model: Annotated[
        Path, typer.Option("--model", metavar="MODEL.xml", help="The clips' MJCF file.")
    ],
    fps: Annotated[
        float | None,
        typer.Option("--fps", help="Frames per second of files that do not say.", metavar="FPS"),
    ] = None,
    quat: Annotated[
        str | None,
        typer.Option("--quat", help="Their quaternion order.", **complete(("wxyz", "xyzw"))),
    ] = None,
    unit: Annotated[
        str | None,
        typer.Option(
            "--unit",
            help="Their length unit, if not m; or metres per unit, as in 0.0254.",
            metavar="|".join(UNITS) + "|METRES",
        ),
    ] = None,
    config: Annotated[
        Path | None, typer.Option("--config", help="Rules and thresholds.", metavar="FILE.toml")
    ] = None,
    profile: Annotated[
        str | None, typer.Option("--profile", help="Thresholds [animation].", **complete(PROFILES))
    ] = None,
    lowpass: Annotated[
        float | None, typer.Option("--lowpass", help="Low-pass before judging.", metavar="HZ")
    ] = None,
    also: Annotated[
        str | None,
        typer.Option("--also", help="Other tools' numbers too.", **complete(("literature",))),
    ] = None,
    baseline: Annotated[
        Path | None,
        typer.Option("--baseline", help="Findings accepted earlier.", metavar="FILE.json"),
    ] = None,
    accept: Annotated[
        Path | None,
        typer.Option("--accept", help="Write findings as a baseline.", metavar="FILE.json"),
    ] = None,
    format_: Annotated[
        str, typer.Option("--format", help="Of the report.", **complete(FORMATS))
    ] = "text",
    fail_on: Annotated[
        str,
        typer.Option(
            "--fail-on", help="What makes the exit code 1.", **complete(("error", "warning"))
        ),
    ] = "error",
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            help="Of several clips: a file for all (all.json), or a folder with a report of each "
            "[default: stdout].",
            metavar="FILE|FOLDER",
        ),
    ] = None,
    joint_order: Annotated[
        str | None,
        typer.Option("--joint-order", help="Of files without names.", **complete(ORDERS)),
    ] = None,
    jobs: Annotated[
        int, typer.Option("--jobs", help="Clips judged at a time.", min=1, metavar="N")
    ] = 1,
) -> None:
    """Judge clips, or all clips of a folder, by physics.

    Several clips make one document: an array of reports (json), one run (sarif), a suite per clip
    (junit). HTML has a page per clip and needs a folder as --out.

    Exit code 1 if one fails, 2 if one could not be read.
    """
    one_of(format_, FORMATS, "--format")
    one_of(fail_on, ("error", "warning"), "--fail-on")
    several = len(clips) > 1 or clips[0].is_dir()
    level: Severity = "warning" if fail_on == "warning" else "error"
    output = Output(format=format_, fail_on=level, path=out, several=several)
    output.check()
    settings = _settings(config, profile, lowpass, also)
    if joint_order is not None:
        one_of(joint_order, ORDERS, "--joint-order")
    job = _Job(
        model=model, settings=settings, accepted=load_baseline(baseline) if baseline else None,
        format=format_, fps=fps, quat=quat, unit=unit, order=cast("JointOrder | None", joint_order),
    )  # fmt: skip
    _character(model)  # a broken model is one error, not one for every clip
    files = _files(clips)
    judged, unread = _judged(files, _outcomes(files, job, jobs), several=several)
    reports = [one.report for one in judged]
    if accept is not None:
        save_baseline(reports, accept)
        say(f"{accept}: {count(sum(len(r.findings) for r in reports), 'finding')} accepted.")
    output.put(judged, unread)
    if unread:
        raise typer.Exit(2)
    if any(report.fails(level) for report in reports):
        raise typer.Exit(1)


@dataclass(frozen=True, kw_only=True)
class _Job:
    """What is done with every clip; plain data, so that another process can do it."""

    model: Path
    settings: Settings
    accepted: Accepted | None
    format: str
    fps: float | None
    quat: str | None
    unit: str | None
    order: JointOrder | None


@lru_cache(maxsize=1)
def _character(model: Path) -> Character:
    return Character.load(model)


def _judge(path: Path, job: _Job, progress: Callable[[int, int], None] | None = None) -> Judged:
    character = _character(job.model)
    clip = open_clip(
        path, character=character, fps=job.fps, quat=job.quat, joint_order=job.order, unit=job.unit
    )
    report = validate(clip, character, settings=job.settings, progress=progress)
    if job.accepted is not None:
        report = apply_baseline(report, job.accepted)
    page = render_html(report, clip.whole(), character) if job.format == "html" else None
    # What is drawn has been drawn: the arrays need not travel between processes.
    return Judged(path, replace(report, series={}, forces=None), page)


def _attempt(
    path: Path, job: _Job, progress: Callable[[int, int], None] | None = None
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

                def within(done: int, frames: int, number: int = number) -> None:
                    bar.update(task, completed=number + done / frames)

                yield _attempt(path, job, within)
                bar.update(task, completed=number + 1)
            return
        # Fresh processes: a fork would copy locks that BLAS threads may hold.
        with ProcessPoolExecutor(min(jobs, len(paths)), mp_context=get_context("spawn")) as pool:
            for outcome in pool.map(partial(_from_elsewhere, job=job), paths):
                yield PhysretargetError(outcome) if isinstance(outcome, str) else outcome
                bar.advance(task)


def _judged(
    paths: list[Path], outcomes: Iterator[Judged | PhysretargetError], *, several: bool
) -> tuple[list[Judged], dict[str, str]]:
    """The outcomes of clips that could be judged, and why the others could not.

    One of ``several`` is told as it fails; one alone raises its error.
    """
    judged: list[Judged] = []
    unread: dict[str, str] = {}
    for path, outcome in zip(paths, outcomes, strict=True):
        if isinstance(outcome, Judged):
            judged.append(outcome)
        elif several:
            fail(outcome)
            unread[str(path)] = str(outcome)
        else:
            raise outcome
    return judged, unread


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


def _settings(
    config: Path | None, profile: str | None, lowpass: float | None, also: str | None
) -> Settings:
    """The file's settings, those on the command line over them."""
    settings = load_settings(config, RULES) if config else Settings()
    given: dict[str, object] = {}
    if profile is not None:
        one_of(profile, PROFILES, "--profile")
        given["profile"] = profile
    if lowpass is not None:
        given["lowpass_hz"] = lowpass or None
    if also is not None:
        one_of(also, ("literature",), "--also")
        given["also_literature"] = True
    return replace(settings, **given)  # type: ignore[arg-type]


@command(app, "rules", example="physretarget rules DYN001")
def rules_command(
    code: Annotated[
        str | None,
        typer.Argument(
            metavar="[CODE]",
            help="One rule.",
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


@command(app, "inspect", example="physretarget inspect models/lamp.xml")
def inspect_command(
    model: Annotated[Path, typer.Argument(metavar="MODEL.xml", help="Its MJCF file.")],
) -> None:
    """Audit a character: mass, inertia, geometry, limits."""
    character = Character.load(model)
    typer.echo(
        f"{character.name}: {character.mass:.3f} kg, {character.height:.3f} m tall, centre of "
        f"mass at {character.com_height:.3f} m, {len(character.joint_names)} joints, "
        f"{len(character.contacts)} contact points, {len(character.markers)} markers."
    )
    facts = audit(character)
    for note in character.notes:
        typer.echo(f"note: {note}")
    for fact in facts:
        where = f"{fact.subject} {fact.name}: " if fact.subject != "model" and fact.name else ""
        typer.echo(f"{fact.key}: {where}{fact.message}")
    say(f"{count(len(facts), 'remark')}.")
