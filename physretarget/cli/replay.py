"""replay: a clip on one of three screens."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from physretarget.cli import app
from physretarget.cli.common import command, complete, messages, progress, say
from physretarget.clip import load_clip
from physretarget.errors import InputError, UsageError
from physretarget.mjcf import Character
from physretarget.replay import web
from physretarget.replay.clip import clip_scene
from physretarget.validation import validate


@command(app, "replay", example="physretarget replay jump.npz --model lamp.xml --html jump.html")
def replay_command(
    clip: Annotated[Path, typer.Argument(metavar="CLIP", help="The clip to play.")],
    model: Annotated[
        Path, typer.Option("--model", metavar="MODEL.xml", help="The clip's MJCF file.")
    ],
    video: Annotated[
        Path | None,
        typer.Option("--video", help="Write a film; needs no display.", metavar="F.mp4"),
    ] = None,
    html: Annotated[
        Path | None,
        typer.Option("--html", help="Write one page for any browser.", metavar="F.html"),
    ] = None,
    live: Annotated[bool, typer.Option("--web", help="Serve the page on this machine.")] = False,
    port: Annotated[int, typer.Option("--port", help="Port of --web; 0 takes a free one.")] = 0,
    report: Annotated[
        Path | None,
        typer.Option(
            "--report",
            help="Findings from this report instead of judging now.",
            metavar="FILE.json",
        ),
    ] = None,
    fps: Annotated[
        float | None,
        typer.Option("--fps", help="Frames per second of a file that does not say."),
    ] = None,
    quat: Annotated[
        str | None,
        typer.Option(
            "--quat",
            help="Quaternion order of a file that does not say.",
            **complete(("wxyz", "xyzw")),
        ),
    ] = None,
    speed: Annotated[
        float, typer.Option("--speed", help="Of window and film; 0.25 is slow motion.")
    ] = 1.0,
) -> None:
    """Play a clip with its forces: a window, a film or a page.

    A window opens unless --video, --html or --web is given.
    """
    if (video is not None) + (html is not None) + live > 1:
        raise UsageError("--video, --html and --web exclude each other: give one.")
    character = Character.load(model)
    motion = load_clip(clip, character=character, fps=fps, quat=quat)
    with progress(f"replay {clip.name}"):
        judged = validate(motion, character)
        scene = clip_scene(motion, character, judged, findings=_document(report, motion.sha256))
    if video is not None:
        from physretarget.replay.video import write_video

        with progress(f"film {video.name}") as step:
            write_video(
                scene, video, speed=speed, progress=lambda done, all_: step(f"{done}/{all_}")
            )
        say(str(video))
    elif html is not None:
        web.write_html(scene, html)
        say(str(html))
    elif live:
        web.serve(web.render(scene), port=port, open_browser=messages.is_terminal)
    else:
        from physretarget.replay.window import play

        play(scene, speed=speed)


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
