"""A stretch repeats one frame in the middle of motion.

What it does
------------
Finds runs of frames, unfiltered, that are equal to rounding while the clip moves before and
after.

Why it matters
--------------
Dropped frames filled with copies stop the body and start it again: two shocks that no body
makes.

Threshold
---------
Runs of 2 or more equal steps between frames that move; error from 0.2 s on. Ours.

Example
-------
A stream that hangs for three frames in the middle of a step.
"""

from __future__ import annotations

from physretarget.validation.analysis import Analysis
from physretarget.validation.rule import Limit, Limits, Rule, Verdict, runs


def check(analysis: Analysis, limits: Limits, rule: Rule) -> Verdict:
    """A stretch repeats one frame in the middle of motion."""
    if analysis.frames < 4:
        return Verdict(not_covered="too few frames")
    step = analysis["step"][1:]
    still = step <= limits["still"]
    found = []
    for first, last in runs(still):
        before = step[first - 1] * analysis.fps if first > 0 else 0.0
        after = step[last + 1] * analysis.fps if last + 1 < len(step) else 0.0
        if last - first < 1 or min(before, after) < limits["moving"]:
            continue
        seconds = (last - first + 1) / analysis.fps
        found.append(rule.finding(
            severity="error" if seconds > limits["error_s"] else "warning",
            message=f"{last - first + 2} equal frames ({seconds:.3g} s) in the middle of motion",
            frame_first=first, frame_last=last + 1, frame=first, unit="s",
            time_s=float(analysis.time[first]), value=seconds, limit=limits["error_s"],
        ))  # fmt: skip
    return Verdict(findings=tuple(found))


RULE = Rule(
    code="DAT003",
    name="frozen-frames",
    doc=__doc__ or "",
    check=check,
    limits={
        "still": Limit(value=1e-09, unit="rad or m", source="rounding of float64"),
        "error_s": Limit(value=0.2, unit="s", source="ours: longer than a blink of the recording"),
        "moving": Limit(
            value=0.05,
            unit="rad/s or m/s",
            source="ours: slower than this the clip may simply rest",
        ),
    },
)
