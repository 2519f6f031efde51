"""Root height: the last stage, where gravity and the floor have their say.

``scene`` gathers what one pass of inverse dynamics knows, ``basis`` spans the displacement,
``contact_model`` and ``problem`` state the residuals in CasADi, ``gauss_newton`` solves them in
time linear in the clip, ``ipopt`` is a second opinion, ``bound`` says how well anything could do,
``optimise`` is the stage. Yamane 2010, section 5.3.
"""

from __future__ import annotations

from physretarget.ocp.optimise import RootHeight, optimise
from physretarget.ocp.settings import PRESETS, ContactModel, RootHeightSettings

__all__ = [
    "PRESETS",
    "ContactModel",
    "RootHeight",
    "RootHeightSettings",
    "optimise",
]
