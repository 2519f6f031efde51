"""Gravity or size suggest another unit or axis.

What it does
------------
Looks at gravity and at the model's extent.

Why it matters
--------------
All limits of this report are in metres, kilograms and seconds on a floor that z points away
from.

Threshold
---------
Gravity 9.81 m/s^2 downward; extent between 2 cm and 20 m: ours.

Example
-------
A model in centimetres.
"""

from __future__ import annotations

from physretarget.validation.analysis import Analysis
from physretarget.validation.model import audited
from physretarget.validation.rule import Limits, Rule, Verdict


def check(analysis: Analysis, limits: Limits, rule: Rule) -> Verdict:
    """Gravity or size suggest another unit or axis."""
    return audited(analysis, rule, errors=(), warnings=("gravity", "size"))


RULE = Rule(
    code="MDL007",
    name="suspicious-world",
    doc=__doc__ or "",
    check=check,
)
