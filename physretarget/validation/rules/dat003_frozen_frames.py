"""Frames repeat in the middle of motion.

What it does
------------
Finds, in the clip as given and before any filter, runs of frames that are equal to rounding while
the clip moves before and after, and single frames that repeat the one before while the pose goes
on in one direction. Steps a fiftieth as long as those around count as none.

Why it matters
--------------
Dropped frames filled with copies stop the body and start it again: two shocks that no body
makes.

Threshold
---------
Runs of 2 or more equal steps between frames that move: error from 0.2 s on. Single frames: a
warning where it happens once or twice, an error from three times on. Ours.

Example
-------
A stream that hangs for three frames in the middle of a step; a clip of 24 frames/s that was brought
to 30 by showing every fourth frame twice.
"""

from __future__ import annotations

import numpy as np

from physretarget.kinematics import runs
from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule, most_severe
from physretarget.validation.report import Cause, Finding
from physretarget.validation.rule import Judgement, Limit, Limits

# Repeats are a rhythm where this share of the gaps between them are equal.
_RHYTHM = 0.8


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """Frames repeat in the middle of motion."""
    if analysis.frames < 4:
        return Judgement(not_covered="too few frames")
    single = _single(analysis, limits, rule)
    causes = tuple(
        Cause(code=rule.code, message=what, remedy=remedy, value=f.value)
        for f in single
        if f.severity == "error"
        for what, _, remedy in (f.message.partition(". "),)
    )
    return Judgement(
        findings=most_severe([*_stretches(analysis, limits, rule), *single]), causes=causes
    )


def _stretches(analysis: Analysis, limits: Limits, rule: ClipRule) -> list[Finding]:
    step = analysis.continuity.step
    found = []
    for first, last in runs(step <= limits["still"]):
        before = step[first - 1] * analysis.fps if first > 0 else 0.0
        after = step[last + 1] * analysis.fps if last + 1 < len(step) else 0.0
        if last - first < 1 or min(before, after) < limits["moving"]:
            continue
        seconds = (last - first + 1) / analysis.fps
        found.append(rule.finding(
            severity="error" if seconds > limits["error_s"] else "warning",
            message=f"{last - first + 2} equal frames ({seconds:.3g} s) in the middle of motion. "
            "Record it again, or fill in what is missing",
            frame_first=analysis.clip_frame(first), frame_last=analysis.clip_frame(last + 1),
            frame=analysis.clip_frame(first), unit="s",
            time_s=float(analysis.time[first]), value=seconds, limit=limits["error_s"],
        ))  # fmt: skip
    return found


def _single(analysis: Analysis, limits: Limits, rule: ClipRule) -> list[Finding]:
    at = np.flatnonzero(analysis.continuity.repeats) + 1
    if len(at) == 0:
        return []
    severe = len(at) >= limits["times"]
    gaps = np.diff(at)
    usual = int(np.median(gaps)) if len(gaps) else 0
    if severe and (gaps == usual).mean() >= _RHYTHM:
        what = f"one frame in {usual} repeats the one before, {len(at)} in all"
        remedy = f"Take these frames out: {1 - 1 / usual:.3g} of the frame rate was recorded"
    else:
        what = f"{len(at)} frame{'s repeat' if len(at) > 1 else ' repeats'} the one before in the "
        what += "middle of motion"
        remedy = "Take the repeated frames out, or fill in what is missing"
    return [rule.finding(
        severity="error" if severe else "warning", message=f"{what}. {remedy}",
        frame_first=analysis.clip_frame(int(at[0])), frame_last=analysis.clip_frame(int(at[-1])),
        frame=analysis.clip_frame(int(at[0])), time_s=float(analysis.time[at[0]]),
        value=float(len(at)), limit=limits["times"] if severe else 0.0, unit="frames",
    )]  # fmt: skip


RULE = ClipRule(
    code="DAT003",
    name="frozen-frames",
    doc=__doc__ or "",
    check=check,
    limits={
        "still": Limit(value=1e-09, unit="rad or m", source="rounding of float64"),
        "error_s": Limit(value=0.2, unit="s", source="ours: longer than a blink of the recording"),
        "times": Limit(value=3.0, unit="1", source="ours: single repeats are an error from here"),
        "moving": Limit(
            value=0.05,
            unit="rad/s or m/s",
            source="ours: slower than this the clip may simply rest",
        ),
    },
)
