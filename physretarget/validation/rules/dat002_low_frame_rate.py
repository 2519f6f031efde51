"""Too few frames per second to judge accelerations.

What it does
------------
Looks at the clip's mean frame rate.

Why it matters
--------------
A foot strike lasts about 50 ms. Below 20 frames per second accelerations say nothing about
forces.

Threshold
---------
20 frames/s: half of the 40 ms that one frame then lasts is the shortest event seen (sampling
theorem); ours.

Example
-------
A clip keyed at 12 frames per second.
"""

from __future__ import annotations

from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule
from physretarget.validation.rule import Judgement, Limit, Limits


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """Too few frames per second to judge accelerations."""
    if analysis.frames < 2:
        return Judgement(not_covered="a single frame has no rate")
    if analysis.fps >= limits["fps"]:
        return Judgement()
    return Judgement(findings=(rule.finding(
        severity="warning", value=analysis.fps, limit=limits["fps"], unit="1/s",
        message=f"{analysis.fps:.3g} frames per second, forces need at least {limits['fps']:g}",
    ),))  # fmt: skip


RULE = ClipRule(
    code="DAT002",
    name="low-frame-rate",
    doc=__doc__ or "",
    check=check,
    limits={
        "fps": Limit(
            value=20.0, unit="1/s", source="ours: sampling theorem for foot strikes of 50 ms"
        ),
    },
)
