"""Bodies of the character pass through each other.

What it does
------------
Runs the model's own collision detection on every frame; exclusions, masks and the parent filter
of the model hold. Pairs that overlap in the reference pose already are left out.

Why it matters
--------------
What overlaps cannot be built; a simulator throws such poses apart.

Threshold
---------
Warning from 5 mm (PhysDiff's tolerance for contact), error from 2 cm: ours.

Example
-------
A hand inside the thigh.
"""

from __future__ import annotations

from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule, exceeding
from physretarget.validation.rule import Judgement, Limit, Limits


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """Bodies of the character pass through each other."""
    overlap = analysis.series.overlap
    if overlap is None:
        return Judgement(not_covered="the model has no two bodies that may collide")
    pair = overlap.pair

    def bodies(frame: int) -> str:
        return " and ".join(analysis.body_name(b) for b in pair[frame])

    return exceeding(
        analysis, rule, overlap.depth, warning=limits["warning"],
        error=limits["error"], unit="m", body=bodies,
        message="{body} overlap by {value} {unit} (limit {limit})",
    )  # fmt: skip


RULE = ClipRule(
    code="KIN005",
    name="self-penetration",
    doc=__doc__ or "",
    check=check,
    limits={
        "warning": Limit(value=0.005, unit="m", source="PhysDiff's contact tolerance"),
        "error": Limit(value=0.02, unit="m", source="ours: seen on screen, felt by a simulator"),
    },
)
