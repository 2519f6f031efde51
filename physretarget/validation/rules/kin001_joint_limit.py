"""A joint leaves its range.

What it does
------------
Compares every hinge and slide of the unfiltered clip with the model's range.

Why it matters
--------------
A joint beyond its range is not reachable: a controller saturates there, a mesh breaks.

Threshold
---------
Warning beyond 0.5 degrees (rounding, calibration), error beyond 2 degrees: ours. Slides in
metres.

Example
-------
A knee bent backwards by 5 degrees.
"""

from __future__ import annotations

import numpy as np

from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule, exceeding
from physretarget.validation.rule import Judgement, Limit, Limits


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """A joint leaves its range."""
    beyond = analysis.series.limit_excess
    if beyond is None:
        return Judgement(not_covered="no joint of the model has a range")
    joints = analysis.character.tree.joints
    address = np.array([j.qpos for j in joints])
    worst = beyond.coordinate

    def joint(frame: int) -> str:
        index = int(np.searchsorted(address, worst[frame], side="right")) - 1
        return analysis.character.joint_names[index]

    return exceeding(
        analysis, rule, beyond.excess, warning=limits["warning"],
        error=limits["error"], unit="rad", body=joint,
        message="{body} is {value} {unit} beyond its range (limit {limit})",
    )  # fmt: skip


RULE = ClipRule(
    code="KIN001",
    name="joint-limit",
    doc=__doc__ or "",
    check=check,
    limits={
        "warning": Limit(value=0.0087, unit="rad", source="ours: half a degree is calibration"),
        "error": Limit(value=0.035, unit="rad", source="ours: two degrees are seen and felt"),
    },
)
