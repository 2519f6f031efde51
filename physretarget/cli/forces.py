"""forces: ground forces, centres of pressure and free moments of a capture, without plates."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from physretarget.cli import app
from physretarget.cli.common import Given, command, progress, say
from physretarget.errors import UsageError
from physretarget.kinetics import forces
from physretarget.options import FORCES, build, told
from physretarget.options.forces import ForcesOptions
from physretarget.options.motion import CAPTURES, CaptureOptions, NameMapFile, SkeletonFile

ENDINGS = (".mot", ".csv")

CaptureArgument = Annotated[Path, typer.Argument(metavar="CAPTURE", help=f"A {CAPTURES} file.")]


@command(app, "forces", FORCES, example="physretarget forces run.trc --mass 71.5 --out run.mot")
def forces_command(source: CaptureArgument, given: Given) -> None:
    """Estimate the ground forces of a capture without force plates.

    Writes force, centre of pressure and free moment of each foot. Columns and axes are OpenSim's:
    y up, ground_force_r_vx … in N, ground_force_r_px … in m and ground_torque_r_x … in N m for the
    right foot, l for the left. Times are those of the capture.
    """
    out: Path = given["out"]
    if out.suffix.lower() not in ENDINGS:
        raise UsageError(f"--out is {str(out)!r}; forces are written as {' or '.join(ENDINGS)}.")
    picture: Path | None = given.get("report")
    if picture is not None and picture.suffix.lower() != ".png":
        raise UsageError(f"--report is {str(picture)!r}; a picture of forces is a .png.")
    with progress(source.name):
        found = forces(
            source,
            lowpass_hz=build(ForcesOptions, given).lowpass_hz,
            **told(CaptureOptions, given),
            **told(SkeletonFile, given),
            **told(NameMapFile, given),
        )
        found.write(out)
        if picture is not None:
            from physretarget.kinetics.picture import write_picture

            write_picture(found, picture)
    for note in found.notes:
        say(f"  note: {note}")
    typer.echo(found.summary())
    say(f"{out}: {len(found.time)} rows.")
