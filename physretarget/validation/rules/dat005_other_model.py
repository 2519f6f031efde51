"""The clip was made with another model than it is judged with.

What it does
------------
Compares the model hash that the clip carries with the model given.

Why it matters
--------------
A body of other masses or lengths needs other forces: figures may not mean what they seem to.

Threshold
---------
Any difference of the hash; a warning, since comments and colours change it too.

Example
-------
A clip of last week's model judged with today's.
"""

from __future__ import annotations

from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule
from physretarget.validation.rule import Judgement, Limits


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """The clip was made with another model than it is judged with."""
    told = analysis.clip.model_sha256
    if not told:
        return Judgement(not_covered="the clip does not say which model it was made with")
    if told == analysis.character.sha256:
        return Judgement()
    return Judgement(findings=(rule.finding(
        severity="warning",
        message=f"made with model {told[:12]}, judged with {analysis.character.sha256[:12]}",
    ),))  # fmt: skip


RULE = ClipRule(
    code="DAT005",
    name="other-model",
    doc=__doc__ or "",
    check=check,
)
