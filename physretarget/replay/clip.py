"""The scene of one judged clip: the character, its contact forces, its findings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from physretarget.clip import Clip
from physretarget.mjcf import Character
from physretarget.replay.figures import figure
from physretarget.replay.scene import Forces, Scene, marks
from physretarget.validation import Report

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


def report_forces(report: Report, frames: int) -> Forces | None:
    """The contact forces that best explain the motion, one arrow for each body that bears load.

    None where none could be found, or where an uneven clip was judged at other times than it
    shows.
    """
    found = report.forces
    if found is None or len(found.vector) != frames:
        return None
    return Forces(found.origin.astype(np.float64), found.vector.astype(np.float64))
