"""validate, rules and inspect: judging clips and models."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, get_args

import typer

from physretarget.cli import app
from physretarget.cli.common import command, complete, fail, one_of, progress, say
from physretarget.clip import load_clip, write_file
from physretarget.errors import PhysretargetError, UsageError
from physretarget.mjcf import Character
from physretarget.mjcf.audit import audit
from physretarget.report.html import render_html
from physretarget.report.json import render_json
from physretarget.report.junit import render_junit
from physretarget.report.markdown import render_markdown
from physretarget.report.rules import render_rule, render_rules
from physretarget.report.sarif import render_sarif
from physretarget.report.text import render_text
from physretarget.validation import (
    BY_CODE,
    RULES,
    Report,
    Settings,
    apply_baseline,
    load_baseline,
    load_settings,
    save_baseline,
    validate,
)
from physretarget.validation.rule import Profile

FORMATS = ("text", "json", "sarif", "junit", "markdown", "html")
PROFILES = get_args(Profile)
_SUFFIX = {"text": "txt", "sarif": "sarif", "junit": "xml", "markdown": "md"}


@command(
    app,
    "validate",
    example="physretarget validate walk.csv --model g1.xml --fps 30 --profile robot --lowpass 6",
)
def validate_command(
    clips: Annotated[list[Path], typer.Argument(metavar="CLIP...")],
    model: Annotated[Path, typer.Option("--model", metavar="MODEL.xml")],
    fps: Annotated[float | None, typer.Option("--fps", help="Of clips without a header.")] = None,
    quat: Annotated[
        str | None,
        typer.Option("--quat", help="Quaternion order.", **complete(("wxyz", "xyzw"))),
    ] = None,
    config: Annotated[
        Path | None, typer.Option("--config", help="Rules and thresholds.", metavar="FILE.toml")
    ] = None,
    profile: Annotated[
        str | None, typer.Option("--profile", help="animation is default.", **complete(PROFILES))
    ] = None,
    lowpass: Annotated[
        float | None, typer.Option("--lowpass", help="Low-pass before judging.", metavar="HZ")
    ] = None,
    also: Annotated[
        str | None,
        typer.Option("--also", help="Other tools' numbers too.", **complete(("literature",))),
    ] = None,
    baseline: Annotated[
        Path | None, typer.Option("--baseline", help="Findings accepted earlier.")
    ] = None,
    accept: Annotated[
        Path | None, typer.Option("--accept", help="Write today's findings as a baseline.")
    ] = None,
    format_: Annotated[str, typer.Option("--format", **complete(FORMATS))] = "text",
    fail_on: Annotated[str, typer.Option("--fail-on", **complete(("error", "warning")))] = "error",
    out: Annotated[
        Path | None, typer.Option("--out", help="File, or a folder for several clips.")
    ] = None,
) -> None:
    """Judge clips by physics; exit code 1 if one fails, 2 if one could not be read."""
    one_of(format_, FORMATS, "--format")
    one_of(fail_on, ("error", "warning"), "--fail-on")
    settings = _settings(config, profile, lowpass, also)
    character = Character.load(model)
    accepted = load_baseline(baseline) if baseline else None
    reports: list[Report] = []
    pages: list[tuple[Path, str]] = []
    unusable = 0
    for path in clips:
        try:
            with progress(f"validate {path.name}"):
                clip = load_clip(path, character=character, fps=fps, quat=quat)
                report = validate(clip, character, settings=settings)
                if accepted is not None:
                    report = apply_baseline(report, accepted)
                text = (
                    render_html(report, clip, character)
                    if format_ == "html"
                    else _RENDER[format_](report)
                )
        except PhysretargetError as error:
            if len(clips) == 1:
                raise
            fail(error)
            unusable += 1
            continue
        reports.append(report)
        pages.append((path, text))
    if accept is not None:
        save_baseline(reports, accept)
        say(f"{accept}: {sum(len(r.findings) for r in reports)} findings accepted.")
    _put(pages, format_, out, folder=len(clips) > 1)
    if unusable:
        raise typer.Exit(2)
    if any(report.fails("warning" if fail_on == "warning" else "error") for report in reports):
        raise typer.Exit(1)


_RENDER: dict[str, Callable[[Report], str]] = {
    "text": lambda report: render_text(report),
    "json": render_json,
    "sarif": render_sarif,
    "junit": render_junit,
    "markdown": render_markdown,
}


def _settings(
    config: Path | None, profile: str | None, lowpass: float | None, also: str | None
) -> Settings:
    """The file's settings, those on the command line over them."""
    from dataclasses import replace

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


def _put(pages: list[tuple[Path, str]], format_: str, out: Path | None, *, folder: bool) -> None:
    if out is None:
        for _, text in pages:
            typer.echo(text, nl=not text.endswith("\n"))
        return
    if not folder:
        for _, text in pages:
            write_file(out, text.encode())
            say(str(out))
        return
    out.mkdir(parents=True, exist_ok=True)
    for path, text in pages:
        target = out / f"{path.stem}.{_SUFFIX.get(format_, format_)}"
        write_file(target, text.encode())
        say(str(target))


@command(app, "rules", example="physretarget rules DYN001")
def rules_command(
    code: Annotated[
        str | None,
        typer.Argument(
            autocompletion=lambda incomplete: [c for c in BY_CODE if c.startswith(incomplete)]
        ),
    ] = None,
) -> None:
    """What each rule means, its threshold and source."""
    if code is None:
        typer.echo(render_rules(RULES))
        return
    rule = BY_CODE.get(code.upper())
    if rule is None:
        raise UsageError(f"there is no rule {code!r}; there are {', '.join(BY_CODE)}.")
    typer.echo(render_rule(rule))


@command(app, "inspect", example="physretarget inspect models/lamp.xml")
def inspect_command(
    model: Annotated[Path, typer.Argument(metavar="MODEL.xml")],
) -> None:
    """Audit a character: mass, inertia, meshes, contact geometry, limits."""
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
        typer.echo(f"{fact.key}: {fact.message}")
    say(f"{len(facts)} remarks.")
