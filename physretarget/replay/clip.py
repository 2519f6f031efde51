"""The scene of one judged clip: the character, its contact forces, its findings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from physretarget.clip import Clip
from physretarget.errors import UsageError
from physretarget.mjcf import Character
from physretarget.replay.figures import figure
from physretarget.replay.scene import Forces, Scene, marks
from physretarget.replay.video import write_video
from physretarget.replay.web import write_html
from physretarget.validation import Report, validate

_TINT = (0.42, 0.52, 0.70)


def clip_scene(
    clip: Clip,
    character: Character,
    report: Report,
    *,
    findings: Sequence[Mapping[str, Any]] | None = None,
    title: str | None = None,
) -> Scene:
    """Put a clip on stage.

    Args:
        clip: the motion.
        character: whose motion it is.
        report: the verdict on it; gives contact forces and, unless told, findings.
        findings: findings of a stored report (its JSON form) to show instead.
        title: headline, the clip's name if None.

    Returns:
        The scene, to be shown, filmed or written.
    """
    shown = (
        report.findings if findings is None else [SimpleNamespace(**entry) for entry in findings]
    )
    active = None
    if clip.contact_active is not None and clip.contact_points == character.contacts.names:
        active = clip.contact_active
    return Scene(
        title=title or clip.name,
        time=clip.time,
        figures=(
            figure(
                character,
                clip.qpos,
                name=character.name,
                tint=_TINT,
                contact_active=active,
                forces=report_forces(report, clip.frames),
            ),
        ),
        marks=marks(shown),
    )


def write_replay(
    clip: Clip, character: Character, path: str | Path, *, report: Report | None = None
) -> Path:
    """Write a replay with forces and findings: a page that plays offline, or a film.

    Args:
        clip: The motion.
        character: Whose motion it is.
        path: A file that ends in .html, or in .mp4 (extra ``video``).
        report: The verdict on the clip; judged here if None.

    Returns:
        The file.

    Raises:
        UsageError: The file's name ends in something else.
        MissingExtraError: A film without the extra ``video``.
    """
    path = Path(path)
    judged = report or validate(clip, character)
    scene = clip_scene(clip, character, judged)
    if path.suffix.lower() == ".mp4":
        return write_video(scene, path)
    if path.suffix.lower() not in {".html", ".htm"}:
        raise UsageError(f"a replay is a .html or an .mp4 file, not {path.name!r}.")
    write_html(scene, path, outcome=judged.verdict)
    return path


def report_forces(report: Report, frames: int) -> Forces | None:
    """The contact forces that best explain the motion, one arrow for each body that bears load.

    None where none could be found, or where an uneven clip was judged at other times than it
    shows.
    """
    found = report.forces
    if found is None or len(found.vector) != frames:
        return None
    return Forces(found.origin.astype(np.float64), found.vector.astype(np.float64))
