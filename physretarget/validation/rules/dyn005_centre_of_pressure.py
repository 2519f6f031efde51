"""The centre of pressure lies outside the feet.

What it does
------------
Distance of the point where the required force would have to act from the convex hull of the
touching points, where more than a fifth of body weight is borne.

Why it matters
--------------
The body tips over the edge of its support. How much it matters is DYN002's question; this one
shows where.

Threshold
---------
Warning from 5 cm, the half width of a foot: ours. Never an error by itself.

Example
-------
A lean beyond the toes.
"""

from __future__ import annotations

import numpy as np

from physretarget.validation import states
from physretarget.validation.analysis import Analysis
from physretarget.validation.rule import Limit, Limits, Rule, Verdict, exceeding


def check(analysis: Analysis, limits: Limits, rule: Rule) -> Verdict:
    """The centre of pressure lies outside the feet."""
    if not analysis.judges_forces:
        return Verdict(not_covered=analysis.no_forces_because)
    if held := states.held_elsewhere(analysis):
        return Verdict(not_covered=held)
    outside = np.where(states.known(analysis), analysis["cop_outside"], np.nan)
    return exceeding(
        analysis, rule, outside, warning=limits["warning"], error=np.inf,
        unit="m", minimum_s=0.05,
        message="the centre of pressure is {value} {unit} outside the support (limit {limit})",
    )  # fmt: skip


RULE = Rule(
    code="DYN005",
    name="centre-of-pressure",
    doc=__doc__ or "",
    check=check,
    limits={
        "warning": Limit(value=0.05, unit="m", source="ours: half the width of a foot"),
    },
)
