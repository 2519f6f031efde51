"""Nothing of the model can touch the floor.

What it does
------------
Looks for collision geometry or declared contact points.

Why it matters
--------------
Without them support, skating, penetration and floating cannot be judged: most of the report is
empty.

Threshold
---------
None.

Example
-------
A robot file whose collision meshes were stripped.
"""

from __future__ import annotations

from physretarget.validation.model_rule import ModelRule

RULE = ModelRule(
    code="MDL006",
    name="no-contact-geometry",
    doc=__doc__ or "",
    warnings=("no_contact_geometry",),
)
