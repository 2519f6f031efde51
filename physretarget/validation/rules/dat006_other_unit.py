"""The root's position is in another unit than metres.

What it does
------------
Compares the median height of the root above the floor with the character's own height. Below the
limit, where the clip has errors, reads its position in the units in use (cm, mm, inches, feet, and
metres for these) and compares how well it then stands on its floor.

Why it matters
--------------
A clip in centimetres puts the body a hundred times too high and lets it move a hundred times
too fast: every other finding then follows from the unit.

Threshold
---------
Warning beyond 10 times the character's height, error beyond 30: ours. The root of someone lying is
about a tenth of the height above the floor, of someone standing half of it: in centimetres that is
10 to 50 times the height, in millimetres 100 to 500.

Example
-------
A csv exported from an animation tool that counts in centimetres.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule
from physretarget.validation.misreading import misread
from physretarget.validation.report import Cause
from physretarget.validation.rule import Judgement, Limit, Limits

_BLOCK = 4096
_MILLIMETRES = 100.0  # character's heights from which millimetres are the likelier reading


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """The root's position is in another unit than metres."""
    character = analysis.character
    if not character.has_root:
        return Judgement(not_covered="the model has no free joint: its base is held by the world")
    if character.height <= 0:
        return Judgement(not_covered="the model has no geometry, hence no height")
    median = float(np.median(_heights(analysis)))
    ratio = median / character.height
    if ratio <= limits["warning"]:
        return misread(analysis, rule, "unit")
    severe = ratio > limits["error"]
    unit, short = ("millimetres", "mm") if ratio >= _MILLIMETRES else ("centimetres", "cm")
    message = (
        f"the root's median height is {median:.4g} m, {ratio:.3g} times the height of "
        f"{character.name} ({character.height:.3g} m)"
    )
    found = rule.finding(
        severity="error" if severe else "warning",
        message=f"{message}: if its position is in {unit}, read the clip with --unit {short}",
        value=ratio, limit=limits["error" if severe else "warning"], unit="heights",
    )  # fmt: skip
    cause = Cause(
        code=rule.code, message=f"the root's position is in {unit}: {message}",
        remedy=f"Read it with --unit {short}", value=ratio,
    )  # fmt: skip
    return Judgement(findings=(found,), causes=(cause,))


def _heights(analysis: Analysis) -> NDArray[np.float64]:
    """(T,) m of the root's origin above the floor, read some frames at a time."""
    column = analysis.character.root_qpos + 2
    parts = [
        analysis.poses(first, min(first + _BLOCK, analysis.frames))[:, column].copy()
        for first in range(0, analysis.frames, _BLOCK)
    ]
    above: NDArray[np.float64] = np.concatenate(parts) - analysis.character.floor_height
    return above


RULE = ClipRule(
    code="DAT006",
    name="other-unit",
    doc=__doc__ or "",
    check=check,
    explains="errors",
    limits={
        "warning": Limit(value=10.0, unit="heights", source="ours: someone lying, in centimetres"),
        "error": Limit(
            value=30.0, unit="heights", source="ours: someone crouching, in centimetres"
        ),
    },
)
