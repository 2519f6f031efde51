"""fix: clips made to stand, with the least change."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from physretarget.cli import app
from physretarget.cli.common import Given, command, messages, say
from physretarget.clip import load_clip
from physretarget.errors import UsageError
from physretarget.job import load_character
from physretarget.mend import Fixed, fix
from physretarget.options import FIX, build
from physretarget.options.judging import ValidationOptions
from physretarget.options.motion import ClipOptions, FixOutput
from physretarget.report.fix import write_fix_report
from physretarget.report.words import count
from physretarget.validation import RULES, Report, settings_of, validate


@command(app, "fix", FIX, example="physretarget fix walk.csv --model g1.xml --out walk-fixed.npz")
def fix_command(
    clips: Annotated[list[Path], typer.Argument(metavar="CLIP...", help="Clips to repair.")],
    given: Given,
) -> None:
    """Repair clips by the smallest change.

    First repairs single bad frames, jumps of the root, noise and joint limits; then slide, float,
    penetration and lean, by the smallest change of the whole body. Which bodies stand is found in
    the clip. Prints the verdict before and after, and how far the pose was moved. Exit code 1 if
    errors remain.
    """
    output = build(FixOutput, given)
    several = len(clips) > 1
    if not several and output.out.suffix.lower() != ".npz":
        raise UsageError(f"--out is {output.out}; a mended clip is an .npz file.")
    character = load_character(given["model"])
    settings = settings_of(given, RULES, ValidationOptions)
    failed = False
    for path in clips:
        with messages.status(f"fix {path.name}"):
            clip = load_clip(path, character=character, **asdict(build(ClipOptions, given)))
            done = fix(clip, character)
            before, after = (
                validate(one, character, settings=settings) for one in (clip, done.clip)
            )
        out = output.out / f"{path.stem}.npz" if several else output.out
        out.parent.mkdir(parents=True, exist_ok=True)
        done.clip.save(out)
        if output.report is not None:
            folder = output.report / path.stem if several else output.report
            page = write_fix_report(clip, done, character, (before, after), folder)
            say(f"{page}: the report, before and after.")
        for note in done.notes:
            say(f"  note: {note}")
        typer.echo(_summary(path, done, before, after))
        say(f"{out}: {done.clip.frames} frames.")
        failed |= after.errors > 0
    if failed:
        raise typer.Exit(1)


def _summary(path: Path, done: Fixed, before: Report, after: Report) -> str:
    errors = f"{count(before.errors, 'error')} before, {count(after.errors, 'error')} after"
    moved, posed = 100 * done.moved_rms_m, 100 * done.posed_rms_m
    lines = [f"{path.name}: {errors}; moved by {moved:.1f} cm RMS, the pose by {posed:.1f} cm."]
    for finding in after.findings:
        if finding.severity == "error":
            lines.append(f"  not mended: {finding.code} {finding.message}")
    return "\n".join(lines)
