"""More friction is needed than the floor has.

What it does
------------
Ratio of the required horizontal to the required vertical force where more than 10 % of body
weight is supported.

Why it matters
--------------
Feet slip where the ratio passes the friction coefficient.

Threshold
---------
Warning above the model's friction coefficient, error above 1.5 times it (rubber on dry floors
reaches 1.0-1.5). Ours.

Example
-------
A sprint start on ice.
"""

from __future__ import annotations

import numpy as np

from physretarget.validation import states
from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule, exceeding
from physretarget.validation.rule import Judgement, Limit, Limits


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """More friction is needed than the floor has."""
    pushes = analysis.series.pushes
    if pushes is None:
        return Judgement(not_covered=analysis.no_forces_because)
    if held := states.held_elsewhere(analysis):
        return Judgement(not_covered=held)
    demand = np.where(states.known(analysis), pushes.friction_demand, np.nan)
    return exceeding(
        analysis, rule, demand / analysis.friction,
        warning=limits["warning"], error=limits["error"], unit="of mu", minimum_s=0.05,
        message="{value} times the friction coefficient is needed (limit {limit})",
    )  # fmt: skip


RULE = ClipRule(
    code="DYN004",
    name="friction",
    doc=__doc__ or "",
    check=check,
    limits={
        "warning": Limit(value=1.0, unit="of mu", source="the model's own coefficient"),
        "error": Limit(value=1.5, unit="of mu", source="ours"),
    },
)
