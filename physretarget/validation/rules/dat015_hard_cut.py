"""Two clips are joined without a transition.

What it does
------------
Looks in the clip as given, before any filter, for a step in which the whole pose jumps: many joints
at once. Whatever one impact and steady accelerations do is taken off (see KIN004).

Why it matters
--------------
A cut is a shock that needs forces no floor has. The clip before it and the one after it may both be
fine.

Threshold
---------
Error where the whole pose (the root mean square over all degrees of freedom, one CoM height for a
radian) jumps by more than 0.05 rad and by more than 1.3 times what it moves in the steps around,
and a quarter of the joints with it. Simulations with impacts and generated clips stay below. Ours.

Example
-------
Takes of a data set that were written one after the other into one file.
"""

from __future__ import annotations

import numpy as np

from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule
from physretarget.validation.report import Cause
from physretarget.validation.rule import Judgement, Limit, Limits

# Cuts that are named.
_MOST = 10


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """Two clips are joined without a transition."""
    seen = analysis.continuity
    if seen.frames < 4:
        return Judgement(not_covered="needs at least four frames")
    whole = (
        (seen.jump_pose > limits["pose"])
        & (seen.jumping >= limits["joints"])
        & (seen.jump_pose > limits["pace"] * seen.pace)
    )
    cuts = np.flatnonzero(whole & ~seen.paced)[:_MOST] + 1
    if len(cuts) == 0:
        return Judgement()
    frames = ", ".join(str(analysis.clip_frame(int(c))) for c in cuts)
    message = f"the whole pose jumps into frame {frames}: a hard cut"
    remedy = "Split the clip there, or blend over half a second"
    return Judgement(
        findings=tuple(rule.finding(
            severity="error", message="the whole pose jumps into this frame: a hard cut. " + remedy,
            frame_first=analysis.clip_frame(int(cut) - 1), frame_last=analysis.clip_frame(int(cut)),
            frame=analysis.clip_frame(int(cut)), time_s=float(analysis.time[cut]),
            value=float(seen.jump_pose[cut - 1]), limit=limits["pose"], unit="rad",
        ) for cut in cuts),
        causes=(Cause(code=rule.code, message=message, remedy=remedy, value=float(cuts[0])),),
    )  # fmt: skip


RULE = ClipRule(
    code="DAT015",
    name="hard-cut",
    doc=__doc__ or "",
    check=check,
    limits={
        "pose": Limit(value=0.05, unit="rad", source="ours: generated clips stay below 0.04"),
        "joints": Limit(value=0.25, unit="1", source="ours: share of joints; impacts: 0.15"),
        "pace": Limit(value=1.3, unit="1", source="ours: a snap of fast motion is none"),
    },
)
