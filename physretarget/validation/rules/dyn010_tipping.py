"""A base that only stands on its floor tips over.

What it does
------------
With ``--stands`` a model that is fixed to the world is judged as one that only stands: its base is
set free. The point where the floor would have to press (the centre of pressure that weight and
motion need) must lie within the edge of the base, which does not move. The margin is its distance
to the nearest edge, in millimetres and as a moment in body weight times CoM height.

Why it matters
--------------
Most URDFs of arms and lamps are fixed to the world, though the thing stands on a desk. Whatever
they do, the world holds them; on the desk they fall over.

Threshold
---------
Error below 0, for longer than 0.05 s: the base begins to turn over the edge. Warning below 5 mm:
the desk is no better than that. Ours. Whether it slips is what DYN004 says.

Example
-------
A desk lamp that leans until its head is 12 cm outside its base of 6 cm radius.
"""

from __future__ import annotations

import numpy as np

from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule, exceeding
from physretarget.validation.rule import Judgement, Limit, Limits
from physretarget.validation.standing import has_base, tip_margin


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """A base that only stands on its floor tips over."""
    if not analysis.stands:
        return Judgement(not_covered="only for models fixed to the world, with --stands")
    # At 30 instants a second, as the measures are taken: one number for one thing.
    seen = analysis.measured
    forces = seen.forces
    if forces is None:
        return Judgement(not_covered=analysis.no_forces_because)
    if not has_base(analysis):
        return Judgement(not_covered="no geometry of the base is on the floor")
    margin = 1e3 * tip_margin(seen, forces.required)
    share = forces.required.force[:, 2] / (1e3 * max(seen.character.com_height, 1e-3))
    lowest = float(np.nanmin(margin * share)) if np.isfinite(margin).any() else 0.0
    return exceeding(
        seen, rule, -margin, warning=-limits["warning"], error=-limits["error"], unit="mm",
        sign=-1.0, minimum_s=limits["shortest_s"],
        message="the motion needs the floor to press {value} {unit} inside the edge of the base "
        "(limit {limit}; below 0 it presses outside, and the base tips over). The least margin is "
        f"{lowest:.3g} BW h. Lean less far, move more slowly, or give it a wider or heavier base",
    )  # fmt: skip


RULE = ClipRule(
    code="DYN010",
    name="tipping",
    doc=__doc__ or "",
    check=check,
    limits={
        "warning": Limit(value=5.0, unit="mm", source="ours: how flat desks and feet are"),
        "error": Limit(value=0.0, unit="mm", source="statics: beyond the edge nothing presses"),
        "shortest_s": Limit(value=0.05, unit="s", source="ours: less only rocks it"),
    },
)
