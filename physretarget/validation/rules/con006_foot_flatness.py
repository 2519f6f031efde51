"""The soles stand tilted on the floor.

What it does
------------
Takes the bodies that stand flat on the floor in the reference pose, and of each how its sole is
turned against the floor while it stands: the median over all stances, about its own axes. Feet of
a body that lies or sits, its root below half of its usual height, do not stand.

Why it matters
--------------
A foot that always stands on its toe or heel has the ankle's zero elsewhere than the model: its
support is an edge, and the centre of pressure lies outside it.

Threshold
---------
Warning from 6 degrees, error from 12, where at least half of all instants that a sole stands agree
within 2/5 of the tilt, up to 20 degrees: further over it does not stand on its sole. Ours:
generated walks and gestures stay below 4.5.

Example
-------
Ankles retargeted from a person in shoes: all stances with toes up by 8 degrees.
"""

from __future__ import annotations

import numpy as np

from physretarget.options.judging import Severity
from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule
from physretarget.validation.report import Cause, Finding
from physretarget.validation.rule import Judgement, Limit, Limits
from physretarget.validation.stance import sole_tilts

_AXES = ("roll", "pitch")


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """The soles stand tilted on the floor."""
    if not analysis.has_geometry:
        return Judgement(not_covered="the model has no geometry that could stand on the floor")
    tilts = sole_tilts(analysis.character, analysis.evidence, analysis.probe)
    if tilts is None:
        return Judgement(not_covered="no body of the model stands on a flat sole")
    found: list[Finding] = []
    causes: list[Cause] = []
    for tilt in tilts:
        size = float(np.linalg.norm(tilt.turn))
        if not limits["warning"] < size < limits["most"] or tilt.spread > limits["spread"] * size:
            continue
        severity: Severity = "error" if size > limits["error"] else "warning"
        name, about = analysis.body_name(tilt.body), int(np.abs(tilt.turn[:2]).argmax())
        message = (
            f"{name} stands tilted by {np.rad2deg(size):.2g} degrees in its stances, mostly in "
            f"{_AXES[about]}"
        )
        remedy = (
            f"Turn the ankle by {-np.rad2deg(tilt.turn[about]):.2g} degrees about the sole's "
            f"{'xy'[about]} axis, in all frames"
        )
        found.append(rule.finding(
            severity=severity, message=f"{message}. {remedy}", body=name, value=size,
            limit=limits[severity], unit="rad",
        ))  # fmt: skip
        causes.append(Cause(code=rule.code, message=message, remedy=remedy,
                            value=float(np.rad2deg(size))))  # fmt: skip
    causes.sort(key=lambda cause: -(cause.value or 0.0))
    return Judgement(findings=tuple(found), causes=tuple(causes[:1]))


RULE = ClipRule(
    code="CON006",
    name="foot-flatness",
    doc=__doc__ or "",
    check=check,
    limits={
        "warning": Limit(value=0.105, unit="rad", source="ours: 6 degrees"),
        "error": Limit(value=0.21, unit="rad", source="ours: 12 degrees"),
        "most": Limit(value=0.35, unit="rad", source="ours: 20 degrees, no sole stands so"),
        "spread": Limit(value=0.4, unit="1", source="ours: constant, not walked off"),
    },
)
