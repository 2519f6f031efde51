"""The body or a joint jumps between two frames.

What it does
------------
Takes from the clip as given, before any filter, the smallest jump of the root's position, of its
rotation and of every joint that explains the second differences on both sides of a step, whatever
one impact and steady accelerations do besides, less what the step changes in speed. Frames that
repeat or are missing are left to their own rules.

Why it matters
--------------
A body's velocity can change at once, in an impact; its position cannot. A jump is a cut, a flip of
the inverse kinematics, a wrapped angle or a new heading; every later figure around it is
meaningless.

Threshold
---------
Of the root 1 cm and 2.3 degrees are errors, half a centimetre and 1.4 degrees warn; of a joint 14
degrees. To each comes what the accelerations listed move a body in one step of the clip, and eight
times the noise around: simulations with impacts stay below at 60 frames/s and more. Ours.

Example
-------
A heading that turns by 5 degrees from one frame to the next in the middle of a straight walk.
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
    """The body or a joint jumps between two frames."""
    seen = analysis.continuity
    if seen.frames < 4:
        return Judgement(not_covered="needs at least four frames")
    names = dof_names(analysis)
    found: list[Finding] = []
    for kind in _KINDS:
        size = np.where(seen.paced, 0.0, getattr(seen, f"jump_{kind.name}"))
        noise = seen.noise_around(kind.name)
        for step, value, limit, severity in stands_out(
            size, np.maximum(noise[:-1], noise[1:]), kind, limits, analysis.fps
        ):
            joint = names[int(seen.jump_dof[step])]
            found.append(rule.finding(
                severity=severity,
                message=f"{kind.what.format(joint=joint)} jumps by {kind.shown * value:.3g} "
                f"{kind.of} in one frame (limit {kind.shown * limit:.3g}); no impact moves a body "
                "at once. Cut the clip here, or blend over the jump",
                frame_first=analysis.clip_frame(step), frame_last=analysis.clip_frame(step + 1),
                frame=analysis.clip_frame(step + 1), time_s=float(analysis.time[step + 1]),
                body=joint if kind.name == "joint" else None, value=value, limit=limit,
                unit=kind.unit,
            ))  # fmt: skip
    return Judgement(findings=most_severe(found))


RULE = ClipRule(
    code="KIN004",
    name="teleport",
    doc=__doc__ or "",
    check=check,
    limits={
        "position": Limit(value=0.01, unit="m", source="ours: error; half of it warns"),
        "rotation": Limit(value=0.04, unit="rad", source="ours: error; 0.6 of it warns"),
        "joint": Limit(value=0.25, unit="rad", source="ours: a joint turns further in no impact"),
        "position_acceleration": Limit(
            value=10.0, unit="m/s^2", source="gravity: take-off and landing at 25 frames/s"
        ),
        "rotation_acceleration": Limit(
            value=35.0, unit="rad/s^2", source="ours: ragdolls at 60 frames/s"
        ),
        "joint_acceleration": Limit(
            value=470.0, unit="rad/s^2", source="ours: light limbs of ragdolls at 60 frames/s"
        ),
    },
)
