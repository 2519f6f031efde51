"""physretarget: human motion capture to non-humanoid characters, judged by physics.

::

    capture file ── load_capture ──▶ ActorMotion ─┐
    key poses ──── load_keyposes ── learn ──▶ TrainedMapper
                                                  │ retarget
                                                  ▼
      mapped → placed → contacted → physical → balanced (→ simulated) ──▶ Clip
                                                             │
    MJCF ── Character.load ──▶ Character ── validate(clip, character) ──▶ Report

Public are the names of this module and of the rooms on the API page (docs/site/hooks.py lists
them). A verb with a room of its own name is called there: ``physretarget.simulate.simulate``.
CONTRIBUTING.md has the map of all rooms.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from physretarget._lazy import attribute_getter
from physretarget._version import __version__

if TYPE_CHECKING:
    from physretarget.capture import load as load_capture
    from physretarget.capture.actor import ActorMotion
    from physretarget.clip import Clip, load_clip
    from physretarget.contact import Phases, detect_phases, read_phases, write_phases
    from physretarget.conversion import convert
    from physretarget.keyposes import KeyPose, KeyPoseSet, load_keyposes
    from physretarget.kinetics import GroundForces, forces
    from physretarget.mend import Fixed, fix
    from physretarget.mjcf import Character
    from physretarget.pipeline import Retargeted, RetargetSettings, retarget
    from physretarget.replay import write_replay
    from physretarget.report import render as render_report
    from physretarget.report import write_retarget_report
    from physretarget.stream import Posed, Streamer
    from physretarget.trained import TrainedMapper, learn
    from physretarget.validation import Finding, Measure, Report, Settings
    from physretarget.validation.validate import validate

# Public name → (module, name there).
_WHERE = {
    "ActorMotion": ("capture.actor", "ActorMotion"),
    "Character": ("mjcf", "Character"),
    "Clip": ("clip", "Clip"),
    "Finding": ("validation", "Finding"),
    "Fixed": ("mend", "Fixed"),
    "GroundForces": ("kinetics", "GroundForces"),
    "KeyPose": ("keyposes", "KeyPose"),
    "KeyPoseSet": ("keyposes", "KeyPoseSet"),
    "Measure": ("validation", "Measure"),
    "Phases": ("contact", "Phases"),
    "Posed": ("stream", "Posed"),
    "Report": ("validation", "Report"),
    "RetargetSettings": ("pipeline", "RetargetSettings"),
    "Retargeted": ("pipeline", "Retargeted"),
    "Settings": ("validation", "Settings"),
    "Streamer": ("stream", "Streamer"),
    "TrainedMapper": ("trained", "TrainedMapper"),
    "convert": ("conversion", "convert"),
    "detect_phases": ("contact", "detect_phases"),
    "fix": ("mend", "fix"),
    "forces": ("kinetics", "forces"),
    "learn": ("trained", "learn"),
    "load_capture": ("capture", "load"),
    "load_clip": ("clip", "load_clip"),
    "load_keyposes": ("keyposes", "load_keyposes"),
    "read_phases": ("contact", "read_phases"),
    "render_report": ("report", "render"),
    "retarget": ("pipeline", "retarget"),
    "validate": ("validation", "validate"),
    "write_phases": ("contact", "write_phases"),
    "write_replay": ("replay", "write_replay"),
    "write_retarget_report": ("report", "write_retarget_report"),
}

__all__ = [
    "ActorMotion",
    "Character",
    "Clip",
    "Finding",
    "Fixed",
    "GroundForces",
    "KeyPose",
    "KeyPoseSet",
    "Measure",
    "Phases",
    "Posed",
    "Report",
    "RetargetSettings",
    "Retargeted",
    "Settings",
    "Streamer",
    "TrainedMapper",
    "__version__",
    "convert",
    "detect_phases",
    "fix",
    "forces",
    "learn",
    "load_capture",
    "load_clip",
    "load_keyposes",
    "read_phases",
    "render_report",
    "retarget",
    "validate",
    "write_phases",
    "write_replay",
    "write_retarget_report",
]


__getattr__ = attribute_getter(__name__, _WHERE)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
