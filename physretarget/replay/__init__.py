"""Replay: window, video, web. One clock, three screens, one :class:`Scene` for all."""

from __future__ import annotations

from physretarget.replay.clip import clip_scene, write_replay
from physretarget.replay.clock import Clock
from physretarget.replay.figures import figure
from physretarget.replay.scene import Contacts, Figure, Forces, Mark, Scene, marks, with_marks
from physretarget.replay.video import write_video
from physretarget.replay.web import write_html

__all__ = [
    "Clock",
    "Contacts",
    "Figure",
    "Forces",
    "Mark",
    "Scene",
    "clip_scene",
    "figure",
    "marks",
    "with_marks",
    "write_html",
    "write_replay",
    "write_video",
]
