"""In the air the angular momentum changes.

What it does
------------
Moment about the CoM that the motion requires in frames without contact, out of reach of contacts
before and after, in body weight times CoM height.

Why it matters
--------------
Nothing can turn a body in the air; limbs only trade spin among themselves.

Threshold
---------
Warning from 0.05 BW h, error from 0.15 BW h held for 0.05 s: ours; the moment of a tenth of
body weight at half the CoM height.

Example
-------
A somersault that starts after take-off.
"""

from __future__ import annotations

import numpy as np

from physretarget.validation import states
from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule, exceeding
from physretarget.validation.rule import Judgement, Limit, Limits


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """In the air the angular momentum changes."""
    forces = analysis.forces
    if forces is None:
        return Judgement(not_covered=analysis.no_forces_because)
    if held := states.held_elsewhere(analysis):
        return Judgement(not_covered=held)
    if short := states.too_short(analysis, forces):
        return Judgement(not_covered=short)
    judged = states.free_flight(analysis, forces)
    moment = states.flight_moment(forces)
    return exceeding(
        analysis, rule, np.where(judged, moment, np.nan), warning=limits["warning"],
        error=limits["error"], unit="BW h", minimum_s=0.05,
        message="{value} {unit} turn the body in the air (limit {limit})",
    )  # fmt: skip


RULE = ClipRule(
    code="DYN007",
    name="flight-spin",
    doc=__doc__ or "",
    check=check,
    limits={
        "warning": Limit(value=0.05, unit="BW h", source="ours"),
        "error": Limit(value=0.15, unit="BW h", source="ours"),
    },
)
