"""Key poses in the browser: a session over one key pose file, and the page that drives it.

Thin over keyposes, kinematics, trained and pipeline: what a gesture does is theirs, here it is
kept, saved and shown.
"""

from __future__ import annotations

from physretarget.studio.session import Conflict, Session
from physretarget.studio.take import Take

__all__ = ["Conflict", "Session", "Take"]
