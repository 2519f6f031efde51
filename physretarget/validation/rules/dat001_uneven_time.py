"""Frames are not evenly spaced in time.

What it does
------------
Compares every step of `time` with the mean step. An uneven clip is resampled at its mean rate
before anything else is judged.

Why it matters
--------------
Velocities and accelerations come from neighbouring frames. A dropped frame reads as a leap, a
repeated one as a halt.

Threshold
---------
Warning beyond 5 % (jitter of a capture clock), error beyond 50 % (a frame is missing): ours.

Example
-------
A 30 Hz clip with one frame cut out: one step of 67 ms among steps of 33 ms.
"""

from __future__ import annotations

from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule
from physretarget.validation.rule import Judgement, Limit, Limits


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """Frames are not evenly spaced in time."""
    if len(analysis.uneven) == 0:
        return Judgement()
    worst = int(analysis.uneven.argmax())
    value = float(analysis.uneven[worst])
    if value <= limits["jitter"]:
        return Judgement()
    severe = value > limits["gap"]
    limit = limits["gap"] if severe else limits["jitter"]
    return Judgement(findings=(rule.finding(
        severity="error" if severe else "warning",
        message=f"the step to this frame is {value:.0%} off the mean step (limit {limit:.0%})",
        frame_first=worst + 1, frame_last=worst + 1, frame=worst + 1,
        time_s=float(analysis.clip.time[worst + 1]), value=value, limit=limit, unit="1",
    ),))  # fmt: skip


RULE = ClipRule(
    code="DAT001",
    name="uneven-time",
    doc=__doc__ or "",
    check=check,
    limits={
        "jitter": Limit(
            value=0.05, unit="1", source="ours: clocks of capture systems stay well within 5 %"
        ),
        "gap": Limit(
            value=0.5, unit="1", source="ours: half a step and more means that a frame is missing"
        ),
    },
)
