"""Gravity or size suggest another unit or axis.

What it does
------------
Looks at gravity and at the model's extent.

Why it matters
--------------
All limits of this report are in metres, kilograms and seconds on a floor that z points away
from.

Threshold
---------
Gravity 9.81 m/s^2 downward; extent between 2 cm and 20 m: ours.

Example
-------
A model in centimetres.
"""

from __future__ import annotations

from physretarget.validation.model_rule import ModelRule

RULE = ModelRule(
    code="MDL007",
    name="suspicious-world",
    doc=__doc__ or "",
    warnings=("gravity", "size"),
)
