"""Kinetics: what the ground does to an actor, from motion alone.

    ActorMotion ──▶ inverse dynamics ──▶ its flights must fall at g ──▶ GroundWrench
         └──▶ which points touch ──▶ shared between the soles ──▶ GroundForces (.mot, .csv)

``flight`` corrects the vertical course by the capture's own flights, ``treadmill`` finds the
belt under the feet, ``feet`` shares the wrench between both. ``docs/captures.md`` says how well it
does against force plates.
"""

from __future__ import annotations

from physretarget.kinetics.feet import FootForce
from physretarget.kinetics.ground import DEFAULT_HZ, GroundForces, forces
from physretarget.kinetics.wrench import GroundWrench, ground_wrench

__all__ = ["DEFAULT_HZ", "FootForce", "GroundForces", "GroundWrench", "forces", "ground_wrench"]
