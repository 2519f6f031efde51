"""The joints' angles are in degrees instead of radians.

What it does
------------
Compares the angles of all hinges, unfiltered, with the joints' ranges (two turns where there is
none), as they are and read as degrees.

Why it matters
--------------
A clip in degrees turns every joint 57 times as far: every other finding then follows from the
unit.

Threshold
---------
Error where a quarter of all angles lie more than half a radian beyond their range and hardly any
(one in fifty) would if they were degrees: ours. A clip that is merely wrong leaves its ranges
here and there; motion of a few degrees cannot be told apart and is not suspected.

Example
-------
A csv exported from an animation tool that counts in degrees.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule
from physretarget.validation.report import Cause
from physretarget.validation.rule import Judgement, Limit, Limits

_BLOCK = 4096
_ENDLESS = 4 * np.pi
_AS_DEGREES = 0.02


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """The joints' angles are in degrees instead of radians."""
    hinges = [joint.qpos for joint in analysis.character.tree.joints if joint.kind == "hinge"]
    if not hinges:
        return Judgement(not_covered="the model has no hinge")
    given, turned = _beyond(analysis, np.array(hinges), limits["beyond"])
    if given < limits["share"] or turned > _AS_DEGREES:
        return Judgement()
    cause = Cause(
        code=rule.code, message="the joints' angles are in degrees",
        remedy="Multiply them by pi/180: a clip is in radians", value=given,
    )  # fmt: skip
    return Judgement(causes=(cause,), findings=(rule.finding(
        severity="error",
        message=f"{given:.0%} of all hinge angles are far beyond their range, read as degrees "
        f"{turned:.0%}: if they are in degrees, multiply them by pi/180, a clip is in radians",
        value=given, limit=limits["share"], unit="1",
    ),))  # fmt: skip


def _beyond(analysis: Analysis, hinges: NDArray[np.int64], far: float) -> tuple[float, float]:
    """Shares of all angles that are far out of range, as they are and if they were degrees."""
    lower, upper = analysis.character.lower[hinges], analysis.character.upper[hinges]
    lower = np.where(np.isfinite(lower), lower, -_ENDLESS) - far
    upper = np.where(np.isfinite(upper), upper, _ENDLESS) + far
    given = turned = 0
    for first in range(0, analysis.frames, _BLOCK):
        angle = analysis.poses(first, min(first + _BLOCK, analysis.frames))[:, hinges]
        given += int(((angle < lower) | (angle > upper)).sum())
        angle = np.radians(angle)
        turned += int(((angle < lower) | (angle > upper)).sum())
    every = analysis.frames * len(hinges)
    return given / every, turned / every


RULE = ClipRule(
    code="DAT007",
    name="other-angle",
    doc=__doc__ or "",
    check=check,
    limits={
        "beyond": Limit(value=0.5, unit="rad", source="ours: no calibration is that far off"),
        "share": Limit(value=0.25, unit="1", source="ours: more than one joint gone astray"),
    },
)
