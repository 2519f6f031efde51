"""keyposes suggest and propose: what to pose next, and a pose to start from."""

from __future__ import annotations

import json
from dataclasses import dataclass
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
from physretarget.features import INVERTED_COSINE, features
from physretarget.keyposes import (
    KeyPose,
    KeyPoseSet,
    actor_character_of_reference,
    load_keyposes,
    propose,
    save,
    sheet,
    without_heading,
)
from physretarget.keyposes.propose import planted_points
from physretarget.keyposes.suggest import MOST_FRAMES, Suggestion, suggest
from physretarget.mjcf import Character
from physretarget.options import PROPOSE, SUGGEST, build
from physretarget.options.motion import CAPTURES
from physretarget.options.posing import ProposeOptions, SuggestOptions
from physretarget.report.words import count as counted
from physretarget.trained import check_mobile

Array = NDArray[np.float64]
LICENSE = "unknown: write here under which terms the captures may be used"


@dataclass(frozen=True, eq=False)
class _Candidates:
    """Frames to choose from: which motion and frame each is, and features (M, DY)."""

    motions: tuple[ActorMotion, ...]
    motion: NDArray[np.int64]
    frame: NDArray[np.int64]
    y: Array


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
    """Say which frames to pose next, best first, and why."""
    told = build(SuggestOptions, given)
    model = Character.load(given["character"])
    check_mobile(model)
    posed = load_keyposes(told.keyposes, model) if told.keyposes else None
    with progress("reading"):
        candidates = _candidates(captures, told.resample)
        known = _posed_features(posed)
        found = suggest(candidates.y, known, count=told.count)
    rows = _rows(candidates, found, posed)
    if told.format == "json":
        typer.echo(json.dumps(rows, indent=1))
    else:
        _table(rows)
    if len(found) < told.count:
        say(f"{len(found)} frames: no other is unlike these and what is posed.")
    places = [
        (candidates.motions[candidates.motion[s.index]], _frame(candidates, s)) for s in found
    ]
    _write(model, places, [str(row["reason"]) for row in rows], told.out, told.sheet)


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
    motion = capture.load(captured)
    for each in told.time:
        if not 0 <= each <= motion.time[-1] + 1e-9:
            raise UsageError(
                f"--time is {each:g}; {captured.name} has 0 to {motion.time[-1]:.3f} s."
            )
    places = [(motion, int(np.argmin(np.abs(motion.time - each)))) for each in told.time]
    _write(model, places, ["chosen by hand"] * len(places), told.out, told.sheet)


def _candidates(captures: list[Path], fps: float) -> _Candidates:
    """Valid frames of all captures, ``fps`` per second, thinned to what can be compared."""
    actor = actor_character_of_reference()
    motions, motion, frame, y = [], [], [], []
    for number, path in enumerate(captures):
        own = capture.load(path)
        step = max(own.fps / fps, 1.0)
        taken = np.unique(np.round(np.arange(0, len(own.time) - 1e-9, step)).astype(np.int64))
        taken = taken[(taken < len(own.time))]
        taken = taken[own.valid[taken]]
        # Upside down a body has no heading, and so no key pose: Yamane 2010, section 4.1.
        tilt = own.qpos[taken, 4] ** 2 + own.qpos[taken, 5] ** 2
        upright = 1.0 - 2.0 * tilt > INVERTED_COSINE
        if not upright.all():
            say(f"{path.name}: {int((~upright).sum())} frames upside down are left out.")
        taken = taken[upright]
        qpos = own.on(ActorShape.reference()).qpos[taken]
        motions.append(own)
        motion.append(np.full(len(taken), number))
        frame.append(taken)
        y.append(np.array([features(actor, each[None])[0] for each in qpos]).reshape(len(qpos), -1))
    keep = slice(None, None, int(np.ceil(max(sum(map(len, frame)), 1) / MOST_FRAMES)))
    all_y = np.concatenate([each for each in y if len(each)] or [np.zeros((0, 1))])
    return _Candidates(
        tuple(motions), np.concatenate(motion)[keep], np.concatenate(frame)[keep], all_y[keep]
    )


def _posed_features(posed: KeyPoseSet | None) -> Array:
    actor = actor_character_of_reference()
    poses = posed.poses if posed else ()
    return np.array([features(actor, pose.actor_qpos[None])[0] for pose in poses])


def _frame(candidates: _Candidates, suggestion: Suggestion) -> int:
    return int(candidates.frame[suggestion.index])


def _rows(
    candidates: _Candidates, found: tuple[Suggestion, ...], posed: KeyPoseSet | None
) -> list[dict[str, object]]:
    names = [pose.name for pose in posed.poses] if posed else []
    rows: list[dict[str, object]] = []
    for rank, each in enumerate(found, start=1):
        motion, frame = candidates.motions[candidates.motion[each.index]], _frame(candidates, each)
        near = ""
        if each.nearest is not None:
            known = each.nearest < len(names)
            near = names[each.nearest] if known else f"suggestion {each.nearest - len(names) + 1}"
        rows.append(
            {
                "rank": rank,
                "capture": motion.source.name,
                "frame": frame,
                "time_s": round(float(motion.time[frame]), 4),
                "score": round(each.score, 4),
                "stands_for": round(each.stands_for, 4),
                "nearest": near or None,
                "distance_m": round(each.distance, 4) if near else None,
                "reason": _reason(each, near),
            }
        )
    return rows


def _reason(each: Suggestion, near: str) -> str:
    share = f"{each.stands_for:.0%} of all frames" if each.stands_for >= 0.005 else "itself alone"
    if not near:
        return f"nothing is posed yet; stands for {share}"
    return f"{100 * each.distance:.0f} cm (RMS) from {near}, its nearest; stands for {share}"


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
        stem = Path(motion.source.name).stem
        name = f"{stem}-{motion.time[frame]:.2f}"
        poses.append(
            KeyPose(
                name=name,
                source=motion.source.name,
                sha256=motion.source.sha256,
                time=float(motion.time[frame]),
                actor_qpos=actor,
                qpos=propose(model, actor),
                planted=planted_points(actor),
                note=f"Start pose, to be posed. {reason}.",
            )
        )
    made = KeyPoseSet(
        character_name=model.name,
        character_sha256=model.sha256,
        license=LICENSE,
        poses=tuple({pose.name: pose for pose in poses}.values()),
    )
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        save(made, out, model)
        say(f"{out}: {counted(len(made), 'start pose')}.")
    if picture is not None:
        picture.parent.mkdir(parents=True, exist_ok=True)
        sheet(made, model, picture)
        say(f"{picture}: {len(made)} pairs.")
