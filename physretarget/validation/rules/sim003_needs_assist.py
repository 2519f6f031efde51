"""The simulated body needs help on its root to stay on the clip.

What it does
------------
With ``--simulate`` the clip is played a second time with a wrench on the root that costs, and so is
as small as keeps the body on its track. Its force is given root mean square, in body weights.

Why it matters
--------------
It is what a policy, a motor or a floor would have to give besides: residual forces, measured by a
simulation with contacts.

Threshold
---------
Warning from 5 % of body weight, the bound on residual forces of Hicks et al. 2015; error from three
times that, ours.

Example
-------
A jump that hangs in the air.
"""

from __future__ import annotations

from typing import Literal

from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule
from physretarget.validation.rule import Judgement, Limit, Limits


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """The simulated body needs help on its root to stay on the clip."""
    played = analysis.played
    if played is None or played.assisted is None:
        return Judgement(not_covered=played.reason if played else "only with --simulate")
    force = played.assisted.assist_force_rms_bw
    if force <= limits["warning"]:
        return Judgement()
    severity: Literal["error", "warning"] = "error" if force > limits["error"] else "warning"
    limit = limits[severity]
    return Judgement(
        findings=(
            rule.finding(
                severity=severity,
                message=f"the simulated body needs {force:.2g} BW of help on its root, root mean "
                f"square (limit {limit:g} BW)",
                value=force, limit=limit, unit="BW",
            ),
        )
    )  # fmt: skip


RULE = ClipRule(
    code="SIM003",
    name="needs-assist",
    doc=__doc__ or "",
    check=check,
    limits={
        "warning": Limit(value=0.05, unit="BW", source="Hicks et al. 2015, residual force"),
        "error": Limit(value=0.15, unit="BW", source="ours: three times the warning"),
    },
)
