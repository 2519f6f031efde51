"""studio: key poses in the browser."""

from __future__ import annotations

import importlib.util
import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from physretarget import capture
from physretarget.cli import app
from physretarget.cli.common import Given, command, messages, progress, say
from physretarget.errors import MissingExtraError
from physretarget.mjcf import Character
from physretarget.options import STUDIO, build
from physretarget.options.motion import CAPTURES
from physretarget.options.posing import StudioOptions


@command(
    app,
    "studio",
    STUDIO,
    example="physretarget studio walk.bvh kick.bvh --character crab.xml "
    "--keyposes crab.keyposes.toml",
)
def studio_command(
    given: Given,
    captures: Annotated[
        list[Path] | None, typer.Argument(metavar="[CAPTURE]...", help=f"{CAPTURES}.")
    ] = None,
) -> None:
    """Pose key poses in the browser.

    The actor is on the left, the character on the right: drag its parts or set its joints. Every
    change is saved at once and can be undone. The studio suggests what to pose next and replays
    the whole capture with the key poses so far. Press Ctrl-C to stop.
    """
    for package in ("fastapi", "uvicorn"):
        if importlib.util.find_spec(package) is None:
            raise MissingExtraError(package, extra="studio", purpose="The studio")
    from physretarget.studio.serve import LOCAL, serve
    from physretarget.studio.session import Session
    from physretarget.studio.take import Take

    told = build(StudioOptions, given)
    character = Character.load(given["character"])
    takes = []
    with progress("reading") as step:
        for path in captures or []:
            step(path.name)
            takes.append(Take.of(capture.load(path, map=given.get("map"))))
    session = Session(character, told.keyposes, takes)

    def ready(address: str) -> None:
        say(f"Studio at {address} (Ctrl-C ends it; every change is in {told.keyposes})")
        if told.host not in LOCAL:
            say("Whoever has this address can change the file: the way to it is not encrypted.")
        if messages.is_terminal:
            webbrowser.open(address)

    serve(session, host=told.host, port=told.port, ready=ready)
