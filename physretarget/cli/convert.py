"""convert: a clip from one file format to another."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from physretarget.cli import app
from physretarget.cli.common import command, complete, one_of, say
from physretarget.conversion import convert
from physretarget.mjcf import Character

ORDERS = ("wxyz", "xyzw")


@command(app, "convert", example="physretarget convert jump.npz jump.glb --model lamp.xml")
def convert_command(
    source: Annotated[Path, typer.Argument(metavar="IN", help="The clip to read.")],
    target: Annotated[
        Path, typer.Argument(metavar="OUT", help="The file to write; its ending is its format.")
    ],
    model: Annotated[
        Path | None,
        typer.Option("--model", help="The clip's model; bvh and glb need it.", metavar="MODEL.xml"),
    ] = None,
    fps: Annotated[
        float | None, typer.Option("--fps", help="Frames per second of IN, if it does not say.")
    ] = None,
    quat: Annotated[
        str | None,
        typer.Option(
            "--quat", help="Quaternion order of IN, if it does not say.", **complete(ORDERS)
        ),
    ] = None,
    to_quat: Annotated[
        str,
        typer.Option(
            "--to-quat", help="Quaternion order of OUT, if it is a csv.", **complete(ORDERS)
        ),
    ] = "xyzw",
    header: Annotated[
        bool, typer.Option("--header", help="Begin a csv with names, and give it a time column.")
    ] = False,
) -> None:
    """Convert a clip between file formats.

    In: npz, csv, npy, GMR pkl and others. Out: npz, csv, npy, bvh, glb.
    """
    one_of(to_quat, ORDERS, "--to-quat")
    clip = convert(
        source,
        target,
        character=Character.load(model) if model else None,
        fps=fps,
        quat=quat,
        to_quat=to_quat,
        header=header,
    )
    for note in clip.notes:
        say(f"  note: {note}")
    say(f"{target}: {clip.frames} frames, {clip.duration:.2f} s.")
    if target.suffix.lower() == ".csv" and not header:
        say(f"  It states neither: read it with --fps {clip.fps:g} --quat {to_quat}.")
