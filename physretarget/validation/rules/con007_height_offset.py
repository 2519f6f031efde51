"""The whole clip stands above the floor, or in it, by one height.

What it does
------------
Looks how high the lowest point of the geometry is in the instants in which it is lowest (their
thirtieth percentile), and whether these agree.

Why it matters
--------------
A constant offset makes a body float or sink all the time, and every rule of contact speaks of it.
It is one number, and mended by one.

Threshold
---------
Warning beyond the contact tolerance of the report, where the lowest twentieth and the lowest three
tenths of all instants lie less than half of the offset apart: ours. Whether it errs is what CON001
and CON003 say.

Example
-------
A root track that counts from the ankles of another robot: 4 cm too high throughout.
"""

from __future__ import annotations

import numpy as np

from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule
from physretarget.validation.report import Cause
from physretarget.validation.rule import Judgement, Limit, Limits

_LOWEST, _LOW = 0.05, 0.3


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """The whole clip stands above the floor, or in it, by one height."""
    if not analysis.character.has_root:
        return Judgement(not_covered=analysis.no_forces_because)
    if not analysis.has_geometry:
        return Judgement(not_covered="the model has no geometry that could stand on the floor")
    lowest, low = np.quantile(analysis.evidence.lowest, [_LOWEST, _LOW])
    limit = max(analysis.tolerance, limits["least"])
    if not np.isfinite(low) or abs(low) <= limit or low - lowest > limits["spread"] * abs(low):
        return Judgement()
    way = "above the floor" if low > 0 else "in the floor"
    message = f"the whole clip stands {1e3 * abs(low):.3g} mm {way}"
    remedy = f"{'Lower' if low > 0 else 'Raise'} the root by {1e3 * abs(low):.3g} mm in all frames"
    return Judgement(
        findings=(rule.finding(
            severity="warning", message=f"{message}. {remedy}", value=float(low),
            limit=float(np.copysign(limit, low)), unit="m",
        ),),
        causes=(Cause(code=rule.code, message=message, remedy=remedy, value=float(low)),),
    )  # fmt: skip


RULE = ClipRule(
    code="CON007",
    name="height-offset",
    doc=__doc__ or "",
    check=check,
    explains="findings",
    limits={
        "least": Limit(value=0.005, unit="m", source="PhysDiff's tolerance (Yuan et al. 2023)"),
        "spread": Limit(value=0.5, unit="1", source="ours: one height, not a fall or a hop"),
    },
)
