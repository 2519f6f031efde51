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

from physretarget.validation.model_rule import ModelRule

RULE = ModelRule(
    code="MDL004",
    name="missing-limits",
    doc=__doc__ or "",
    warnings=("limit_missing",),
)
