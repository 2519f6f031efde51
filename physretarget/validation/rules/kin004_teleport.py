"""The body or a joint leaps between two frames.

What it does
------------
Compares the speed of each step, unfiltered, with the steps before and after it: root position,
root rotation and every joint.

Why it matters
--------------
A leap is a cut, a flip of the inverse kinematics or a wrapped angle; every later figure around
it is meaningless.

Threshold
---------
A step faster than both neighbours by more than 5 m/s or 40 rad/s: within one frame at 30 Hz
that is an acceleration of 15 g. Ours.

Example
-------
A root that jumps by half a metre in one frame at 30 Hz: 15 m/s among steps of 1 m/s.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from physretarget.kinematics import difference
from physretarget.validation.analysis import Analysis
from physretarget.validation.report import Finding
from physretarget.validation.rule import Limit, Limits, Rule, Verdict, dof_names, exceeding


def _name(names: list[str], which: NDArray[np.int64], frame: int) -> str:
    return names[int(which[max(frame - 1, 0)])]


def check(analysis: Analysis, limits: Limits, rule: Rule) -> Verdict:
    """The body or a joint leaps between two frames."""
    if analysis.frames < 3:
        return Verdict(not_covered="needs at least three frames")
    tree = analysis.character.tree
    step = np.abs(difference(tree, analysis.raw[:-1], analysis.raw[1:])) * analysis.fps
    linear = np.zeros(tree.nv, dtype=bool)
    for joint in tree.joints:
        if joint.kind in ("free", "slide"):
            linear[joint.dof : joint.dof + (3 if joint.kind == "free" else 1)] = True
    names = dof_names(analysis)
    found: list[Finding] = []
    for flags, limit, unit in (
        (linear, limits["linear"], "m/s"),
        (~linear, limits["angular"], "rad/s"),
    ):
        if not flags.any():
            continue
        speed = step[:, flags]
        around = np.maximum(
            np.vstack([speed[1:2], speed[:-1]]), np.vstack([speed[1:], speed[-2:-1]])
        )
        leap = speed - around
        which = np.flatnonzero(flags)[leap.argmax(axis=1)]
        series = np.r_[0.0, leap.max(axis=1)]
        found += exceeding(
            analysis, rule, series, warning=limit, error=limit, unit=unit,
            body=partial(_name, names, which),
            message="{body} leaps: {value} {unit} faster than the frames around (limit {limit})",
        ).findings  # fmt: skip
    return Verdict(findings=tuple(found))


RULE = Rule(
    code="KIN004",
    name="teleport",
    doc=__doc__ or "",
    check=check,
    limits={
        "linear": Limit(value=5.0, unit="m/s", source="ours: 15 g at 30 frames/s"),
        "angular": Limit(
            value=40.0,
            unit="rad/s",
            source="ours: a third of a turn within one frame at 30 frames/s",
        ),
    },
)
