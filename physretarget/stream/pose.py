"""Inverse kinematics frame by frame: the pose follows its markers without leaping.

The batch path, :func:`physretarget.ik.follow`, prices speed and acceleration over the whole clip.
Of these only the past is known here: a joint that no marker sees well stays with the pose
before, and none moves faster than a joint may.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from physretarget.mjcf import Character
from physretarget.stream.body import Solver

__all__ = ["Follower"]

Array = NDArray[np.float64]

FIRST, STEPS, ANEW = 30, 2, 8
"""Gauss-Newton steps at most: in the first frame, in every other one, from a key pose."""
LOST, BETTER = 0.03, 0.5
"""A pose whose markers miss by more than this, in heights, is sought anew; what is found is headed
for if it misses by less than this share."""
LAG = 1e-5
"""s: a joint that moves the markers by s heights (RMS) per rad lags by this over s²; 2.5 ms for a
forearm, which turns a tenth of the markers at a fifth of the height."""
FASTEST = 12.0
"""rad/s (or m/s) that no joint exceeds; a runner's knee reaches it."""


class Follower:
    """Poses whose markers follow their targets, one by one."""

    def __init__(self, character: Character) -> None:
        self.character = character
        self.solver = Solver(character, character.markers, steps=STEPS)
        root = character.root_dof
        self.locked = np.arange(root, root + 2)
        self.solver.lock(self.locked)
        height = character.height
        unit = np.where(character.tree.tables.dof_turns > 0, 1.0, 1.0 / height)
        self.firm = LAG * len(character.markers.names) * (height * unit) ** 2
        self.before: Array | None = None
        self.step = 0.0

    def next(self, target: Array, step: float, nearest: Array) -> Array:
        """The pose (nq,) whose markers come closest to ``target`` (K, 3).

        ``step`` s since the pose before; ``nearest`` (nq,) the nearest key pose, where the search
        begins and begins anew when following has led to nothing.
        """
        if self.before is None:
            return self.solver.solve(nearest, target, steps=FIRST)
        self._pace(step)
        found = self.solver.solve(self.before, target, near=self.before)
        miss = self._miss(found, target)
        if miss > LOST * self.character.height:
            anew = self.solver.solve(nearest, target, steps=ANEW)
            if self._miss(anew, target) < BETTER * miss:
                return self._towards(anew, FASTEST * step)
        return found

    def _pace(self, step: float) -> None:
        """How firmly joints stay and how far they may go in a frame of this length."""
        if abs(step - self.step) > 0.01 * self.step:
            self.step = step
            self.solver.hold(self.firm / step)
            self.solver.lock(self.locked)
            self.solver.longest = FASTEST * step / STEPS

    def _towards(self, pose: Array, farthest: float) -> Array:
        """From the pose before towards another, no degree of freedom farther than that."""
        assert self.before is not None
        model = self.solver.body.model
        way = np.empty(model.nv)
        mujoco.mj_differentiatePos(model, way, 1.0, self.before, pose)
        way *= min(1.0, farthest / max(float(np.abs(way).max()), 1e-9))
        qpos = np.array(self.before)
        mujoco.mj_integratePos(model, qpos, way, 1.0)
        return qpos

    def _miss(self, qpos: Array, target: Array) -> float:
        """RMS distance of a pose's markers from where they should be, m."""
        body = self.solver.body
        body.pose(qpos)
        away = (body.points(self.character.markers) - target).ravel()
        return math.sqrt(float(away @ away) / len(target))
