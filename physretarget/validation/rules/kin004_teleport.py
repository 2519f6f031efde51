"""The body or a joint leaps between two frames.

What it does
------------
Compares the speed of each step, unfiltered, with the steps before and after it: root position,
root rotation and every joint.

Why it matters
--------------
A leap is a cut, a flip of the inverse kinematics or a wrapped angle; every later figure around
it is meaningless.

Threshold
---------
A step faster than both neighbours by more than 5 m/s or 40 rad/s: within one frame at 30 Hz
that is an acceleration of 15 g. Ours.

Example
-------
A root that jumps by half a metre in one frame at 30 Hz: 15 m/s among steps of 1 m/s.
"""

from __future__ import annotations

from physretarget.validation.analysis import Analysis
from physretarget.validation.report import Finding
from physretarget.validation.rule import Limit, Limits, Rule, Verdict, dof_names, exceeding


def check(analysis: Analysis, limits: Limits, rule: Rule) -> Verdict:
    """The body or a joint leaps between two frames."""
    if analysis.frames < 3:
        return Verdict(not_covered="needs at least three frames")
    found: list[Finding] = []
    for kind, unit in (("linear", "m/s"), ("angular", "rad/s")):
        if f"leap_{kind}" in analysis.has:
            found += _leaps(analysis, rule, f"leap_{kind}", limits[kind], unit)
    return Verdict(findings=tuple(found))


def _leaps(
    analysis: Analysis, rule: Rule, series: str, limit: float, unit: str
) -> tuple[Finding, ...]:
    names, worst = dof_names(analysis), analysis.ints(f"{series}_dof")
    return exceeding(
        analysis, rule, analysis[series], warning=limit, error=limit, unit=unit,
        body=lambda t: names[worst[t]],
        message="{body} leaps: {value} {unit} faster than the frames around (limit {limit})",
    ).findings  # fmt: skip


RULE = Rule(
    code="KIN004",
    name="teleport",
    doc=__doc__ or "",
    check=check,
    limits={
        "linear": Limit(value=5.0, unit="m/s", source="ours: 15 g at 30 frames/s"),
        "angular": Limit(
            value=40.0,
            unit="rad/s",
            source="ours: a third of a turn within one frame at 30 frames/s",
        ),
    },
)
