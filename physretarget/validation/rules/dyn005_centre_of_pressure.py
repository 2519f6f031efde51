"""The centre of pressure stays outside the support.

What it does
------------
Where contacts explain the force but not the moment about a horizontal axis, the weight would have
to be borne outside everything that touches: so far outside as makes that moment. Counted is what
lasts for as long as a body takes to topple, the time constant sqrt(h / g) of an upside-down
pendulum as high as the CoM (0.3 s for a human, 0.17 s for a desk lamp).

Why it matters
--------------
The body tips over the edge of its support. A moment that passes is DYN002's question.

Threshold
---------
Warning from 9.5 mm, error from 2.9 cm, so that 1 cm and 3 cm past the toe are named: ours. Edges of
feet are known from the geometry, which leaves the error of masses and poses; after the time above a
body has fallen by e times what it stands outside.

Example
-------
A lean beyond the toes.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.ndimage import grey_opening

from physretarget.validation import states
from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule, exceeding
from physretarget.validation.rule import Judgement, Limit, Limits


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """The centre of pressure stays outside the support."""
    forces = analysis.forces
    if forces is None:
        return Judgement(not_covered=analysis.no_forces_because)
    if held := states.held_elsewhere(analysis):
        return Judgement(not_covered=held)
    outside = np.nan_to_num(forces.residual.cop_outside)
    outside = np.where(states.known(analysis), outside, 0.0)
    character = analysis.character
    gravity = float(np.linalg.norm(character.model.opt.gravity))
    topples = math.sqrt(max(character.com_height, 1e-3) / max(gravity, 1e-3))
    frames = max(1, math.ceil(topples * analysis.fps))
    # The level that is kept up for so many frames in a row.
    lasting = np.zeros(len(outside))
    if frames <= len(outside):
        lasting = grey_opening(outside, size=(frames,))
    return exceeding(
        analysis, rule, lasting, warning=limits["warning"], error=limits["error"], unit="m",
        message="the centre of pressure stays {value} {unit} outside the support (limit {limit})",
    )  # fmt: skip


RULE = ClipRule(
    code="DYN005",
    name="centre-of-pressure",
    doc=__doc__ or "",
    check=check,
    limits={
        "warning": Limit(
            value=0.009, unit="m", source="ours: an edge is known to 1 cm, which warns"
        ),
        "error": Limit(value=0.029, unit="m", source="ours: three times that"),
    },
)
