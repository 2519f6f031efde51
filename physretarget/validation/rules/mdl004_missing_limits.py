"""Joints have no range.

What it does
------------
Lists hinges and slides without limits.

Why it matters
--------------
What has no limit cannot be judged by KIN001: any pose passes.

Threshold
---------
None; a wheel has no range by right, hence a warning.

Example
-------
A knee that may turn all round.
"""

from __future__ import annotations

from physretarget.validation.analysis import Analysis
from physretarget.validation.model import audited
from physretarget.validation.rule import Limits, Rule, Verdict


def check(analysis: Analysis, limits: Limits, rule: Rule) -> Verdict:
    """Joints have no range."""
    return audited(analysis, rule, errors=(), warnings=("limit_missing",))


RULE = Rule(
    code="MDL004",
    name="missing-limits",
    doc=__doc__ or "",
    check=check,
)
