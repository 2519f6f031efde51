"""A joint turns faster than bodies and motors do.

What it does
------------
Compares the speed of every hinge and slide, after the filter, with a limit.

Why it matters
--------------
No motor follows, and no muscle: such speeds are leaps of the data or of the inverse kinematics.

Threshold
---------
animation: warning 50 rad/s, error 130 rad/s, the fastest measured human joint (shoulder of a
pitcher, 7 000-7 500 deg/s, Fleisig et al. 1999). robot: warning 20 rad/s, error 37 rad/s, the
lowest and highest rated joint speed of the Unitree G1 (20-37 rad/s).

Example
-------
An elbow that flips by 180 degrees within one frame at 30 Hz: 94 rad/s.
"""

from __future__ import annotations

from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule, dof_names, exceeding
from physretarget.validation.rule import Judgement, Limit, Limits


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """A joint turns faster than bodies and motors do."""
    fastest = analysis.series.joint_speed
    if fastest is None:
        return Judgement(not_covered="the model has no hinge or slide joint")
    names = dof_names(analysis)
    worst = fastest.dof
    return exceeding(
        analysis, rule, fastest.speed, warning=limits["warning"],
        error=limits["error"], unit="rad/s", body=lambda t: names[worst[t]],
        message="{body} moves at {value} {unit} (limit {limit})",
    )  # fmt: skip


RULE = ClipRule(
    code="KIN002",
    name="joint-speed",
    doc=__doc__ or "",
    check=check,
    limits={
        "warning": Limit(
            value=50.0, unit="rad/s", source="ours: beyond everyday human motion", robot=20.0
        ),
        "error": Limit(
            value=130.0,
            unit="rad/s",
            source="Fleisig et al. 1999 (animation); Unitree G1 data sheet (robot)",
            robot=37.0,
        ),
    },
)
