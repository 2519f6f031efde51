"""The clip trembles: from frame to frame it carries noise.

What it does
------------
Takes from the clip as given, before any filter, the smallest jump from frame to frame that explains
the second differences of a coordinate: 0 for smooth motion and for impacts, of the size of the
noise in a noisy clip. The median over a second is an estimate of the noise's standard deviation,
for the root's position, its rotation, the worst joint and the middle one of all joints; clips finer
than 30 frames/s are looked at over steps of 1/30 s too.

Why it matters
--------------
Jitter is invisible in positions and dominates accelerations, forces and what a viewer feels. A
low-pass hides it from the forces, not from whoever uses the clip.

Threshold
---------
Of the root 1 mm and 0.6 degrees warn, 2 mm and 1.1 degrees are errors: optical capture carries less
than 1 mm. All joints together warn at 0.3 degrees, a single one at 1.7, errors at twice that. A
body that shakes by itself hides some: to each limit comes what an acceleration of 1 m/s^2 (2 for
errors) and the angular ones listed move a body in one step. Ours, measured on simulations with
impacts and on retargeted clips of 24 to 120 frames/s.

Example
-------
A root whose height carries 3 mm of noise.
"""

from __future__ import annotations

import numpy as np

from physretarget.options.judging import Severity
from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule, dof_names, most_severe
from physretarget.validation.report import Cause, Finding
from physretarget.validation.rule import Judgement, Limit, Limits


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """The clip trembles: from frame to frame it carries noise."""
    seen = analysis.continuity
    if len(seen.noise_step) == 0:
        return Judgement(not_covered="noise cannot be told in fewer than 11 frames")
    names = dof_names(analysis)
    found: list[Finding] = []
    causes: list[Cause] = []
    for kind, what, unit in (
        ("position", "the root's position", "m"),
        ("rotation", "the root's rotation", "rad"),
        ("joints", "every joint", "rad"),
        ("joint", "joint {joint}", "rad"),
    ):
        values = getattr(seen, f"noise_{kind}")
        allowed = limits[kind] + limits[f"{kind}_acceleration"] * seen.noise_step**2
        worst = int((values / allowed).argmax())
        if values[worst] <= allowed[worst]:
            continue
        severity: Severity = "error" if values[worst] > 2 * allowed[worst] else "warning"
        bad = np.flatnonzero(values > allowed)
        first, last = int(seen.noise_first[bad].min()), int(seen.noise_last[bad].max())
        frame = int(seen.noise_first[worst] + seen.noise_last[worst]) // 2
        limit = float(allowed[worst]) * (2 if severity == "error" else 1)
        joint = names[int(seen.noise_dof[worst])]
        shown, of = (1e3, "mm") if unit == "m" else (180 / np.pi, "degrees")
        if severity == "error":
            causes.append(Cause(
                code=rule.code, message=f"noise of {shown * values[worst]:.3g} {of} lies on "
                f"{what.format(joint=joint)}, from frame to frame",
                remedy="Smooth the clip itself, or track it again", value=float(values[worst]),
            ))  # fmt: skip
        found.append(rule.finding(
            severity=severity,
            message=f"{what.format(joint=joint)} trembles from frame to frame: noise of "
            f"{shown * values[worst]:.3g} {of} (limit {shown * limit:.3g}). Smooth the clip, or "
            "track it again",
            frame_first=analysis.clip_frame(first), frame_last=analysis.clip_frame(last),
            frame=analysis.clip_frame(frame), time_s=float(analysis.time[frame]),
            body=joint if kind == "joint" else None, value=float(values[worst]), limit=limit,
            unit=unit,
        ))  # fmt: skip
    return Judgement(findings=most_severe(found), causes=tuple(causes[:1]))


RULE = ClipRule(
    code="KIN003",
    name="jitter",
    doc=__doc__ or "",
    check=check,
    limits={
        "position": Limit(
            value=0.001, unit="m", source="ours: optical capture has less; error at twice"
        ),
        "rotation": Limit(value=0.01, unit="rad", source="ours: 1 mm at 10 cm; error at twice"),
        "joints": Limit(value=0.005, unit="rad", source="ours: 1 mm at 20 cm; error at twice"),
        "joint": Limit(
            value=0.03, unit="rad", source="ours: visible in a hand or a head; error at twice"
        ),
        "position_acceleration": Limit(
            value=1.0, unit="m/s^2", source="ours: runs at 30 frames/s reach 0.7 of the limit"
        ),
        "rotation_acceleration": Limit(
            value=30.0, unit="rad/s^2", source="ours: runs at 30 frames/s reach 0.9 of the limit"
        ),
        "joints_acceleration": Limit(
            value=20.0, unit="rad/s^2", source="ours: runs at 30 frames/s, a long soft tail"
        ),
        "joint_acceleration": Limit(
            value=200.0, unit="rad/s^2", source="ours: a soft tail at 30 frames/s"
        ),
    },
)
