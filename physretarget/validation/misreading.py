"""The finding and the cause where another reading of the clip makes sense and this one does not."""

from __future__ import annotations

from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule
from physretarget.validation.report import Cause
from physretarget.validation.rule import Judgement


def misread(analysis: Analysis, rule: ClipRule, kind: str) -> Judgement:
    """What a rule about one kind of misreading says."""
    if not analysis.has_geometry:
        return Judgement(not_covered="the model has no geometry that could stand on the floor")
    better = analysis.better_reading
    if better is None or better.reading.kind != kind:
        return Judgement()
    reading, before, after = better.reading, better.before.badness, better.after.badness
    message = (
        f"{reading.meant}: read so, the clip stands on its floor (slip and stray {after:.2g} "
        f"instead of {before:.2g})"
    )
    return Judgement(
        findings=(
            rule.finding(
                severity="error", message=f"{message}. {reading.remedy}", value=before, limit=after
            ),
        ),
        causes=(Cause(code=rule.code, message=reading.meant, remedy=reading.remedy, value=before),),
    )
