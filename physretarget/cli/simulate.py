"""simulate: a clip played forward by MuJoCo."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from physretarget.cli import app
from physretarget.cli.common import Given, command, progress, say
from physretarget.clip import Clip, load_clip
from physretarget.files import write_file
from physretarget.mjcf import Character
from physretarget.options import SIMULATE, build
from physretarget.options.motion import ClipOptions
from physretarget.options.simulation import SimulationOptions, SimulationOutput
from physretarget.simulate import Simulation, settings_of, simulate


@command(
    app,
    "simulate",
    SIMULATE,
    example="physretarget simulate walk.npz --model penguin.xml --out SIM.npz",
)
def simulate_command(
    clip: Annotated[Path, typer.Argument(metavar="CLIP", help="The clip to play.")],
    given: Given,
) -> None:
    """Play a clip forward in MuJoCo, by joint torques.

    Reports how far the body gets and how near it stays. --out stores the motion, its torques and
    feedback gains; ten lines of MuJoCo reproduce it. Exit code 1 if the body is lost before the
    clip's end. Ctrl-C keeps what was played so far.
    """
    told = build(SimulationOutput, given)
    settings = settings_of(build(SimulationOptions, given))
    character = Character.load(given["model"])
    motion = load_clip(clip, character=character, **asdict(build(ClipOptions, given)))
    with progress(f"simulate {clip.name}") as step:
        played = simulate(
            motion,
            character,
            settings,
            progress=lambda done, whole: step(f"{done:.1f} of {whole:.1f} s survived"),
        )
    for note in played.notes:
        say(f"note: {note}.")
    if told.out is not None:
        played.save(told.out)
        say(str(told.out))
    numbers = _numbers(played)
    if told.report is not None:
        _report(told.report, played, motion, character, numbers)
    text = json.dumps(numbers, indent=2) if told.format == "json" else _sentences(played)
    typer.echo(text)
    if played.ending == "interrupted":
        raise typer.Exit(130)
    if not played.survived:
        raise typer.Exit(1)


def _numbers(played: Simulation) -> dict[str, Any]:
    return {
        "ending": played.ending,
        "lost_at_s": None if played.survived else played.measures.survived_s,
        "measures": {
            name: {"value": value, "unit": unit}
            for name, (value, unit) in played.measures.named().items()
        },
        "notes": list(played.notes),
        "cpu_s": round(played.cpu_s, 3),
    }


def _sentences(played: Simulation) -> str:
    measures = played.measures
    lines = [
        f"{name:32} {value:10.4g} {'' if unit == '1' else unit}".rstrip()
        for name, (value, unit) in measures.named().items()
    ]
    how = {
        "end": f"plays to its end, {measures.duration_s:.2f} s",
        "lost": f"is lost at {measures.survived_s:.2f} s of {measures.duration_s:.2f} s",
        "interrupted": f"was interrupted at {measures.survived_s:.2f} s",
    }[played.ending]
    return "\n".join([*lines, f"The clip {how}."])


def _report(
    folder: Path,
    played: Simulation,
    clip: Clip,
    character: Character,
    numbers: dict[str, Any],
) -> None:
    from physretarget.report.simulation import render_simulation

    write_file(folder / "simulation.json", (json.dumps(numbers, indent=2) + "\n").encode())
    write_file(folder / "index.html", render_simulation(played, clip, character).encode())
    say(str(folder / "index.html"))
