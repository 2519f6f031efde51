"""The clip moves something besides the character.

What it does
------------
Looks for joints outside the character's tree: props on free joints, doors, a second character. It
finds nothing wrong with them; the coverage names them.

Why it matters
--------------
No other rule looks at how they move: a ball that hovers passes. Frames in or near which the
character touches them are not judged by its forces either, and the report's notes count these.

Threshold
---------
None.

Example
-------
A clip of someone who throws a ball, with the ball in it.
"""

from __future__ import annotations

import numpy as np

from physretarget.validation.analysis import Analysis
from physretarget.validation.rule import Limits, Rule, Verdict

_NAMED = 4


def check(analysis: Analysis, limits: Limits, rule: Rule) -> Verdict:
    """The clip moves something besides the character."""
    model = analysis.character.model
    moving = np.unique(model.jnt_bodyid)
    others = np.unique(model.body_rootid[np.setdiff1d(moving, analysis.character.bodies)])
    if len(others) == 0:
        return Verdict()
    names = ", ".join(model.body(int(i)).name or f"body{i}" for i in others[:_NAMED])
    more = f" and {len(others) - _NAMED} more" if len(others) > _NAMED else ""
    return Verdict(not_covered=f"the motion of {names}{more} is not judged: not the character's")


RULE = Rule(
    code="DAT008",
    name="other-motion",
    doc=__doc__ or "",
    check=check,
)
