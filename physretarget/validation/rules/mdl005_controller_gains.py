"""A controller's gains hide in joint stiffness or damping.

What it does
------------
Compares joint springs and dampers with what the joint has to carry.

Why it matters
--------------
Passive forces of the file would be taken for motor torque; the report leaves them out, a
simulation does not.

Threshold
---------
A spring that carries its limb three times over at 1 rad, a damper of 0.02 BW h s/rad: ours.

Example
-------
stiffness="100" damping="10" on every joint of a robot file.
"""

from __future__ import annotations

from physretarget.validation.model_rule import ModelRule

RULE = ModelRule(
    code="MDL005",
    name="controller-gains",
    doc=__doc__ or "",
    warnings=("pd_gains", "root_passive"),
)
