"""In the air the centre of mass does not fall freely.

What it does
------------
Acceleration of the CoM minus gravity in frames without contact, out of reach of contacts before
and after. Stretches that need support are CON003's.

Why it matters
--------------
Flight is ballistic. Slow motion in the air, or a fall that is too fast, is the classic fault of
retargeted jumps.

Threshold
---------
Warning from 1.5 m/s^2, error from 3 m/s^2 (a third of gravity), held for 0.05 s: ours. That
people notice such errors of ballistic motion is shown by Reitsma and Pollard 2003.

Example
-------
A hop played at half speed.
"""

from __future__ import annotations

import numpy as np

from physretarget.validation import states
from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule, exceeding
from physretarget.validation.rule import Judgement, Limit, Limits


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """In the air the centre of mass does not fall freely."""
    forces = analysis.forces
    if forces is None:
        return Judgement(not_covered=analysis.no_forces_because)
    if held := states.held_elsewhere(analysis):
        return Judgement(not_covered=held)
    judged = states.free_flight(analysis, forces)
    if short := states.too_short(analysis, forces):
        return Judgement(not_covered=short)
    error = states.flight_error(analysis, forces)
    return exceeding(
        analysis, rule, np.where(judged, error, np.nan), warning=limits["warning"],
        error=limits["error"], unit="m/s^2", minimum_s=limits["hold"],
        message="in the air the CoM's acceleration is {value} {unit} off gravity (limit {limit})",
    )  # fmt: skip


RULE = ClipRule(
    code="DYN006",
    name="flight-not-ballistic",
    doc=__doc__ or "",
    check=check,
    limits={
        "warning": Limit(
            value=1.5,
            unit="m/s^2",
            source="ours: a sixth of gravity",
        ),
        "error": Limit(value=3.0, unit="m/s^2", source="ours: a third of gravity"),
        "hold": Limit(value=0.05, unit="s", source="ours"),
    },
)
