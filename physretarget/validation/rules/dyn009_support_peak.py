"""The floor would have to push harder than in any landing.

What it does
------------
Required vertical force in body weights.

Why it matters
--------------
Such peaks are shocks of the data (a foot that stops within one frame), and no joint bears them.

Threshold
---------
animation: warning 6 BW (landing from 0.6 m, McNitt-Gray 1993), error 12 BW (gymnasts' dismounts
reach 8-14 BW, Panzer et al. 1988). robot: 3 and 6 BW, ours: a robot's structure is rated for
less.

Example
-------
A fall stopped within one frame.
"""

from __future__ import annotations

from physretarget.validation.analysis import Analysis
from physretarget.validation.rule import Limit, Limits, Rule, Verdict, exceeding


def check(analysis: Analysis, limits: Limits, rule: Rule) -> Verdict:
    """The floor would have to push harder than in any landing."""
    if "required_force" not in analysis.has:
        return Verdict(not_covered=analysis.no_forces_because)
    return exceeding(
        analysis, rule, analysis["required_force"][:, 2], warning=limits["warning"],
        error=limits["error"], unit="BW",
        message="{value} {unit} of support are needed (limit {limit})",
    )  # fmt: skip


RULE = Rule(
    code="DYN009",
    name="support-peak",
    doc=__doc__ or "",
    check=check,
    limits={
        "warning": Limit(value=6.0, unit="BW", source="McNitt-Gray 1993", robot=3.0),
        "error": Limit(
            value=12.0, unit="BW", source="Panzer et al. 1988 (animation), ours (robot)", robot=6.0
        ),
    },
)
