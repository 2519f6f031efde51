"""The last stage: the whole body moved, as little as need be, to where the floor can bear it.

``wrench`` is what a motion requires and its exact derivatives, ``support`` what the floor can do,
``problem`` what a change of poses costs, ``banded`` the linear algebra, ``solve`` the search over
one window and ``stage`` the way through a clip.
"""

from __future__ import annotations

from physretarget.wholebody.settings import WholeBodySettings
from physretarget.wholebody.stage import WholeBody, balance

__all__ = ["WholeBody", "WholeBodySettings", "balance"]
