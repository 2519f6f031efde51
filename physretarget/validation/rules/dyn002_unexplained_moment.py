"""No contact force explains the turning of the body.

What it does
------------
The moment about the CoM that remains when friction cones at the touching points, or those touching
within reach, explain the force, and the moment as far as they can; in body weight times CoM height.
What the filter's side lobes make of shocks is taken off. Frames in the air are left to CON003,
DYN006 and DYN007.

Why it matters
--------------
The body would tip over: leaning that no ankle can hold, arms that swing against nothing.

Threshold
---------
Warning from 0.1 BW h; error from 0.25 BW h: ours. Hicks et al. 2015 ask for 1 % of CoM height
times peak external force of measured gait with force plates, which motion alone seldom meets.

Example
-------
A body leaning by 30 degrees on flat feet without falling.
"""

from __future__ import annotations

import numpy as np

from physretarget.validation import states
from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule, exceeding
from physretarget.validation.rule import Judgement, Limit, Limits


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """No contact force explains the turning of the body."""
    forces = analysis.forces
    if forces is None:
        return Judgement(not_covered=analysis.no_forces_because)
    if held := states.held_elsewhere(analysis):
        return Judgement(not_covered=held)
    unjudged = states.flight(forces) | ~states.known(analysis)
    series = np.where(unjudged, np.nan, forces.residual.moment)
    return exceeding(
        analysis, rule, series, warning=limits["warning"], error=limits["error"], unit="BW h",
        message="{value} {unit} of moment are explained by no contact (limit {limit})",
    )  # fmt: skip


RULE = ClipRule(
    code="DYN002",
    name="unexplained-moment",
    doc=__doc__ or "",
    check=check,
    limits={
        "warning": Limit(
            value=0.1,
            unit="BW h",
            source="ours: ten times Hicks et al. 2015, which is for plates and markers",
        ),
        "error": Limit(
            value=0.25,
            unit="BW h",
            source="ours: the weight a quarter of the CoM height off its support",
        ),
    },
)
