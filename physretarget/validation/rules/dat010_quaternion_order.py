"""The root's quaternions are in another order than they were read in.

What it does
------------
Where a clip has errors: reads the root's quaternions in the other order (xyzw for wxyz and the
reverse) and conjugated, and compares how well the clip then stands on its floor: how far the lowest
point slips and strays, and how high it lies.

Why it matters
--------------
A body read in the wrong order walks backwards, leans where it should turn and turns where it should
lean. Every other finding then follows from the order.

Threshold
---------
Error where another reading more than halves what is wrong, by more than 0.03 (slip in units of the
speed of a fall from the height of the centre of mass, stray and offset in that height). Upright
motion on the spot without turning reads nearly alike in both orders and is not suspected. Ours, on
walks, dances, falls and gestures of four bodies.

Example
-------
An npz from Isaac Lab, whose quaternions are wxyz, written by a script that had them as xyzw.
"""

from __future__ import annotations

from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule
from physretarget.validation.misreading import misread
from physretarget.validation.rule import Judgement, Limits


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """The root's quaternions are in another order than they were read in."""
    return misread(analysis, rule, "quaternion")


RULE = ClipRule(
    code="DAT010", name="quaternion-order", doc=__doc__ or "", check=check, explains="errors"
)
