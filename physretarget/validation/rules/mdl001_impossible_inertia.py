"""A body's mass or inertia cannot exist.

What it does
------------
Checks masses and principal moments of inertia: no principal moment may exceed the sum of the
other two, and the mass must fit the body's geometry.

Why it matters
--------------
Inertias that no distribution of mass has make dynamics that no robot shows, or a simulation
that blows up.

Threshold
---------
The triangle inequality of principal moments is a theorem (error). Mass that would lie outside
the geometry and moving bodies below a gram are warnings.

Example
-------
A link whose inertia was typed in g cm^2 instead of kg m^2.
"""

from __future__ import annotations

from physretarget.validation.model_rule import ModelRule

RULE = ModelRule(
    code="MDL001",
    name="impossible-inertia",
    doc=__doc__ or "",
    errors=("inertia_triangle", "mass_none"),
    warnings=("inertia_reach", "mass_light", "com_outside"),
)
