"""Frames are missing though the clip's time goes on evenly.

What it does
------------
Looks in the clip as given, before any filter, for single steps in which the whole pose goes on
along its path by twice as much as in the steps around, or more.

Why it matters
--------------
A recorder that drops a frame and does not say so makes the body run at double speed for one step:
two shocks that no body makes. An impact changes the speed and leaves it changed.

Threshold
---------
A step more than 1.6 times as long as all four around it, in their direction within 0.3 of its
length: between 1, no frame missing, and 2, one. A warning where it happens once, an error from
three times on. Ours.

Example
-------
A stream over a wireless network that loses a packet now and then.
"""

from __future__ import annotations

import numpy as np

from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule
from physretarget.validation.report import Cause
from physretarget.validation.rule import Judgement, Limit, Limits


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """Frames are missing though the clip's time goes on evenly."""
    seen = analysis.continuity
    if seen.frames < 6:
        return Judgement(not_covered="needs at least six frames")
    at = np.flatnonzero(seen.skipped > 0)
    if len(at) == 0:
        return Judgement()
    missing = int(seen.skipped[at].sum())
    severe = len(at) >= limits["places"]
    where = "once" if len(at) == 1 else f"in {len(at)} places"
    frame = int(at[0]) + 1
    message = (
        f"{missing} frame{'s are' if missing > 1 else ' is'} missing {where}, though the time goes "
        f"on evenly: the pose goes on by {int(seen.skipped[at[0]]) + 1} steps at once"
    )
    remedy = "Give the clip its true times, or fill in the missing frames"
    cause = Cause(code=rule.code, message=message, remedy=remedy, value=float(missing))
    return Judgement(causes=(cause,) if severe else (), findings=(rule.finding(
        severity="error" if severe else "warning", message=f"{message}. {remedy}",
        frame_first=analysis.clip_frame(frame - 1), frame_last=analysis.clip_frame(int(at[-1]) + 1),
        frame=analysis.clip_frame(frame), time_s=float(analysis.time[frame]),
        value=float(missing), limit=limits["places"] if severe else 0.0, unit="frames",
    ),))  # fmt: skip


RULE = ClipRule(
    code="DAT008",
    name="dropped-frames",
    doc=__doc__ or "",
    check=check,
    limits={
        "places": Limit(value=3.0, unit="1", source="ours: an error from so many places on"),
    },
)
