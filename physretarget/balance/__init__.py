"""Balance: the centre of mass led to where the feet can bear it, spin kept in flight.

``centroidal`` is how joints move the whole, ``hold`` what must stay on the floor, ``metric``
what an excursion of the centre of mass costs a pose, ``follow`` the inverse kinematics, ``stage``
the rounds of both with the convex programme (:mod:`physretarget.ocp.balance`).
"""

from __future__ import annotations

from physretarget.balance.settings import BalanceSettings
from physretarget.balance.stage import Balanced, balance

__all__ = ["BalanceSettings", "Balanced", "balance"]
