"""A body sinks into the floor.

What it does
------------
Height of the lowest point of the collision geometry (or of the declared contact points) below
the floor, less what a landing body sinks into the model's own soft contacts: v tau / e for one that
arrived with v m/s within the last five tau, tau being the time constant of `solref` (7 mm at 1 m/s
by MuJoCo's default of 20 ms).

Why it matters
--------------
It is seen at once, and a simulator answers with an explosion: 2 mm make a dozen body weights of
contact.

Threshold
---------
Warning from 5 mm, PhysDiff's tolerance (Yuan et al. 2023), error from 2 cm, the thickness of a
sole: ours.

Example
-------
A foot that dips 3 cm below the floor at heel strike.
"""

from __future__ import annotations

from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule, exceeding
from physretarget.validation.external_contacts import on_slope
from physretarget.validation.rule import Judgement, Limit, Limits
from physretarget.validation.soft_contact import landing_depth


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """A body sinks into the floor."""
    if slope := on_slope(analysis.character):
        return Judgement(not_covered=slope)
    floor = analysis.series.floor
    if floor is None:
        return Judgement(not_covered="the model has no contact geometry")
    body = floor.deepest_body
    return exceeding(
        analysis, rule, -floor.deepest - landing_depth(analysis, floor, limits["warning"]),
        warning=limits["warning"], error=limits["error"],
        unit="m", body=lambda t: analysis.body_name(body[t]),
        message="{body} is {value} {unit} below the floor (limit {limit})",
    )  # fmt: skip


RULE = ClipRule(
    code="CON001",
    name="ground-penetration",
    doc=__doc__ or "",
    check=check,
    limits={
        "warning": Limit(
            value=0.005, unit="m", source="PhysDiff (Yuan et al. 2023), tolerance 5 mm"
        ),
        "error": Limit(value=0.02, unit="m", source="ours: the thickness of a sole"),
    },
)
