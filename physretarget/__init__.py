"""physretarget: human motion capture to non-humanoid characters, judged by physics.

::

    capture file ── load_capture ──▶ ActorMotion ─┐
    key poses ──── load_keyposes ── learn ──▶ TrainedMapper
                                                  │ retarget
                                                  ▼
      mapped → placed → contacted → physical → balanced (→ simulated) ──▶ Clip
                                                             │
    MJCF ── Character.load ──▶ Character ── validate(clip, character) ──▶ Report

The rooms, from the top down: ``cli``, ``demo``, ``report``, ``replay``, ``validation``,
``pipeline``, ``kinetics``, the stages (``balance`` over ``momentum``, ``contact``, ``ocp``,
``ik``), ``keyposes``, ``features``, ``mapping``, ``mjcf``, ``capture`` and ``clip``,
``kinematics``; ``face`` stands beside them. Each imports only from below. What has a room of its
own is called there: ``physretarget.simulate.simulate``, ``physretarget.studio.Session``.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from physretarget._version import __version__

if TYPE_CHECKING:
    from physretarget.capture import load as load_capture
    from physretarget.capture.actor import ActorMotion
    from physretarget.clip import Clip, load_clip
    from physretarget.conversion import convert
    from physretarget.keyposes import KeyPose, KeyPoseSet, load_keyposes
    from physretarget.kinetics import GroundForces, forces
    from physretarget.mend import Fixed, fix
    from physretarget.mjcf import Character
    from physretarget.pipeline import Retargeted, RetargetSettings, retarget
    from physretarget.trained import TrainedMapper, learn
    from physretarget.validation import Finding, Measure, Report, Settings
    from physretarget.validation.validate import validate

# Public name → (module, name there): imported when first asked for, since solvers and MuJoCo
# take a second that `physretarget --help` need not spend.
_WHERE = {
    "ActorMotion": ("capture.actor", "ActorMotion"),
    "Character": ("mjcf", "Character"),
    "Clip": ("clip", "Clip"),
    "Fixed": ("mend", "Fixed"),
    "Finding": ("validation", "Finding"),
    "GroundForces": ("kinetics", "GroundForces"),
    "KeyPose": ("keyposes", "KeyPose"),
    "KeyPoseSet": ("keyposes", "KeyPoseSet"),
    "Measure": ("validation", "Measure"),
    "Report": ("validation", "Report"),
    "RetargetSettings": ("pipeline", "RetargetSettings"),
    "Retargeted": ("pipeline", "Retargeted"),
    "Settings": ("validation", "Settings"),
    "TrainedMapper": ("trained", "TrainedMapper"),
    "convert": ("conversion", "convert"),
    "fix": ("mend", "fix"),
    "forces": ("kinetics", "forces"),
    "learn": ("trained", "learn"),
    "load_capture": ("capture", "load"),
    "load_clip": ("clip", "load_clip"),
    "load_keyposes": ("keyposes", "load_keyposes"),
    "retarget": ("pipeline", "retarget"),
    "validate": ("validation", "validate"),
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
    "Report",
    "RetargetSettings",
    "Retargeted",
    "Settings",
    "TrainedMapper",
    "__version__",
    "convert",
    "fix",
    "forces",
    "learn",
    "load_capture",
    "load_clip",
    "load_keyposes",
    "retarget",
    "validate",
]


def __getattr__(name: str) -> Any:
    if name not in _WHERE:
        raise AttributeError(f"module 'physretarget' has no attribute {name!r}")
    module, attribute = _WHERE[name]
    return getattr(import_module(f"physretarget.{module}"), attribute)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
