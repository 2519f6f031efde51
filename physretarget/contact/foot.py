"""One body that stands: its sole, where the motion had it and where it shall be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.contact.sole import Sole, SoleMotion
from physretarget.contact.stances import Footing
from physretarget.contact.track import Track

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Foot:
    """A sole with its motion before the adjustment, its stances and the path it shall take."""

    sole: Sole
    motion: SoleMotion
    active: Bools
    footings: list[Footing]
    track: Track

    def points(self, pose: kinematics.Pose) -> Floats:
        """(T, n, 3) where a pose has the sole's points."""
        bodies = np.full(len(self.sole.local), self.sole.body)
        return kinematics.points(pose, bodies, self.sole.local)

    def undersides(self, pose: kinematics.Pose) -> Floats:
        """(T, m, 3) where a pose has the rest of the sole's underside."""
        bodies = np.full(len(self.sole.under), self.sole.body)
        return kinematics.points(pose, bodies, self.sole.under)

    def yaw_shift(self) -> Floats:
        """(T,) by how much the heading is corrected, rad, continuous."""
        if len(self.sole.local) < 2:
            return np.zeros(len(self.motion.yaw))
        change = self.track.rotation @ np.swapaxes(self.motion.rotation, 1, 2)
        quat = kinematics.continuous(kinematics.matrix_to_quat(change))
        shift: Floats = np.unwrap(2.0 * np.arctan2(quat[:, 3], quat[:, 0]))
        shift -= 2.0 * np.pi * np.round(shift[0] / (2.0 * np.pi))
        return shift
