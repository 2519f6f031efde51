"""replay: a clip on one of three screens."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from physretarget.cli import app
from physretarget.cli.common import Given, command, messages, progress, say
from physretarget.clip import load_clip
from physretarget.errors import InputError, UsageError
from physretarget.mjcf import Character
from physretarget.options import REPLAY, build
from physretarget.options.motion import ClipOptions, ReplayOptions
from physretarget.replay import web
from physretarget.replay.clip import clip_scene
from physretarget.report.text import one_line
from physretarget.validation import validate


@command(
    app, "replay", REPLAY, example="physretarget replay jump.npz --model lamp.xml --html jump.html"
)
def replay_command(
    clip: Annotated[Path, typer.Argument(metavar="CLIP", help="The clip to play.")],
    given: Given,
) -> None:
    """Play a clip with its forces: a window, a film or a page.

    A window opens unless --video, --html or --web is given.
    """
    told = build(ReplayOptions, given)
    if (told.video is not None) + (told.html is not None) + told.web > 1:
        raise UsageError("--video, --html and --web exclude each other: give one.")
    character = Character.load(given["model"])
    motion = load_clip(clip, character=character, **asdict(build(ClipOptions, given)))
    with progress(f"replay {clip.name}"):
        judged = validate(motion, character)
        findings = _document(told.report, motion.sha256)
        scene = clip_scene(motion, character, judged, findings=findings)
    if told.video is not None:
        from physretarget.replay.video import write_video

        with progress(f"film {told.video.name}") as step:
            write_video(
                scene,
                told.video,
                speed=told.speed,
                progress=lambda done, all_: step(f"{done}/{all_}"),
            )
        say(str(told.video))
    elif told.html is not None:
        # A stored report is about its own thresholds: its findings are shown, no second verdict.
        verdict = "" if findings is not None else one_line(judged)
        web.write_html(scene, told.html, verdict=verdict, outcome=judged.verdict)
        say(str(told.html))
    elif told.web:
        web.serve(web.render(scene), port=told.port, open_browser=messages.is_terminal)
    else:
        from physretarget.replay.window import play

        play(scene, speed=told.speed)


def _document(report: Path | None, sha256: str | None) -> list[dict[str, Any]] | None:
    """Findings of a stored report, which must be about this very clip."""
    if report is None:
        return None
    try:
        document = json.loads(report.read_text(encoding="utf-8"))
        findings, judged = document["findings"], document["clip"]["sha256"]
    except (ValueError, KeyError, TypeError) as error:
        raise InputError("not a report written by validate --format json.", path=report) from error
    if judged != sha256:
        raise InputError("is about another clip (its sha256 differs).", path=report)
    return list(findings)
