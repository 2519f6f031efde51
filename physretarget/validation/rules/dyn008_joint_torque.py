"""A joint needs more torque than its motor has.

What it does
------------
Asks how small a share of its limit (`actuatorfrcrange`, or its actuators' range) the worst joint
can do with: over every way in which the floor's force may spread over what touches, bodies of the
character may press on each other, stops at the end of a range may hold, and the joint's own
friction and damping may help. Springs and dampers that are a controller's gains do not count as
help.

Why it matters
--------------
A saturated motor does not follow; the robot falls behind the clip.

Threshold
---------
Warning above 1, the model's own limit; error above 1.2 held for 0.1 s: masses and accelerations of
a robot are known to a tenth or two, and controllers ride out shorter peaks. Ours.

Example
-------
A one-legged squat of a robot with weak knees.
"""

from __future__ import annotations

from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule, dof_names, exceeding
from physretarget.validation.rule import Judgement, Limit, Limits


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """A joint needs more torque than its motor has."""
    torque = analysis.series.torque
    if torque is None:
        limited = analysis.work.torque is not None
        return Judgement(not_covered=(
            analysis.no_forces_because if limited else "no joint of the model has a torque limit"
        ))  # fmt: skip
    names = dof_names(analysis)
    worst = torque.dof
    return exceeding(
        analysis, rule, torque.share, warning=limits["warning"],
        error=limits["error"], unit="1", body=lambda t: names[worst[t]],
        minimum_s=limits["hold"],
        message="{body} needs {value} times its torque (limit {limit})",
    )  # fmt: skip


RULE = ClipRule(
    code="DYN008",
    name="joint-torque",
    doc=__doc__ or "",
    check=check,
    limits={
        "warning": Limit(value=1.0, unit="1", source="the model's own limit"),
        "error": Limit(
            value=1.2,
            unit="1",
            source="ours: how well masses and accelerations of a robot are known",
        ),
        "hold": Limit(value=0.1, unit="s", source="ours: controllers ride out shorter peaks"),
    },
)
