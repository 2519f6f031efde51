"""A loaded foot slides over the floor.

What it does
------------
Tangential speed of every body that bears more than 10 % of body weight in the fitted contact
forces, taken at its slowest loaded point, so that rolling over the toes or turning on the heel
is no sliding.

Why it matters
--------------
Sliding support is the first thing a viewer sees, and on a robot it is a fall.

Threshold
---------
Warning from 0.1 m/s, error from 0.15 m/s held for 0.05 s: ours. holosoma's 1 cm per frame is
0.3 m/s at 30 Hz and 1.2 m/s at 120 Hz; a rate per second does not depend on that.

Example
-------
A walk whose stance foot drifts forward at 0.2 m/s.
"""

from __future__ import annotations

from physretarget.validation.analysis import Analysis
from physretarget.validation.rule import Limit, Limits, Rule, Verdict, exceeding


def check(analysis: Analysis, limits: Limits, rule: Rule) -> Verdict:
    """A loaded foot slides over the floor."""
    if "skate" not in analysis.has:
        return Verdict(not_covered=analysis.no_forces_because)
    body = analysis.ints("skate_body")
    return exceeding(
        analysis, rule, analysis["skate"], warning=limits["warning"], error=limits["error"],
        unit="m/s", body=lambda t: analysis.body_name(body[t]), minimum_s=limits["hold"],
        message="{body} bears load and slides at {value} {unit} (limit {limit})",
    )  # fmt: skip


RULE = Rule(
    code="CON002",
    name="skate",
    doc=__doc__ or "",
    check=check,
    limits={
        "warning": Limit(
            value=0.1, unit="m/s", source="ours: above the noise of captured stance feet"
        ),
        "error": Limit(
            value=0.15, unit="m/s", source="ours: half of holosoma's limit at 30 frames/s"
        ),
        "hold": Limit(value=0.05, unit="s", source="ours: landing and take-off are shorter"),
    },
)
