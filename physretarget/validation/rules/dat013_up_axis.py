"""Another axis than z points up.

What it does
------------
Where a clip has errors: turns the root so that y, x or one of their opposites points up, with the
world alone or with the root's own frame too, and compares how well the clip then stands on its
floor.

Why it matters
--------------
Animation tools count y up, MuJoCo z. A clip in their axes lies on its side, or walks up a wall.

Threshold
---------
Error where another axis more than halves what is wrong, by more than 0.03 (slip in units of the
speed of a fall from the height of the centre of mass, stray and offset in that height). Ours.

Example
-------
A root track exported from Maya with its y-up axes.
"""

from __future__ import annotations

from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule
from physretarget.validation.misreading import misread
from physretarget.validation.rule import Judgement, Limits


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """Another axis than z points up."""
    return misread(analysis, rule, "up")


RULE = ClipRule(code="DAT013", name="up-axis", doc=__doc__ or "", check=check, explains="errors")
