"""A body trembles: its jerk is beyond voluntary motion.

What it does
------------
Dimensionless jerk of every body's origin over a sliding window of 0.5 s: D^3 / v_peak^2 times
the integral of squared jerk (Hogan and Sternad 2009). Single shocks are left out, and clips
finer than 120 frames/s are differenced over 1/120 s.

Why it matters
--------------
Jitter is invisible in positions and dominates accelerations, forces and what a viewer feels.

Threshold
---------
A sine of f Hz scores (2 pi f D)^4 / 2. Voluntary motion hardly passes 5-6 Hz (Winter 2009),
physiological tremor has 8-12 Hz: warning at 1.0e5 (6.7 Hz), error at 1.0e6 (12 Hz). A minimum-
jerk reach scores 205.

Example
-------
A hand whose position carries 2 mm of noise at 120 Hz.
"""

from __future__ import annotations

from physretarget.validation.analysis import Analysis
from physretarget.validation.rule import Limit, Limits, Rule, Verdict, exceeding


def check(analysis: Analysis, limits: Limits, rule: Rule) -> Verdict:
    """A body trembles: its jerk is beyond voluntary motion."""
    if "jitter" not in analysis.has:
        return Verdict(not_covered="jerk needs at least 7 frames, and 50 ms")
    worst = analysis.ints("jitter_body")
    return exceeding(
        analysis, rule, analysis["jitter"], warning=limits["warning"], error=limits["error"],
        unit="1", body=lambda t: analysis.body_name(worst[t]),
        message="{body} trembles: dimensionless jerk {value} (limit {limit})",
    )  # fmt: skip


RULE = Rule(
    code="KIN003",
    name="jitter",
    doc=__doc__ or "",
    check=check,
    limits={
        "warning": Limit(value=100000.0, unit="1", source="a sine of 6.7 Hz; Winter 2009"),
        "error": Limit(value=1000000.0, unit="1", source="a sine of 12 Hz: tremor"),
    },
)
