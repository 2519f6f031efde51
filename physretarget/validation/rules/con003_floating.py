"""The body hangs in the air without support.

What it does
------------
Frames in which nothing is near the floor although the motion needs more than 30 % of body
weight of support, beyond what differences and the filter carry there from contacts nearby.

Why it matters
--------------
Air bears nothing. A jump in free fall is no floating: it needs no support.

Threshold
---------
Warning from 0.05 s, error from 0.1 s: ours. Near the floor means within the contact tolerance
of the report.

Example
-------
A standing clip lifted by 3 cm.
"""

from __future__ import annotations

from physretarget.kinematics import runs
from physretarget.validation import states
from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule, most_severe
from physretarget.validation.rule import Judgement, Limit, Limits


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """The body hangs in the air without support."""
    forces = analysis.forces
    if forces is None:
        return Judgement(not_covered=analysis.no_forces_because)
    if held := states.held_elsewhere(analysis):
        return Judgement(not_covered=held)
    lowest, body = forces.floor.lowest, forces.floor.lowest_body
    vertical = forces.required.force[:, 2]
    found = []
    for first, last in runs(states.floating(analysis, forces)):
        seconds = (last - first + 1) / analysis.fps
        if seconds <= limits["warning"]:
            continue
        worst = first + int(lowest[first : last + 1].argmax())
        height = float(lowest[worst])
        severe = seconds > limits["error"]
        found.append(rule.finding(
            severity="error" if severe else "warning",
            message=f"floats for {seconds:.3g} s: the lowest point is {height:.3g} m above the "
            f"floor and {vertical[worst]:.2g} BW of support are needed",
            frame_first=analysis.clip_frame(first), frame_last=analysis.clip_frame(last),
            frame=analysis.clip_frame(worst), time_s=float(analysis.time[worst]),
            body=analysis.body_name(body[worst]), value=seconds,
            limit=limits["error" if severe else "warning"], unit="s",
        ))  # fmt: skip
    return Judgement(findings=most_severe(found))


RULE = ClipRule(
    code="CON003",
    name="floating",
    doc=__doc__ or "",
    check=check,
    limits={
        "warning": Limit(
            value=0.05, unit="s", source="ours: a frame or two of rounding at take-off"
        ),
        "error": Limit(value=0.1, unit="s", source="ours: three frames at 30 frames/s"),
    },
)
