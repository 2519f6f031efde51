"""Contact with anything but the floor: walls, furniture, props, other moving trees.

What these push or carry is not known from the character's motion alone. Frames in which the
character touches them, and those within reach of such a contact, are not judged by its forces.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from physretarget.mjcf import Character
from physretarget.mjcf.reference import field_heights, geom_span

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ExternalTouch:
    """What the character touches that is neither the floor nor its own.

    Attributes:
        geom: (T,) one of its geoms, -1 for none.
    """

    geom: Ints


@dataclass(frozen=True, eq=False)
class ExternalContacts:
    """A copy of the model in which only character and foreign geoms collide, within a tolerance.

    None where the model has nothing foreign that the character could touch.
    """

    model: mujoco.MjModel | None
    mine: NDArray[np.bool_]

    @classmethod
    def build(cls, character: Character, tolerance: float) -> ExternalContacts:
        """Prepare a model; planes and tops at the height of the floor are the floor."""
        mine = np.isin(character.model.geom_bodyid, character.bodies)
        if not character.has_root:
            return cls(None, mine)
        model = copy.copy(character.model)
        foreign = _foreign(character, mine, tolerance)
        model.geom_contype[~(mine | foreign)] = 0
        model.geom_conaffinity[~(mine | foreign)] = 0
        kind, affinity = model.geom_contype, model.geom_conaffinity
        meets = np.any(kind[mine][:, None] & affinity[foreign][None]) or np.any(
            affinity[mine][:, None] & kind[foreign][None]
        )
        pairs = model.npair > 0 and foreign.any()
        if not (meets or pairs):
            return cls(None, mine)
        model.geom_margin[:] = np.where(mine, tolerance, 0.0)
        model.geom_gap[:] = 0
        return cls(model, mine)

    def judge(self, qpos: Floats) -> ExternalTouch | None:
        """What is touched in each pose (T, nq); None where there is nothing to touch."""
        if self.model is None:
            return None
        model, data = self.model, mujoco.MjData(self.model)
        touched = np.full(len(qpos), -1, dtype=np.int64)
        for t in range(len(qpos)):
            data.qpos[:] = qpos[t]
            mujoco.mj_kinematics(model, data)
            mujoco.mj_collision(model, data)
            if data.ncon:
                geoms = np.asarray(data.contact.geom)
                mixed = self.mine[geoms].sum(axis=1) == 1
                if mixed.any():
                    first = geoms[mixed][0]
                    touched[t] = first[~self.mine[first]][0]
        return ExternalTouch(touched)


def on_slope(character: Character) -> str | None:
    """Why nothing can be said of contact with the floor, where the only ground is no level one."""
    if character.has_floor:
        return None
    model = character.model
    ground = (int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD))
    still = model.body_weldid[model.geom_bodyid] == 0
    slopes = np.flatnonzero(np.isin(model.geom_type, ground) & still)
    if len(slopes) == 0:
        return None
    name = model.geom(int(slopes[0])).name or f"geom{slopes[0]}"
    return f"the model's ground, '{name}', is no level plane"


def _foreign(character: Character, mine: NDArray[np.bool_], tolerance: float) -> NDArray[np.bool_]:
    """(ngeom,) solid geoms that are neither the character's nor the floor."""
    model = character.model
    data = mujoco.MjData(model)
    data.qpos[:] = character.reference_qpos
    mujoco.mj_kinematics(model, data)
    foreign: NDArray[np.bool_] = ~mine & ((model.geom_contype | model.geom_conaffinity) != 0)
    for geom in np.flatnonzero(foreign):
        if model.body_weldid[model.geom_bodyid[geom]] == 0:
            foreign[geom] = _top(model, data, int(geom)) > character.floor_height + tolerance
    return foreign


def _top(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> float:
    """The highest z that a still geom reaches, infinite for walls and slopes."""
    kind = model.geom_type[geom]
    level = data.geom_xmat[geom].reshape(3, 3)[2, 2] > 0.999
    height = float(data.geom_xpos[geom, 2])
    if kind == mujoco.mjtGeom.mjGEOM_PLANE:
        return height if level else np.inf
    if kind == mujoco.mjtGeom.mjGEOM_HFIELD:
        return height + float(field_heights(model, geom).max()) if level else np.inf
    return geom_span(model, data, geom)[1]
