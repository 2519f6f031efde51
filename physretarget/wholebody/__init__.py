"""The last stage: the whole body moved, as little as need be, to where the floor can bear it.

``wrench`` is what a motion requires and its exact derivatives, ``support`` what the floor can do,
``problem`` what a change of poses costs, ``banded`` the linear algebra, ``solve`` the search over
one window ``stage`` the way through a clip, and ``repair`` the
same for clips in which nobody has said what stands.
"""

from __future__ import annotations

from physretarget.wholebody.repair import Repaired, repair
from physretarget.wholebody.settings import WholeBodySettings
from physretarget.wholebody.stage import WholeBody, balance

__all__ = ["Repaired", "WholeBody", "WholeBodySettings", "balance", "repair"]
