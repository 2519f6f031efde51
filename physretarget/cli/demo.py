"""demo: the main job, end to end, on real captures, without arguments."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from physretarget import demo
from physretarget.cli import app
from physretarget.cli.common import command, progress
from physretarget.report.text import one_line


@command(app, "demo", example="physretarget demo --out physretarget-demo")
def demo_command(
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Folder for clips and reports.")
    ] = Path("physretarget-demo"),
) -> None:
    """Have a desk lamp act out a real jump and dance."""
    with progress("demo", steps=demo.STEPS) as step:
        index, shown = demo.run(out, progress=step)
    for each in shown:
        typer.echo(
            f"{each.name}: {each.result.clip.duration:.2f} s of animation, {one_line(each.report)}"
        )
    typer.echo(f"Open {index.resolve()} in a browser.")
