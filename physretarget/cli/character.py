"""character: a character from what people have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from physretarget.cli import app
from physretarget.cli.common import Given, command, say
from physretarget.new_character import make_character
from physretarget.options import CHARACTER_NEW, build
from physretarget.options.posing import NewCharacterOptions

group = typer.Typer(
    help="Make a character from a robot's file.",
    epilog="Example: physretarget character new lamp.urdf --out lamp.xml",
    no_args_is_help=True,
)
app.add_typer(group, name="character")


@command(group, "new", CHARACTER_NEW, example="physretarget character new lamp.urdf --out lamp.xml")
def new_command(
    rig: Annotated[Path, typer.Argument(metavar="RIG", help="URDF or MJCF file.")], given: Given
) -> None:
    """Make a character from a URDF or a plain MJCF.

    Adds a free root, a floor, contact points, a face, limits and masses. Every guess is listed, so
    that you can correct the file by hand.
    """
    told = build(NewCharacterOptions, given)
    made = make_character(rig, told.out, front=told.front, up=told.up)
    for note in made.notes:
        say(f"{note.rstrip('.')}.")
    say(f"{made.path}: pose it with physretarget studio --character {made.path} --keyposes …")
