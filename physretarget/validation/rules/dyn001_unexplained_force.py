"""No contact force explains the motion.

What it does
------------
The force that the motion requires minus the best force that friction cones at the touching
points can give, points included that touch a frame (or the filter's reach) earlier or later.
What the filter itself makes of such forces (its ringing) is explained. Frames in the air are left
to CON003, DYN006 and DYN007.

Why it matters
--------------
It is the hand of a ghost: the part of the motion that no floor, and so no robot and no body,
can produce.

Threshold
---------
Warning from 0.1 BW, about 5 % of the peak external force of running and twice that of walking
(Hicks et al. 2015); error from 0.25 BW held for 0.05 s: ours, a retargeted walk that physics-
based tracking reproduces stays below 0.2 BW at 6 Hz.

Example
-------
A jump whose body hovers at its top.
"""

from __future__ import annotations

import numpy as np

from physretarget.validation import states
from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule, exceeding
from physretarget.validation.rule import Judgement, Limit, Limits


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """No contact force explains the motion."""
    forces = analysis.forces
    if forces is None:
        return Judgement(not_covered=analysis.no_forces_because)
    if held := states.held_elsewhere(analysis):
        return Judgement(not_covered=held)
    unjudged = states.flight(forces) | ~states.known(analysis)
    series = np.where(unjudged, np.nan, forces.residual.force)
    return exceeding(
        analysis, rule, series, warning=limits["warning"], error=limits["error"], unit="BW",
        message="{value} {unit} of force are explained by no contact (limit {limit})",
    )  # fmt: skip


RULE = ClipRule(
    code="DYN001",
    name="unexplained-force",
    doc=__doc__ or "",
    check=check,
    limits={
        "warning": Limit(
            value=0.1,
            unit="BW",
            source="Hicks et al. 2015: residual force <= 5 % of the peak external force",
        ),
        "error": Limit(value=0.25, unit="BW", source="ours: five times that for a peak of 1 BW"),
    },
)
