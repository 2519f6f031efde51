"""The clip's own contacts and its geometry disagree.

What it does
------------
Looks at clips that say which contact points stand. A point that is said to stand must be within the
contact tolerance of the floor; a body none of whose points is said to stand must not rest on the
floor (slower than 0.1 m/s, within the tolerance) for long.

Why it matters
--------------
Such clips are judged by what they say: points that stand may bear load, others only where they
are 1 mm and more in the floor. Where that is wrong, every verdict about forces, sliding and
floating rests on it, and so does whoever trains on the clip's contacts.

Threshold
---------
Error for a standing point higher than the tolerance of the report and 1 cm more for 0.1 s, warning
beyond the tolerance for 0.05 s; warning for a body that rests unsaid for 0.25 s, about half of the
stance of a walk. Ours.

Example
-------
A clip that was lifted by 3 cm after its contacts had been written.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physretarget.kinematics import runs
from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule, most_severe
from physretarget.validation.declared import DeclaredContacts, not_declared
from physretarget.validation.report import Finding
from physretarget.validation.rule import Judgement, Limit, Limits


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """The clip's own contacts and its geometry disagree."""
    declared = analysis.series.declared
    if declared is None:
        return Judgement(not_covered=not_declared(analysis.clip, analysis.character))
    found = _in_the_air(analysis, declared, limits, rule)
    found += _at_rest(analysis, declared.undeclared, limits, rule)
    return Judgement(findings=most_severe(found))


def _in_the_air(
    analysis: Analysis, declared: DeclaredContacts, limits: Limits, rule: ClipRule
) -> list[Finding]:
    height = np.nan_to_num(declared.height, nan=-np.inf)
    bodies = declared.body
    severe_above = analysis.tolerance + limits["error"]
    found = []
    for first, last in runs(height > analysis.tolerance):
        if _seconds(analysis, first, last) < limits["warning_s"]:
            continue
        worst = first + int(height[first : last + 1].argmax())
        severe = height[first : last + 1] > severe_above
        error = float(severe.sum()) / max(analysis.fps, 1e-9) >= limits["error_s"]
        name = analysis.body_name(bodies[worst])
        found.append(rule.finding(
            severity="error" if error else "warning",
            message=f"{name} is said to stand {height[worst]:.3g} m above the floor",
            frame_first=analysis.clip_frame(first), frame_last=analysis.clip_frame(last),
            frame=analysis.clip_frame(worst), time_s=float(analysis.time[worst]), body=name,
            value=float(height[worst]), unit="m",
            limit=severe_above if error else analysis.tolerance,
        ))  # fmt: skip
    return found


def _at_rest(
    analysis: Analysis, bodies: NDArray[np.int64], limits: Limits, rule: ClipRule
) -> list[Finding]:
    found = []
    for body in np.unique(bodies[bodies >= 0]):
        for first, last in runs(bodies == body):
            seconds = _seconds(analysis, first, last)
            if seconds < limits["rest_s"]:
                continue
            name, middle = analysis.body_name(body), (first + last) // 2
            found.append(rule.finding(
                severity="warning",
                message=f"{name} rests on the floor for {seconds:.3g} s and is not said to stand",
                frame_first=analysis.clip_frame(first), frame_last=analysis.clip_frame(last),
                frame=analysis.clip_frame(middle), time_s=float(analysis.time[middle]), body=name,
                value=seconds, limit=limits["rest_s"], unit="s",
            ))  # fmt: skip
    return found


def _seconds(analysis: Analysis, first: int, last: int) -> float:
    return (last - first + 1) / max(analysis.fps, 1e-9)


RULE = ClipRule(
    code="CON005",
    name="declared-contacts",
    doc=__doc__ or "",
    check=check,
    limits={
        "warning_s": Limit(value=0.05, unit="s", source="ours: a frame or two of rounding"),
        "error": Limit(value=0.01, unit="m", source="ours: beyond the contact tolerance"),
        "error_s": Limit(value=0.1, unit="s", source="ours: three frames at 30 frames/s"),
        "rest_s": Limit(value=0.25, unit="s", source="ours: about half the stance of a walk"),
    },
)
