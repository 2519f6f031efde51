"""convert: a clip from one file format to another."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from physretarget.cli import app
from physretarget.cli.common import Given, command, say
from physretarget.conversion import convert
from physretarget.mjcf import Character
from physretarget.options import CONVERT, build
from physretarget.options.motion import ClipOptions, ConversionOptions


@command(app, "convert", CONVERT, example="physretarget convert jump.npz jump.glb --model lamp.xml")
def convert_command(
    source: Annotated[Path, typer.Argument(metavar="IN", help="The clip to read.")],
    target: Annotated[
        Path, typer.Argument(metavar="OUT", help="The file to write; its ending is its format.")
    ],
    given: Given,
) -> None:
    """Convert a clip between file formats.

    Reads npz, csv, npy, GMR pkl and others; writes npz, csv, npy, bvh and glb.
    """
    written = build(ConversionOptions, given)
    clip = convert(
        source,
        target,
        character=Character.load(written.model) if written.model else None,
        to_quat=written.to_quat,
        header=written.header,
        **asdict(build(ClipOptions, given)),
    )
    for note in clip.notes:
        say(f"  note: {note}")
    say(f"{target}: {clip.frames} frames, {clip.duration:.2f} s.")
    if target.suffix.lower() == ".csv" and not written.header:
        say(f"  It states neither: read it with --fps {clip.fps:g} --quat {written.to_quat}.")
