"""Bodies that pass through each other, by the model's own collision rules."""

from __future__ import annotations

import copy
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from physretarget.mjcf import Character

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Overlap:
    """How far bodies of the character pass through each other.

    Attributes:
        depth: (T,) m of the deepest, 0 for none.
        pair: (T, 2) the two bodies.
    """

    depth: Floats
    pair: Ints


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
        always = np.stack([character.reference_qpos, model.qpos0])
        _, bodies, _ = _overlaps(model, always, mine)
        allowed = frozenset((first, second) for first, second in bodies.tolist())
        return cls(model, mine, allowed, bool(pairs))

    def judge(self, qpos: Floats) -> Overlap | None:
        """The deepest overlap in each pose (T, nq); None where no two bodies may collide."""
        if not self.possible:
            return None
        depth, pair = np.zeros(len(qpos)), np.zeros((len(qpos), 2), dtype=np.int64)
        frame, bodies, deep = _overlaps(self.model, qpos, self.mine)
        known = [first * self.model.nbody + second for first, second in self.allowed]
        new = ~np.isin(bodies @ [self.model.nbody, 1], known)
        frame, bodies, deep = frame[new], bodies[new], deep[new]
        np.maximum.at(depth, frame, deep)
        deepest = np.flatnonzero(deep == depth[frame])[::-1]  # of several the first stays
        pair[frame[deepest]] = bodies[deepest]
        return Overlap(depth, pair)


def _overlaps(
    model: mujoco.MjModel, qpos: Floats, mine: NDArray[np.bool_]
) -> tuple[Ints, Ints, Floats]:
    """Overlaps in poses (T, nq): frame (N,), bodies (N, 2) in ascending order, depth (N,) m."""
    data = mujoco.MjData(model)
    pose = data.qpos
    counts = np.zeros(len(qpos), dtype=np.int64)
    geoms: list[NDArray[np.int32]] = [np.zeros((0, 2), dtype=np.int32)]
    apart: list[Floats] = [np.zeros(0)]
    for t in range(len(qpos)):
        pose[:] = qpos[t]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        counts[t] = data.ncon
        if counts[t]:
            found = data.contact
            geoms.append(found.geom.copy())
            apart.append(found.dist.copy())
    bodies = np.sort(model.geom_bodyid[np.concatenate(geoms)].astype(np.int64), axis=1)
    depth = -np.concatenate(apart)
    real = (depth > 0) & mine[bodies].all(axis=1)
    return np.repeat(np.arange(len(qpos)), counts)[real], bodies[real], depth[real]
