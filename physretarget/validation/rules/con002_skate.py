"""A loaded foot slides over the floor.

What it does
------------
Tangential speed, between frames in both of which they touch, of bodies that together bear more than
10 % of body weight (and a quarter of what is borne) in the fitted contact forces: one foot, or
several links of a snake. A body's speed is that of its slowest loaded point, so that rolling over
the toes or turning on the heel is no sliding. Counted is what Coulomb's law cannot explain:
where friction on the edge of its cone, within 45 degrees against the motion, leaves 0.1 BW more
unexplained than friction as it pleases. What skids as physics has it is not counted.

Why it matters
--------------
Sliding support is the first thing a viewer sees, and on a robot it is a fall.

Threshold
---------
Faster than 0.1 m/s, over at least 1 cm for a warning and 2 cm for an error: ours. holosoma's
1 cm per frame is 0.3 m/s at 30 Hz and 1.2 m/s at 120 Hz; a rate per second does not depend on
that, and a distance is what a viewer sees.

Example
-------
A walk whose stance foot drifts forward at 0.2 m/s.
"""

from __future__ import annotations

from physretarget.kinematics import runs
from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule, most_severe
from physretarget.validation.external_contacts import on_slope
from physretarget.validation.rule import Judgement, Limit, Limits


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """A loaded foot slides over the floor."""
    if slope := on_slope(analysis.character):
        return Judgement(not_covered=slope)
    skate = analysis.series.skate
    if skate is None:
        return Judgement(not_covered=analysis.no_forces_because)
    body, speed = skate.body, skate.free
    found = []
    for first, last in runs(speed > limits["speed"]):
        slid = float(speed[first : last + 1].sum() / analysis.fps)
        if slid < limits["warning"]:
            continue
        worst = first + int(speed[first : last + 1].argmax())
        severe = slid >= limits["error"]
        name = analysis.body_name(body[worst])
        found.append(rule.finding(
            severity="error" if severe else "warning",
            message=f"{name} bears load and slides {slid:.3g} m, up to {speed[worst]:.3g} m/s",
            frame_first=analysis.clip_frame(first), frame_last=analysis.clip_frame(last),
            frame=analysis.clip_frame(worst), time_s=float(analysis.time[worst]), body=name,
            value=slid, limit=limits["error" if severe else "warning"], unit="m",
        ))  # fmt: skip
    return Judgement(findings=most_severe(found))


RULE = ClipRule(
    code="CON002",
    name="skate",
    doc=__doc__ or "",
    check=check,
    limits={
        "speed": Limit(value=0.1, unit="m/s", source="ours: above the noise of stance feet"),
        "warning": Limit(value=0.01, unit="m", source="holosoma: 1 cm"),
        "error": Limit(value=0.02, unit="m", source="ours: seen without looking for it"),
    },
)
