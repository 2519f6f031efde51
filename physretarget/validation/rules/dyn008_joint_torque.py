"""A joint needs more torque than its motor has.

What it does
------------
Torque of every limited joint from inverse dynamics and the fitted contact forces, as a share of
`actuatorfrcrange` or of its actuators' range. Springs and dampers of the file are not counted as
help, since controller gains hide there; a stop at the end of a joint's range is.

Why it matters
--------------
A saturated motor does not follow; the robot falls behind the clip.

Threshold
---------
Warning above 1, error above 2 held for 0.1 s: how two feet share the load is a best guess, and a
factor of two is beyond it; with more bodies on the floor, a factor of their number. Ours.

Example
-------
A one-legged squat of a robot with weak knees.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from physretarget.validation.analysis import Analysis
from physretarget.validation.report import Finding
from physretarget.validation.rule import Limit, Limits, Rule, Verdict, dof_names, exceeding


def check(analysis: Analysis, limits: Limits, rule: Rule) -> Verdict:
    """A joint needs more torque than its motor has."""
    if "torque_ratio" not in analysis.has:
        limited = analysis.work.torque.any
        return Verdict(not_covered=(
            analysis.no_forces_because if limited else "no joint of the model has a torque limit"
        ))  # fmt: skip
    names = dof_names(analysis)
    worst = analysis.ints("torque_dof")
    ratio = analysis["torque_ratio"]
    verdict = exceeding(
        analysis, rule, ratio, warning=limits["warning"],
        error=limits["error"], unit="1", body=lambda t: names[worst[t]],
        minimum_s=limits["hold"],
        message="{body} needs {value} times its torque (limit {limit})",
    )  # fmt: skip
    if "touch" not in analysis.has:
        return verdict
    # Of n bodies on the floor any may bear all, where an even share was guessed.
    sure = ratio > limits["error"] * np.maximum(1.0, analysis.flags("touch").sum(axis=1) / 2)
    return replace(verdict, findings=tuple(_as_sure(f, sure, analysis) for f in verdict.findings))


def _as_sure(finding: Finding, sure: NDArray[np.bool_], analysis: Analysis) -> Finding:
    """An error only where no other share of the load explains it."""
    frames = np.array([analysis.clip_frame(int(t)) for t in np.flatnonzero(sure)])
    first, last = finding.frame_first, finding.frame_last
    assert first is not None
    assert last is not None
    if finding.severity == "warning" or ((frames >= first) & (frames <= last)).any():
        return finding
    return replace(finding, severity="warning")


RULE = Rule(
    code="DYN008",
    name="joint-torque",
    doc=__doc__ or "",
    check=check,
    limits={
        "warning": Limit(value=1.0, unit="1", source="the model's own limit"),
        "error": Limit(
            value=2.0,
            unit="1",
            source="ours: beyond what another share of load between the feet could explain",
        ),
        "hold": Limit(value=0.1, unit="s", source="ours: controllers ride out shorter peaks"),
    },
)
