"""The simulated body leaves the clip to stay on its feet.

What it does
------------
With ``--simulate``: root-mean-square distance of the markers from the clip's, in heights, over the
time survived without assist.

Why it matters
--------------
A planner repairs a clip that cannot happen by doing something else. How far it had to go is what is
wrong with the clip.

Threshold
---------
Warning from 5 %, error from 10 % of the height: ours. Feasible bows come to 0.1 %, walks to 1.2 %.

Example
-------
A walk at one and a half times its speed.
"""

from __future__ import annotations

from typing import Literal

from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule
from physretarget.validation.rule import Judgement, Limit, Limits


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """The simulated body leaves the clip to stay on its feet."""
    played = analysis.played
    if played is None or played.exact is None:
        return Judgement(not_covered=played.reason if played else "only with --simulate")
    share = played.exact.tracking_share
    if share <= limits["warning"]:
        return Judgement()
    severity: Literal["error", "warning"] = "error" if share > limits["error"] else "warning"
    limit = limits[severity]
    return Judgement(
        findings=(
            rule.finding(
                severity=severity,
                message=f"the simulated body is {100 * share:.1f} % of its height off the clip, "
                f"root mean square (limit {100 * limit:g} %)",
                value=share, limit=limit, unit="1",
            ),
        )
    )  # fmt: skip


RULE = ClipRule(
    code="SIM002",
    name="deviates",
    doc=__doc__ or "",
    check=check,
    limits={
        "warning": Limit(value=0.05, unit="1", source="ours: four times a feasible walk's"),
        "error": Limit(value=0.1, unit="1", source="ours: twice the warning"),
    },
)
