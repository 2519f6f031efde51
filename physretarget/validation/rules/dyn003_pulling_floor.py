"""The floor would have to pull.

What it does
------------
Frames whose required vertical force is negative beyond a deadband and beyond the ringing that a
pushing force leaves after the filter.

Why it matters
--------------
Floors push. A body that comes down faster than it falls was pulled.

Threshold
---------
Error below -0.1 BW, warning below -0.05 BW: the noise of accelerations after a 6 Hz filter.
Ours.

Example
-------
A jump played at 1.5 times its speed.
"""

from __future__ import annotations

import numpy as np

from physretarget.validation import states
from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule, exceeding
from physretarget.validation.rule import Judgement, Limit, Limits


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """The floor would have to pull."""
    required, pushes = analysis.series.required, analysis.series.pushes
    if required is None or pushes is None:
        return Judgement(not_covered=analysis.no_forces_because)
    if held := states.held_elsewhere(analysis):
        return Judgement(not_covered=held)
    pull = pushes.ringing - required.force[:, 2]
    return exceeding(
        analysis, rule, np.where(states.known(analysis), pull, np.nan), warning=limits["warning"],
        error=limits["error"], unit="BW", sign=-1.0,
        message="the required vertical force is {value} {unit}: the floor would pull",
    )  # fmt: skip


RULE = ClipRule(
    code="DYN003",
    name="pulling-floor",
    doc=__doc__ or "",
    check=check,
    limits={
        "warning": Limit(value=0.05, unit="BW", source="ours: noise of filtered accelerations"),
        "error": Limit(value=0.1, unit="BW", source="ours: 1 m/s^2 beyond free fall"),
    },
)
