"""The root travels further, or less far, than its legs carry it.

What it does
------------
A point that stands stays where it is: while it does, the root moves by what the legs push it. The
factor between the two, fitted to all steps at once, is 1 for a clip whose root and legs belong to
one body.

Why it matters
--------------
A root path taken over from a taller or a smaller body slides at every step, forwards or backwards,
and often floats or sinks too.

Threshold
---------
Warning from 8 % on, where at least 20 instants of a standing point under a moving root agree on the
factor within 15 % of the root's speed, and better than on 1. Ours: retargeted clips lie within 0.5
%, a generated walk at 4 %.

Example
-------
Joint angles of a person on a robot two thirds as tall, with the person's root positions.
"""

from __future__ import annotations

from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule
from physretarget.validation.report import Cause
from physretarget.validation.rule import Judgement, Limit, Limits
from physretarget.validation.stance import root_scale


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """The root travels further, or less far, than its legs carry it."""
    if not analysis.character.has_root:
        return Judgement(not_covered=analysis.no_forces_because)
    if not analysis.has_geometry:
        return Judgement(not_covered="the model has no geometry that could stand on the floor")
    scale = root_scale(analysis.evidence)
    if scale is None or max(scale, 1 / scale) < 1 + limits["scale"]:
        return Judgement()
    off = f"{abs(scale - 1):.0%} too {'far' if scale > 1 else 'short'}"
    message = f"the root travels {off} for its steps, by a factor of {scale:.3g}"
    remedy = f"Divide the root's positions by {scale:.3g}"
    return Judgement(
        findings=(rule.finding(
            severity="warning", message=f"{message}. {remedy}", value=scale,
            limit=1 + limits["scale"], unit="1",
        ),),
        causes=(Cause(code=rule.code, message=message, remedy=remedy, value=scale),),
    )  # fmt: skip


RULE = ClipRule(
    code="DAT014",
    name="root-scale",
    doc=__doc__ or "",
    check=check,
    explains="findings",
    limits={"scale": Limit(value=0.08, unit="1", source="ours: twice that of a generated walk")},
)
