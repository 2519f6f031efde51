"""Replay: window, video, web. One clock, three screens, one :class:`Scene` for all."""

from __future__ import annotations

from physretarget.replay.clock import Clock
from physretarget.replay.figures import figure
from physretarget.replay.scene import Contacts, Figure, Forces, Mark, Scene, marks, with_marks
from physretarget.replay.web import write_html

__all__ = [
    "Clock",
    "Contacts",
    "Figure",
    "Forces",
    "Mark",
    "Scene",
    "figure",
    "marks",
    "with_marks",
    "write_html",
]
