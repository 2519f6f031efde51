"""The floor would have to push harder than in any landing.

What it does
------------
Required vertical force in body weights.

Why it matters
--------------
Such peaks are shocks of the data (a foot that stops within one frame), and no joint bears them.

Threshold
---------
Warning from 12 BW (gymnasts' dismounts reach 8-14 BW, Panzer et al. 1988), for a robot from
8 BW: ours. Never an error by itself: a hard landing is against no law.

Example
-------
A fall stopped within one frame.
"""

from __future__ import annotations

import numpy as np

from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule, exceeding
from physretarget.validation.rule import Judgement, Limit, Limits


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """The floor would have to push harder than in any landing."""
    required = analysis.series.required
    if required is None:
        return Judgement(not_covered=analysis.no_forces_because)
    return exceeding(
        analysis, rule, required.force[:, 2], warning=limits["warning"],
        error=np.inf, unit="BW",
        message="{value} {unit} of support are needed (limit {limit})",
    )  # fmt: skip


RULE = ClipRule(
    code="DYN009",
    name="support-peak",
    doc=__doc__ or "",
    check=check,
    limits={
        "warning": Limit(
            value=12.0, unit="BW", source="Panzer et al. 1988 (animation), ours (robot)", robot=8.0
        ),
    },
)
