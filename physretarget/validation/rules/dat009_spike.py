"""One frame lies off its neighbours.

What it does
------------
Takes from the clip as given, before any filter, how far a frame lies off the path before it and off
the path after it, where both agree: of the two sides and the middle the least counts, so that an
impact, which bends the path on one side, leaves nothing. Root position, root rotation and every
joint. Frames beside repeated or missing ones are left to those rules.

Why it matters
--------------
A swapped marker, a lost packet or a wrong solution of the inverse kinematics puts one frame beside
the motion: a shock there and back that no body makes.

Threshold
---------
Of the root 8 mm and 2.3 degrees are errors, 0.6 of that warns; of a joint 11 degrees. To each comes
what the accelerations listed move a body in one step of the clip, and eight times the noise around.
Ours.

Example
-------
A root that is 2 cm too high in one frame of a walk.
"""

from __future__ import annotations

import numpy as np

from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule, dof_names, most_severe
from physretarget.validation.report import Finding
from physretarget.validation.rule import Judgement, Limit, Limits
from physretarget.validation.steps import Kind, stands_out

_KINDS = (
    Kind("position", "the root", "m", 1e3, "mm"),
    Kind("rotation", "the root", "rad", 180 / np.pi, "degrees"),
    Kind("joint", "{joint}", "rad", 180 / np.pi, "degrees"),
)


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """One frame lies off its neighbours."""
    seen = analysis.continuity
    if seen.frames < 5:
        return Judgement(not_covered="needs at least five frames")
    names = dof_names(analysis)
    paced = np.r_[False, seen.paced] | np.r_[seen.paced, False]
    found: list[Finding] = []
    for kind in _KINDS:
        size = np.where(paced, 0.0, getattr(seen, f"spike_{kind.name}"))
        for frame, value, limit, severity in stands_out(
            size, seen.noise_around(kind.name), kind, limits, analysis.fps
        ):
            joint = names[int(seen.spike_dof[frame])]
            at = analysis.clip_frame(frame)
            found.append(rule.finding(
                severity=severity,
                message=f"{kind.what.format(joint=joint)} lies {kind.shown * value:.3g} {kind.of} "
                f"off the frames before and after (limit {kind.shown * limit:.3g}). Replace this "
                "frame by what lies between its neighbours",
                frame_first=at, frame_last=at, frame=at, time_s=float(analysis.time[frame]),
                body=joint if kind.name == "joint" else None, value=value, limit=limit,
                unit=kind.unit,
            ))  # fmt: skip
    return Judgement(findings=most_severe(found))


RULE = ClipRule(
    code="DAT009",
    name="spike",
    doc=__doc__ or "",
    check=check,
    limits={
        "position": Limit(value=0.008, unit="m", source="ours: error; 0.6 of it warns"),
        "rotation": Limit(value=0.04, unit="rad", source="ours: error; 0.6 of it warns"),
        "joint": Limit(value=0.2, unit="rad", source="ours: error; 0.6 of it warns"),
        "position_acceleration": Limit(value=8.0, unit="m/s^2", source="ours: hops at 30 frames/s"),
        "rotation_acceleration": Limit(
            value=35.0, unit="rad/s^2", source="ours: ragdolls at 60 frames/s"
        ),
        "joint_acceleration": Limit(
            value=470.0, unit="rad/s^2", source="ours: light limbs of ragdolls at 60 frames/s"
        ),
    },
)
