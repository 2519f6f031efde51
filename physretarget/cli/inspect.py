"""inspect: what a character or a capture is understood to be."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from physretarget import capture
from physretarget.capture import Inspection
from physretarget.cli import app
from physretarget.cli.common import Given, command, say, warn
from physretarget.mjcf import Character
from physretarget.mjcf.audit import audit
from physretarget.options import INSPECT, build
from physretarget.options.motion import CaptureOptions, InspectionOutput
from physretarget.report.words import count

_MODELS = (".xml", ".mjcf", ".mjb", ".urdf")
_PLAIN_M = 0.001  # residuals below a millimetre are not worth a digit


@command(
    app,
    "inspect",
    INSPECT,
    example="physretarget inspect models/lamp.xml",
)
def inspect_command(
    file: Annotated[
        Path, typer.Argument(metavar="MODEL.xml|CAPTURE", help="Model or capture to inspect.")
    ],
    given: Given,
) -> None:
    """Audit a character, or show how a capture is read.

    For a character: mass, inertia, geometry, limits. For a capture: labels, residuals, unit, up
    axis, floor, heading and doubts.
    """
    output = build(InspectionOutput, given)
    if file.suffix.lower() in _MODELS:
        _tell_model(file, output.format)
        return
    options = asdict(build(CaptureOptions, given)) | {"map": given.get("map")}
    fails = options.pop("on_doubt") == "fail"
    found = capture.inspect(file, skeleton=given.get("skeleton"), **options)
    if output.format == "json":
        typer.echo(json.dumps(found.document(), indent=1, ensure_ascii=False))
    else:
        typer.echo(_capture_text(found))
    for doubt in found.doubts:
        warn(doubt)
    if output.picture is not None:
        from physretarget.report.capture_picture import draw_capture  # matplotlib is slow

        draw_capture(file, output.picture, skeleton=given.get("skeleton"), **options)
        say(f"{output.picture}: the capture and the actor fitted to it.")
    if fails and found.doubts:
        raise typer.Exit(1)


def _tell_model(path: Path, form: str) -> None:
    character = Character.load(path)
    facts = audit(character)
    if form == "json":
        typer.echo(json.dumps(_model_document(character, facts), indent=1, ensure_ascii=False))
        return
    typer.echo(
        f"{character.name}: {character.mass:.3f} kg, {character.height:.3f} m tall, centre of "
        f"mass at {character.com_height:.3f} m, {len(character.joint_names)} joints, "
        f"{len(character.contacts)} contact points, {len(character.markers)} markers."
    )
    for note in character.notes:
        typer.echo(f"note: {note}")
    for fact in facts:
        where = f"{fact.subject} {fact.name}: " if fact.subject != "model" and fact.name else ""
        typer.echo(f"{fact.key}: {where}{fact.message}")
    say(f"{count(len(facts), 'remark')}.")


def _model_document(character: Character, facts: Any) -> dict[str, Any]:
    return {
        "schema": "physretarget/character/1",
        "name": character.name,
        "mass_kg": character.mass,
        "height_m": character.height,
        "com_height_m": character.com_height,
        "joints": list(character.joint_names),
        "contact_points": list(character.contacts.names),
        "notes": list(character.notes),
        "remarks": [
            {"key": f.key, "subject": f.subject, "name": f.name, "message": f.message}
            for f in facts
        ],
    }


def _capture_text(found: Inspection) -> str:
    error = "" if found.marker_error_m is None else f", {1000 * found.marker_error_m:.1f} mm error"
    known = [part for part in found.parts if part.segment]
    lines = [
        f"{found.path}: {found.format.upper()}, {len(known)} of {len(found.parts)} {found.kind} "
        f"known, {found.frames} frames at {found.fps:g} fps ({found.duration_s:.2f} s), "
        f"{found.valid_frames} usable.",
        f"unit {found.unit}, up {found.up}, actor {found.height_m:.2f} m and {found.mass_kg:.0f} kg"
        f"{error}; faces {found.facing_degrees:.0f} degrees, travels {found.travel_m:.2f} m.",
    ]
    width = max((len(part.name) for part in found.parts), default=0)
    for part in found.parts:
        residual = ""
        if part.residual_m is not None:
            far = part.residual_m >= _PLAIN_M
            residual = f"{1000 * part.residual_m:6.1f} mm" if far else "      < 1 mm"
        seen = "" if part.seen > 0.999 else f"  seen {100 * part.seen:.0f} %"
        lines.append(f"  {part.name:{width}}  {part.meaning or '-':20} {residual}{seen}".rstrip())
    lines += [f"note: {note}" for note in found.notes]
    return "\n".join(lines)
