"""A character: load it, audit it, build the actor's; momentum and batched inverse dynamics.

The only package below the stages that knows MuJoCo.
"""

from __future__ import annotations

from physretarget.mjcf.actor import actor_character, actor_xml
from physretarget.mjcf.character import Character, Points
from physretarget.mjcf.dynamics import (
    Momentum,
    RootWrench,
    check_lowpass,
    derivatives,
    lowpass,
    momentum,
    required_wrench,
    smoothed,
)
from physretarget.mjcf.quiet import log_warnings

log_warnings()

__all__ = [
    "Character",
    "Momentum",
    "Points",
    "RootWrench",
    "actor_character",
    "actor_xml",
    "check_lowpass",
    "derivatives",
    "lowpass",
    "momentum",
    "required_wrench",
    "smoothed",
]
