"""The clip is too short for accelerations.

What it does
------------
Counts frames.

Why it matters
--------------
An acceleration needs three neighbours; a clip of fewer than four frames has no dynamics to
judge.

Threshold
---------
4 frames: the one-sided second difference of second order. 0.2 s for a warning: less than a
step. Ours.

Example
-------
A single pose saved as a clip.
"""

from __future__ import annotations

from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule
from physretarget.validation.rule import Judgement, Limit, Limits


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """The clip is too short for accelerations."""
    if analysis.frames < limits["frames"]:
        return Judgement(findings=(rule.finding(
            severity="warning", value=float(analysis.frames), limit=limits["frames"],
            unit="frames", message=f"{analysis.frames} frames: no accelerations can be taken",
        ),))  # fmt: skip
    if analysis.clip.duration < limits["seconds"]:
        return Judgement(findings=(rule.finding(
            severity="warning", value=analysis.clip.duration, limit=limits["seconds"], unit="s",
            message=f"the clip lasts {analysis.clip.duration:.3g} s",
        ),))  # fmt: skip
    return Judgement()


RULE = ClipRule(
    code="DAT004",
    name="too-short",
    doc=__doc__ or "",
    check=check,
    limits={
        "frames": Limit(
            value=4.0, unit="frames", source="second difference of second order at a clip's end"
        ),
        "seconds": Limit(value=0.2, unit="s", source="ours: shorter than any gesture"),
    },
)
