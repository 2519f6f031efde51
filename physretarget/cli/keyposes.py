"""keyposes: is the file sound, and a picture of every pair."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from physretarget.cli import app
from physretarget.cli.common import Given, command, progress, say
from physretarget.errors import UsageError
from physretarget.keyposes import check, load_keyposes, plant, save, sheet
from physretarget.mjcf import Character
from physretarget.options import CHECK, PLANT, SHEET, build
from physretarget.options.posing import PlantOptions

group = typer.Typer(
    help="Check, draw, suggest, propose and plant key poses.",
    epilog="Example: physretarget keyposes check lamp.keyposes.toml --character lamp.xml",
    no_args_is_help=True,
)
app.add_typer(group, name="keyposes")

Files = Annotated[list[Path], typer.Argument(metavar="FILE...", help="Key pose files (TOML).")]


@command(
    group,
    "check",
    CHECK,
    example="physretarget keyposes check lamp.keyposes.toml --character lamp.xml",
)
def check_command(files: Files, given: Given) -> None:
    """Check key pose files.

    Looks at joint limits, the floor, planted points, headings, and pairs that contradict each
    other. Exit code 1 if a pose cannot be used for learning.
    """
    model = Character.load(given["character"])
    poses = load_keyposes(files, model)
    remarks = check(poses, model)
    for remark in remarks:
        where = f"{remark.pose}: " if remark.pose else ""
        typer.echo(f"{remark.severity}: {where}{remark.message}")
    errors = sum(remark.severity == "error" for remark in remarks)
    say(f"{len(poses)} key poses: {errors} errors, {len(remarks) - errors} warnings.")
    if errors:
        raise typer.Exit(1)


@command(
    group,
    "plant",
    PLANT,
    example="physretarget keyposes plant crab.keyposes.toml --character crab.xml",
)
def plant_command(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Key pose file (TOML).")],
    given: Given,
) -> None:
    """Put key poses down on the floor, planted points first.

    Each pose moves as little as possible, within joint limits.
    """
    told = build(PlantOptions, given)
    model = Character.load(given["character"])
    before = load_keyposes(file, model)
    after = plant(before, model)
    target = told.out or file
    save(after, target, model)
    wrong = [sum(r.severity == "error" for r in check(each, model)) for each in (before, after)]
    say(f"{target}: {len(after)} key poses put down; errors {wrong[0]} before, {wrong[1]} now.")


@command(
    group,
    "sheet",
    SHEET,
    example="physretarget keyposes sheet lamp.keyposes.toml --character lamp.xml --out lamp.png",
)
def sheet_command(files: Files, given: Given) -> None:
    """Draw every pair, actor beside character, into one picture."""
    out: Path = given["out"]
    if out.suffix.lower() != ".png":
        raise UsageError(f"--out is {str(out)!r}; the sheet is a picture that ends in .png.")
    model = Character.load(given["character"])
    poses = load_keyposes(files, model)
    out.parent.mkdir(parents=True, exist_ok=True)
    with progress("drawing"):
        sheet(poses, model, out)
    say(f"{out}: {len(poses)} pairs.")
