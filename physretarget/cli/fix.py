"""fix: clips made to stand, with the least change."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from physretarget.cli import app
from physretarget.cli.common import Given, command, messages, say
from physretarget.clip import Clip, load_clip, write_file
from physretarget.errors import UsageError
from physretarget.job import load_character
from physretarget.mjcf import Character
from physretarget.options import FIX, build
from physretarget.options.judging import ValidationOptions
from physretarget.options.motion import ClipOptions, FixOutput
from physretarget.report.html import render_html
from physretarget.report.words import count
from physretarget.validation import RULES, Report, settings_of, validate
from physretarget.wholebody import Repaired, repair


@command(app, "fix", FIX, example="physretarget fix walk.csv --model g1.xml --out walk-fixed.npz")
def fix_command(
    clips: Annotated[list[Path], typer.Argument(metavar="CLIP...", help="Clips to mend.")],
    given: Given,
) -> None:
    """Mend slide, float, sink and lean of clips.

    By the least change of the whole body. Which bodies stand is found in the clip. Prints the
    verdict before and after, and how far the pose was moved. Exit code 1 if errors remain.
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
            done = repair(character, clip.qpos, clip.time)
            fixed = replace(clip, qpos=done.qpos, meta={**clip.meta, "fixed": _meta(done, path)})
            before, after = (validate(one, character, settings=settings) for one in (clip, fixed))
        out = output.out / f"{path.stem}.npz" if several else output.out
        out.parent.mkdir(parents=True, exist_ok=True)
        fixed.save(out)
        if output.report is not None:
            _pages(output.report / path.stem if several else output.report, character,
                   (("before", clip, before), ("after", fixed, after)))  # fmt: skip
        for note in done.notes:
            say(f"  note: {note}")
        typer.echo(_summary(path, done, before, after))
        say(f"{out}: {fixed.frames} frames.")
        failed |= after.errors > 0
    if failed:
        raise typer.Exit(1)


def _meta(done: Repaired, path: Path) -> dict[str, object]:
    return {
        "from": path.name,
        "lifted_m": round(done.lifted, 6),
        "moved_rms_m": round(_rms(done.moved), 6),
        "posed_rms_m": round(_rms(done.posed), 6),
        "status": done.status,
    }


def _summary(path: Path, done: Repaired, before: Report, after: Report) -> str:
    errors = f"{count(before.errors, 'error')} before, {count(after.errors, 'error')} after"
    moved, posed = 100 * _rms(done.moved), 100 * _rms(done.posed)
    lines = [f"{path.name}: {errors}; moved by {moved:.1f} cm RMS, the pose by {posed:.1f} cm."]
    for finding in after.findings:
        if finding.severity == "error":
            lines.append(f"  not mended: {finding.code} {finding.message}")
    return "\n".join(lines)


def _pages(folder: Path, character: Character, pages: tuple[tuple[str, Clip, Report], ...]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, clip, report in pages:
        page = folder / f"{name}.html"
        write_file(page, render_html(report, clip, character).encode())
        say(f"Open {page} in a browser.")


def _rms(distance: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> float:
    return float(np.sqrt(np.mean(distance**2)))
