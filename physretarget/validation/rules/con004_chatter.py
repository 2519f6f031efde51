"""A contact switches on and off.

What it does
------------
Counts touches and gaps shorter than 0.1 s of every body.

Why it matters
--------------
A foot that trembles around the floor drives a contact solver, and a tracking policy, mad.

Threshold
---------
Warning above 4 per second: a runner's two feet make 6 long contact changes per second and no
short ones. Ours.

Example
-------
A stance foot with 5 mm of vertical noise around the contact tolerance.
"""

from __future__ import annotations

import numpy as np

from physretarget.validation import states
from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule, exceeding
from physretarget.validation.external_contacts import on_slope
from physretarget.validation.rule import Judgement, Limit, Limits


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """A contact switches on and off."""
    if slope := on_slope(analysis.character):
        return Judgement(not_covered=slope)
    floor = analysis.series.floor
    if floor is None or analysis.frames < 3:
        return Judgement(not_covered="the model has no contact geometry or the clip no motion")
    flips = states.chatter(floor, analysis.fps, limits["shortest"])
    # The rate is taken over a second around each frame, or the clip where it is shorter.
    width = int(min(max(round(analysis.fps), 1), analysis.frames))
    rate = np.convolve(flips, np.ones(width), mode="same") / (width / analysis.fps)
    return exceeding(
        analysis, rule, rate, warning=limits["rate"], error=np.inf, unit="1/s",
        message="contacts switch {value} times per second (limit {limit})",
    )  # fmt: skip


RULE = ClipRule(
    code="CON004",
    name="chatter",
    doc=__doc__ or "",
    check=check,
    limits={
        "rate": Limit(value=4.0, unit="1/s", source="ours"),
        "shortest": Limit(
            value=0.1,
            unit="s",
            source="ours: half the shortest ground contact of a sprinter (0.08-0.1 s)",
        ),
    },
)
