"""A joint needs more torque than its motor has.

What it does
------------
Torque of every limited joint from inverse dynamics and the fitted contact forces, as a share of
`actuatorfrcrange` or of its actuators' range. Springs and dampers of the file are not counted
as help, since controller gains hide there.

Why it matters
--------------
A saturated motor does not follow; the robot falls behind the clip.

Threshold
---------
Warning above 1, error above 2 held for 0.1 s: how two feet share the load is a best guess, and
a factor of two is beyond it. Ours.

Example
-------
A one-legged squat of a robot with weak knees.
"""

from __future__ import annotations

from physretarget.validation.analysis import Analysis
from physretarget.validation.rule import Limit, Limits, Rule, Verdict, dof_names, exceeding


def check(analysis: Analysis, limits: Limits, rule: Rule) -> Verdict:
    """A joint needs more torque than its motor has."""
    if "torque_ratio" not in analysis.has:
        limited = analysis.work.torque.any
        return Verdict(not_covered=(
            analysis.no_forces_because if limited else "no joint of the model has a torque limit"
        ))  # fmt: skip
    names = dof_names(analysis)
    worst = analysis.ints("torque_dof")
    return exceeding(
        analysis, rule, analysis["torque_ratio"], warning=limits["warning"],
        error=limits["error"], unit="1", body=lambda t: names[worst[t]],
        minimum_s=limits["hold"],
        message="{body} needs {value} times its torque (limit {limit})",
    )  # fmt: skip


RULE = Rule(
    code="DYN008",
    name="joint-torque",
    doc=__doc__ or "",
    check=check,
    limits={
        "warning": Limit(value=1.0, unit="1", source="the model's own limit"),
        "error": Limit(
            value=2.0,
            unit="1",
            source="ours: beyond what another share of load between the feet could explain",
        ),
        "hold": Limit(value=0.1, unit="s", source="ours: controllers ride out shorter peaks"),
    },
)
