"""The joints are in another order than the model's.

What it does
------------
Where a clip has errors: takes the joints in the order of a breadth-first walk through the model,
and the reverse, and compares how well the clip then stands on its floor and keeps to its joints'
ranges.

Why it matters
--------------
Isaac Lab orders joints breadth-first, MuJoCo depth-first. A clip without names fits both, and in
the wrong one every joint moves as another should.

Threshold
---------
Error where the other order more than halves what is wrong, by more than 0.03 (slip in units of the
speed of a fall from the height of the centre of mass, stray and offset in that height, joints in
radians beyond their ranges). Ours, on walks, dances, falls and gestures of four bodies.

Example
-------
A policy's rollout saved as a bare qpos array in the simulator's own order.
"""

from __future__ import annotations

from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule
from physretarget.validation.misreading import misread
from physretarget.validation.rule import Judgement, Limits


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """The joints are in another order than the model's."""
    return misread(analysis, rule, "joints")


RULE = ClipRule(
    code="DAT011", name="joint-order", doc=__doc__ or "", check=check, explains="errors"
)
