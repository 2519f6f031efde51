"""A mesh is not watertight, or has another volume than its inertia says.

What it does
------------
Looks at the meshes of the bodies: closed or not, and their volume against the box of the body's
mass and inertia.

Why it matters
--------------
An open mesh has no volume to touch with, and a mesh of another size than its inertia is a part
that was exchanged.

Threshold
---------
Volume between 3 % and 500 % of the equivalent inertia box: ours.

Example
-------
A shell exported in millimetres.
"""

from __future__ import annotations

from physretarget.validation.model_rule import ModelRule

RULE = ModelRule(
    code="MDL003",
    name="mesh-mismatch",
    doc=__doc__ or "",
    warnings=("mesh_open", "mesh_volume"),
)
