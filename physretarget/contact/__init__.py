"""Contacts: when the actor's feet stand still, and a character that stands still with them.

::

    ActorMotion ── detect_phases ──▶ Phases ◀── read_phases (by hand)
    placed clip + Phases ── adjust ──▶ Contacted: planted points stay where they are

``phases`` holds the timetable and its file, ``detect`` finds it in a motion. ``sole`` is one
rigid body's contact points, ``stances`` where and when it stands, ``track`` its rigid path
through stances and flights; ``adjust`` moves the character there. Yamane 2010, section 5.2;
``docs/method.md`` says what was added and why.
"""

from __future__ import annotations

from physretarget.contact.adjust import Contacted, Stance, adjust
from physretarget.contact.detect import DetectionSettings, detect_phases
from physretarget.contact.phases import Phases, read_phases, write_phases
from physretarget.contact.settings import ContactSettings

__all__ = [
    "ContactSettings",
    "Contacted",
    "DetectionSettings",
    "Phases",
    "Stance",
    "adjust",
    "detect_phases",
    "read_phases",
    "write_phases",
]
