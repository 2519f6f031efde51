"""reproduce: a paper's figures and tables, from real data."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from physretarget.cli import app
from physretarget.cli.common import command, complete, one_of, progress

Step = Callable[[str], None]


def _yamane2010(data: Path, out: Path, processes: int, step: Step) -> tuple[Path, ...]:
    from physretarget.demo import models_folder
    from physretarget.reproduce import reproduce_yamane2010

    models = models_folder()
    page, _ = reproduce_yamane2010(data, out, models=models, processes=processes, progress=step)
    return (page,)


def _ruhland2017(data: Path, out: Path, processes: int, step: Step) -> tuple[Path, ...]:
    from physretarget.face.reproduce import reproduce
    from physretarget.face.reproduce_page import write_all

    # One process: it also tells its cost.
    return write_all(reproduce(data, parts=out / "parts", progress=step), out)


PAPERS = {"yamane2010": _yamane2010, "ruhland2017": _ruhland2017}
"""Paper → function that returns the files written."""


@command(app, "reproduce", example="physretarget reproduce ruhland2017 --data data --out figures")
def reproduce_command(
    paper: Annotated[
        str,
        typer.Argument(
            help="Yamane, Ariki, Hodgins 2010, or Ruhland, Prasad, McDonnell 2017.",
            **complete(tuple(PAPERS)),
        ),
    ],
    data: Annotated[
        Path,
        typer.Option(
            "--data",
            metavar="DIR",
            help="Folder of captures and keys; docs/evidence.md and docs/face.md say which.",
        ),
    ],
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Folder for pages, figures and tables.")
    ],
    processes: Annotated[
        int,
        typer.Option(
            "--processes",
            metavar="N",
            min=1,
            help="Number of takes processed in parallel (yamane2010).",
        ),
    ] = 2,
) -> None:
    "Make a paper's figures and tables from real data."
    one_of(paper, tuple(PAPERS), "PAPER")
    with progress(f"reproduce {paper}") as step:
        written = PAPERS[paper](data, out, processes, step)
    for path in written:
        typer.echo(str(path))
