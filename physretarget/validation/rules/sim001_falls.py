"""The body falls where MuJoCo plays the clip.

What it does
------------
With ``--simulate`` the clip is played forward by joint torques alone (docs/validate.md). The
finding is at the moment when the markers are a quarter of the height off their places, root mean
square, and no second attempt came further.

Why it matters
--------------
Whatever inverse dynamics says, a body that a planner with full knowledge cannot keep on its feet
will not be kept there by a policy, and a robot would fall.

Threshold
---------
Error when the end is not reached. A quarter of the height is ours: planners do not come back from
there.

Example
-------
A statue that leans, a lamp that stops dead after a hop.
"""

from __future__ import annotations

import numpy as np

from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule
from physretarget.validation.rule import Judgement, Limits


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """The body falls where MuJoCo plays the clip."""
    played = analysis.played
    if played is None or played.exact is None:
        return Judgement(not_covered=played.reason if played else "only with --simulate")
    if played.fall_s is None:
        return Judgement()
    frame = min(int(np.searchsorted(analysis.clip.time, played.fall_s)), analysis.clip.frames - 1)
    return Judgement(
        findings=(
            rule.finding(
                severity="error",
                message=f"the simulated body is lost at {played.fall_s:.2f} s, after "
                f"{played.exact.survived_s:.2f} s of {played.exact.duration_s:.2f} s: no torques "
                "within the limits were found that keep it in the clip",
                frame_first=frame, frame_last=analysis.clip.frames - 1, frame=frame,
                time_s=played.fall_s, value=played.exact.survived_s,
                limit=played.exact.duration_s, unit="s",
            ),
        )
    )  # fmt: skip


RULE = ClipRule(code="SIM001", name="falls", doc=__doc__ or "", check=check)
