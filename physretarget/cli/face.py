"""face: an animator's library, matching of facial capture, and plain key reduction."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from physretarget.cli import app
from physretarget.cli.common import Given, command, progress, say
from physretarget.errors import UsageError
from physretarget.face.curve import Curve, Key
from physretarget.face.events import find_events, moved
from physretarget.face.formats import read_shots, read_take, write_shot
from physretarget.face.library import Library, LibrarySettings
from physretarget.face.match import Banks, MatchSettings, Result, match
from physretarget.face.measure import extremum_timing, turning_point_timing
from physretarget.face.reduce import reduce_curve
from physretarget.face.report import take_report, write_report
from physretarget.face.rig import Rig, guess_group
from physretarget.face.shot import Shot
from physretarget.face.style_file import StyleFile
from physretarget.files import write_file
from physretarget.options import EVENTS, LIBRARY, MATCH, REDUCE, build
from physretarget.options.facial import (
    LARGEST_ERROR,
    EventOptions,
    LibraryFiles,
    LibraryOptions,
    MatchReport,
    RangeOptions,
    ReductionOptions,
    RigFile,
)
from physretarget.options.motion import Resampling

group = typer.Typer(
    help="Turn facial capture into an animator's sparse curves.",
    epilog="Example: physretarget face library takes/*.anim --rig face.toml --out style.npz",
    no_args_is_help=True,
)
app.add_typer(group, name="face")

CaptureArgument = Annotated[
    Path,
    typer.Argument(
        metavar="CAPTURE",
        help="Facial capture: Live Link Face, Audio2Face, a CSV with times, keyed curves, …",
    ),
]


@command(
    group,
    "library",
    LIBRARY,
    example="physretarget face library shots/ --rig girl.toml --out style.npz",
)
def library_command(
    paths: Annotated[
        list[Path], typer.Argument(metavar="SHOT...", help="Keyed curves, or folders of them.")
    ],
    given: Given,
) -> None:
    """Collect past shots into a library.

    Updates an existing library; unchanged files are not read again.
    """
    told, rig = build(LibraryOptions, given), build(RigFile, given).rig
    out, chosen = told.out, None if rig is None else Rig.load(rig)
    previous = Library.load(out) if out.exists() else None
    skipped: list[str] = []
    with progress("reading") as stage:
        made = Library.build(
            paths, LibrarySettings(min_keys=told.min_keys), previous=previous, progress=stage,
            left_out=skipped.append,
        )  # fmt: skip
    for why in skipped:
        say(f"Left out: {why}")
    made.save(out)
    lines = made.describe().splitlines()
    say(f"{out}: {lines[0]}.")
    if chosen is not None:
        for name in dict.fromkeys(c.group for c in chosen.matched()):
            count = sum(chosen.borrows(name, e.channel) for e in made.examples)
            say(f"{name}: {count} curves to borrow from.")
    if told.list:
        typer.echo("\n".join(lines[1:]))


@command(
    group,
    "match",
    MATCH,
    example="physretarget face match take.csv --library style.npz --rig girl.toml --out take.anim",
)
def match_command(capture: CaptureArgument, given: Given) -> None:
    """Turn a capture into sparse curves in the library's style."""
    files, rig, out = build(LibraryFiles, given), build(RigFile, given).rig, given["out"]
    settings = build(MatchSettings, given)
    take = read_take(capture, fps=build(Resampling, given).resample)
    shots = Library.load(files.library)
    part = build(RangeOptions, given)
    span = None
    if part.start is not None or part.end is not None:
        span = (part.start or 0.0, take.time[-1] if part.end is None else part.end)
    used = Rig.of(take) if rig is None else Rig.load(rig)
    pins = {} if files.locked is None else _locked(files.locked)
    banks = Banks(style_file=StyleFile.beside(files.library))
    with progress("matching") as stage:
        result = match(
            take, shots, used, settings, span=span, locked=pins, banks=banks, progress=stage
        )
    for note in (*result.notes, *write_shot(out, result.shot())):
        say(note)
    dense = len(result.take.time)
    say(
        f"{out}: {len(result.channels)} channels, {result.keys} keys, "
        f"{100 * result.reduction:.1f} % fewer than the capture's {dense} frames each."
    )
    report = build(MatchReport, given).report
    if report is not None:
        _write_report(report, result, used)
        with progress("report"):
            write_report(report / "index.html", take_report(result, used, shots))
        say(f"{report / 'index.html'}: every channel on a timeline; click a key for its source.")


