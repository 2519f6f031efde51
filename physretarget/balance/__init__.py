"""Balance: the centre of mass led to where the feet can bear it, spin kept in flight.

``centroidal`` is how joints move the whole, ``hold`` what must stay on the floor, ``metric``
what an excursion of the centre of mass costs a pose, ``stage`` the rounds of convex programme
(:mod:`physretarget.ocp.balance`) and inverse kinematics.
"""

from __future__ import annotations

from physretarget.balance.settings import BalanceSettings
from physretarget.balance.stage import Balanced, balance

__all__ = ["BalanceSettings", "Balanced", "balance"]
