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

from physretarget.validation.analysis import Analysis
from physretarget.validation.model import audited
from physretarget.validation.rule import Limits, Rule, Verdict


def check(analysis: Analysis, limits: Limits, rule: Rule) -> Verdict:
    """A body is lighter than foam or heavier than tungsten."""
    return audited(analysis, rule, errors=(), warnings=("density_low", "density_high"))


RULE = Rule(
    code="MDL002",
    name="implausible-density",
    doc=__doc__ or "",
    check=check,
)