@command(
    group,
    "events",
    EVENTS,
    example="physretarget face events take.anim --rig girl.toml --move 3 --by 0.1 --out later.anim",
)
def events_command(
    curves: Annotated[Path, typer.Argument(metavar="CURVES", help="Keyed curves of one shot.")],
    given: Given,
) -> None:
    """List the events of a take, and move one as a whole.

    Events are blinks, eye darts, brow hits, jaw drops, nods and holds, over all their channels.
    """
    told, rig = build(EventOptions, given), build(RigFile, given).rig
    if (told.move is None) != (told.by is None) or (told.move is None) != (told.out is None):
        raise UsageError("--move, --by and --out belong together.")
    shot = _one_shot(curves)
    named = {} if rig is None else {c.name: c.group for c in Rig.load(rig).channels}
    groups = {name: named.get(name) or guess_group(name) for name in shot.curves}
    found = find_events(shot.curves, groups)
    if told.move is None or told.by is None or told.out is None:
        for number, event in enumerate(found, 1):
            names = ", ".join(event.channels) if event.kind != "hold" else "all"
            typer.echo(
                f"{number:4d}  {event.kind:9s} {event.start:7.2f}–{event.end:.2f} s  {names}"
            )
        say(f"{curves}: {len(found)} events.")
        return
    if told.move > len(found):
        raise UsageError(f"--move {told.move}: {curves} has {len(found)} events.")
    event = found[told.move - 1]
    for loss in write_shot(told.out, moved(shot, event, told.by)):
        say(loss)
    say(f"{told.out}: {event.kind} from {event.start:.2f} to {event.start + told.by:.2f} s.")


def _one_shot(path: Path) -> Shot:
    shots = read_shots(path)
    if len(shots) != 1:
        raise UsageError(f"{path}: one shot is needed, it holds {len(shots)}.")
    return shots[0]


def _locked(path: Path) -> dict[str, tuple[Key, ...]]:
    return {name: curve.keys for name, curve in _one_shot(path).curves.items()}


def _write_report(folder: Path, result: Result, rig: Rig) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    events = find_events(result.shot().curves, {c.name: c.group for c in rig.channels})
    content = {
        "schema": "physretarget/face/1",
        "capture": {
            "name": result.take.name,
            "sha256": result.take.sha256,
            "frames": len(result.take.time),
            "fps": result.take.fps,
        },
        "settings": asdict(result.settings),
        "keys": result.keys,
        "reduction": result.reduction,
        "events": [asdict(event) for event in events],
        "channels": {
            name: {
                "error": channel.error,
                "unit": channel.unit,
                "keys": len(channel.curve.keys),
                "turning_points": _turning_points(result, name),
                "piece_of_key": channel.piece_of,
                "pieces": [asdict(piece) for piece in channel.pieces],
            }
            for name, channel in result.channels.items()
        },
    }
    write_file(folder / "report.json", (json.dumps(content, indent=1) + "\n").encode())
    say(f"{folder / 'report.json'}: where every key comes from.")


def _turning_points(result: Result, name: str) -> dict[str, float | int | None]:
    """Those that stand out by a tenth of what the channel moves: frames off, in two measures.

    plateaus: where found, gaps between plateaus. peaks: from each peak frame to the nearest, holds
    and all.
    """
    channel, capture = result.channels[name], result.take.channel(name)
    output, least = channel.curve.evaluate(result.take.time), 0.1 * channel.unit
    timing = turning_point_timing(output, capture, least)
    off = {"plateaus": timing.frames, "peaks": extremum_timing(output, capture, least)}
    return {
        "count": timing.count,
        "missed": timing.missed,
        **{kind: frames if math.isfinite(frames) else None for kind, frames in off.items()},
    }


@command(
    group,
    "reduce",
    REDUCE,
    example="physretarget face reduce take.csv --error 0.02 --out take.curves.json",
)
def reduce_command(capture: CaptureArgument, given: Given) -> None:
    """Reduce keys without a library, as a baseline."""
    told, rig, out = build(ReductionOptions, given), build(RigFile, given).rig, given["out"]
    error = LARGEST_ERROR if told.error is None and told.keys is None else told.error
    take = read_take(capture, fps=build(Resampling, given).resample)
    used = Rig.of(take) if rig is None else Rig.load(rig)
    driven = used.drive(take)
    curves: dict[str, Curve] = {}
    with progress("reducing") as stage:
        for channel in used.matched(lips=told.lips):
            stage(channel.name)
            values = driven.channel(channel.name)
            unit = min(max(float(values.max() - values.min()), 0.05 * channel.range), channel.range)
            curves[channel.name] = reduce_curve(
                values,
                take.fps,
                told.how,
                error=None if error is None else error * unit,
                keys=told.keys,
            )
    shot = Shot(take.name, curves, take.fps, take.sha256)
    for loss in write_shot(out, shot):
        say(loss)
    total = sum(len(c.keys) for c in curves.values())
    dense = len(take.time) * max(1, len(curves))
    say(f"{out}: {len(curves)} channels, {total} keys, {100 * (1 - total / dense):.1f} % fewer.")
