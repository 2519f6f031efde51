"""keyposes suggest and propose: what to pose next, and a pose to start from."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray

from physretarget import capture
from physretarget.capture.actor import ActorMotion, ActorShape
from physretarget.cli.common import Given, command, progress, say
from physretarget.cli.keyposes import group
from physretarget.errors import InputError, UsageError
from physretarget.keyposes import (
    KeyPose,
    KeyPoseSet,
    load_keyposes,
    propose,
    save,
    sheet,
    without_heading,
)
from physretarget.keyposes.candidates import (
    Candidates,
    NextFrame,
    find_candidates,
    next_frames,
    start_name,
)
from physretarget.keyposes.limbs import Choice
from physretarget.keyposes.propose import planted_points
from physretarget.mjcf import Character
from physretarget.options import PROPOSE, SUGGEST, build
from physretarget.options.motion import CAPTURES
from physretarget.options.posing import ProposeOptions, SuggestOptions
from physretarget.report.words import count as counted
from physretarget.trained import check_mobile

Array = NDArray[np.float64]
LICENSE = "unknown: write here under which terms the captures may be used"


@command(
    group,
    "suggest",
    SUGGEST,
    example="physretarget keyposes suggest walk.bvh jump.bvh --character lamp.xml "
    "--keyposes lamp.keyposes.toml --count 5 --out next.toml",
)
def suggest_command(
    captures: Annotated[list[Path], typer.Argument(metavar="CAPTURE...", help=f"{CAPTURES}.")],
    given: Given,
) -> None:
    """List which frames to pose next, best first, and why."""
    told = build(SuggestOptions, given)
    model = Character.load(given["character"])
    check_mobile(model)
    posed = load_keyposes(told.keyposes, model) if told.keyposes else None
    with progress("reading"):
        candidates = find_candidates(
            [capture.load(path, map=given.get("map")) for path in captures], fps=told.resample
        )
        found = next_frames(candidates, posed, count=told.count)
    for note in candidates.notes:
        say(note)
    rows = _rows(candidates, found)
    if told.format == "json":
        typer.echo(json.dumps(rows, indent=1))
    else:
        _table(rows)
    if len(found) < told.count:
        say(f"{len(found)} frames: no other is unlike these and what is posed.")
    places = [candidates.place(each.suggestion.index) for each in found]
    limbs = posed.limbs if posed else ()
    _write(model, places, [each.reason for each in found], told.out, told.sheet, limbs)


@command(
    group,
    "propose",
    PROPOSE,
    example="physretarget keyposes propose walk.bvh --time 1.5 --character lamp.xml --out new.toml",
)
def propose_command(
    captured: Annotated[Path, typer.Argument(metavar="CAPTURE", help=f"{CAPTURES}.")],
    given: Given,
) -> None:
    """Make start poses for frames of your choice."""
    told = build(ProposeOptions, given)
    model = Character.load(given["character"])
    check_mobile(model)
    motion = capture.load(captured, map=given.get("map"))
    for each in told.time:
        if not 0 <= each <= motion.time[-1] + 1e-9:
            raise UsageError(
                f"--time is {each:g}; {captured.name} has 0 to {motion.time[-1]:.3f} s."
            )
    places = [(motion, int(np.argmin(np.abs(motion.time - each)))) for each in told.time]
    _write(model, places, ["chosen by hand"] * len(places), told.out, told.sheet)


def _rows(candidates: Candidates, found: tuple[NextFrame, ...]) -> list[dict[str, object]]:
    rows: list[dict[str, object]] = []
    for rank, each in enumerate(found, start=1):
        told = each.suggestion
        motion, frame = candidates.place(told.index)
        rows.append(
            {
                "rank": rank,
                "capture": motion.source.name,
                "frame": frame,
                "time_s": round(float(motion.time[frame]), 4),
                "score": round(told.score, 4),
                "stands_for": round(told.stands_for, 4),
                "nearest": each.nearest or None,
                "distance_m": round(told.distance, 4) if each.nearest else None,
                "reason": each.reason,
            }
        )
    return rows


def _table(rows: list[dict[str, object]]) -> None:
    width = max([len(str(row["capture"])) for row in rows] + [7])
    typer.echo(f"{'':>3}  {'capture':<{width}}  frame   time s  score  why")
    for row in rows:
        typer.echo(
            f"{row['rank']:>3}  {row['capture']:<{width}}  {row['frame']:>5}  {row['time_s']:>7.2f}"
            f"  {row['score']:>5.2f}  {row['reason']}"
        )


def _write(
    model: Character,
    places: list[tuple[ActorMotion, int]],
    reasons: list[str],
    out: Path | None,
    picture: Path | None,
    limbs: Choice = (),
) -> None:
    """The start poses as a file to edit, and as a picture."""
    if out is None and picture is None:
        return
    if picture is not None and picture.suffix.lower() != ".png":
        raise UsageError(f"--sheet is {str(picture)!r}; the sheet is a picture that ends in .png.")
    if not places:
        raise InputError("no frame is worth posing, so there is nothing to write.")
    poses: list[KeyPose] = []
    for (motion, frame), reason in zip(places, reasons, strict=True):
        actor = without_heading(motion.on(ActorShape.reference()).qpos[frame])
        poses.append(
            KeyPose(
                name=start_name(motion, frame),
                source=motion.source.name,
                sha256=motion.source.sha256,
                time=float(motion.time[frame]),
                actor_qpos=actor,
                qpos=propose(model, actor, limbs=limbs),
                planted=planted_points(actor),
                note=f"Start pose, to be posed. {reason}.",
            )
        )
    made = KeyPoseSet(
        character_name=model.name,
        character_sha256=model.sha256,
        license=LICENSE,
        poses=tuple({pose.name: pose for pose in poses}.values()),
        limbs=limbs,
    )
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        save(made, out, model)
        say(f"{out}: {counted(len(made), 'start pose')}.")
    if picture is not None:
        picture.parent.mkdir(parents=True, exist_ok=True)
        sheet(made, model, picture)
        say(f"{picture}: {len(made)} pairs.")
