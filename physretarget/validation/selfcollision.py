"""Bodies that pass through each other, by the model's own collision rules."""

from __future__ import annotations

import copy
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from physretarget.mjcf import Character

Floats = NDArray[np.float64]
Series = dict[str, NDArray[np.generic]]


@dataclass(frozen=True, eq=False)
class SelfCollision:
    """A copy of the model in which only its own bodies can collide.

    The model's exclusions, masks and parent filter hold. Pairs of bodies that overlap in the
    reference pose already are a matter of the model, not of the clip: ``allowed``.
    """

    model: mujoco.MjModel
    mine: NDArray[np.bool_]
    allowed: frozenset[tuple[int, int]]
    possible: bool

    @classmethod
    def build(cls, character: Character) -> SelfCollision:
        """Prepare a model."""
        model = copy.copy(character.model)
        mine = np.isin(np.arange(model.nbody), character.bodies)
        outside = ~mine[model.geom_bodyid]
        model.geom_contype[outside] = 0
        model.geom_conaffinity[outside] = 0
        model.geom_margin[:] = 0
        solid = (model.geom_contype | model.geom_conaffinity) != 0
        pairs = len(np.unique(model.geom_bodyid[solid])) > 1
        data = mujoco.MjData(model)
        allowed: set[tuple[int, int]] = set()
        for qpos in (character.reference_qpos, model.qpos0):
            for first, second, _ in _overlaps(model, data, np.asarray(qpos), mine):
                allowed.add((first, second))
        return cls(model, mine, frozenset(allowed), bool(pairs))

    def judge(self, qpos: Floats) -> Series:
        """Deepest overlap (T,) m, 0 for none, and the two bodies (T, 2)."""
        if not self.possible:
            return {}
        frames = len(qpos)
        depth, pair = np.zeros(frames), np.zeros((frames, 2), dtype=np.int64)
        data = mujoco.MjData(self.model)
        for t in range(frames):
            for first, second, distance in _overlaps(self.model, data, qpos[t], self.mine):
                if -distance > depth[t] and (first, second) not in self.allowed:
                    depth[t], pair[t] = -distance, (first, second)
        return {"self_penetration": depth, "self_pair": pair}


def _overlaps(
    model: mujoco.MjModel, data: mujoco.MjData, qpos: Floats, mine: NDArray[np.bool_]
) -> list[tuple[int, int, float]]:
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    mujoco.mj_collision(model, data)
    if data.ncon == 0:
        return []
    found = []
    for geoms, distance in zip(data.contact.geom, data.contact.dist, strict=True):
        first, second = sorted(int(model.geom_bodyid[g]) for g in geoms)
        if distance < 0 and mine[first] and mine[second]:
            found.append((first, second, float(distance)))
    return found
