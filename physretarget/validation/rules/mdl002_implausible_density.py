"""A body is lighter than foam or heavier than tungsten.

What it does
------------
Mass of each body over the volume of its geometry.

Why it matters
--------------
A wrong unit or a forgotten mass shifts every force of the report.

Threshold
---------
50 to 20 000 kg/m^3: between hard foam and tungsten; a hollow link lies at a few hundred. Ours.

Example
-------
A foot of 10 kg in a 0.2 litre box.
"""

from __future__ import annotations

from physretarget.validation.model_rule import ModelRule

RULE = ModelRule(
    code="MDL002",
    name="implausible-density",
    doc=__doc__ or "",
    warnings=("density_low", "density_high"),
)
