"""Where the floor of a model is, and how rough it is to the character."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from physretarget.errors import InputError
from physretarget.mjcf.reference import field_heights, geom_span, lowest_and_highest

__all__ = ["DEFAULT_FRICTION", "find_floor"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

DEFAULT_FRICTION = 1.0  # MuJoCo's own default of a geom's sliding friction
_LEVEL = 0.999  # cosine: 2.6 degrees
# Geoms this share of the height above the lowest point, in the reference pose, are stood on.
_STOOD_ON = 0.1


def find_floor(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    bodies: Ints,
    told: Array | None,
    notes: list[str],
) -> tuple[float | None, float, float]:
    """Height of the floor, None without one, its sliding friction, and that of feet upon it.

    The floor is the highest level plane of the world; without one the largest level box that is
    wider than the character is tall, or a level height field without hills. ``told`` is the custom
    numeric ``friction``. ``data`` has been through ``mj_kinematics``; assumptions are added to
    ``notes``.

    Raises:
        InputError: the friction told is not above zero.
    """
    if told is not None and not told[0] > 0:
        raise InputError(f"custom numeric 'friction' is {told[0]:g}, it must be above zero")
    found = _plane(model, data, notes)
    if found is None:
        found = _flat_top(model, data, bodies, notes)
    if told is not None:
        return (None if found is None else found[1]), float(told[0]), float(told[0])
    if found is None:
        notes.append(f"no friction given: {DEFAULT_FRICTION:g} is assumed")
        return None, DEFAULT_FRICTION, DEFAULT_FRICTION
    geom, height = found
    return height, float(model.geom_friction[geom, 0]), _friction(model, data, bodies, geom)


def _still(model: mujoco.MjModel, geom: int) -> bool:
    return bool(model.body_weldid[model.geom_bodyid[geom]] == 0)


def _upward(data: mujoco.MjData, geom: int) -> Array:
    """World z in the geom's frame."""
    upward: Array = data.geom_xmat[geom].reshape(3, 3)[2]
    return upward


def _of_kind(model: mujoco.MjModel, kind: mujoco.mjtGeom) -> list[int]:
    return [int(g) for g in np.flatnonzero(model.geom_type == kind) if _still(model, int(g))]


def _plane(
    model: mujoco.MjModel, data: mujoco.MjData, notes: list[str]
) -> tuple[int, float] | None:
    planes = _of_kind(model, mujoco.mjtGeom.mjGEOM_PLANE)
    level = [geom for geom in planes if _upward(data, geom)[2] > _LEVEL]
    for geom in planes:
        slope = np.degrees(np.arccos(np.clip(_upward(data, geom)[2], -1, 1)))
        if geom not in level and slope < 60:
            notes.append(f"plane {_name(model, geom)!r} is tilted by {slope:.0f} degrees: no floor")
    if not level:
        return None
    top = max(level, key=lambda geom: float(data.geom_xpos[geom, 2]))
    return top, float(data.geom_xpos[top, 2])


def _flat_top(
    model: mujoco.MjModel, data: mujoco.MjData, bodies: Ints, notes: list[str]
) -> tuple[int, float] | None:
    low, high = lowest_and_highest(model, data, bodies)
    tops: list[tuple[float, int, float]] = []  # area, geom, height
    for geom in _of_kind(model, mujoco.mjtGeom.mjGEOM_BOX):
        upward = np.abs(_upward(data, geom))
        if upward.max() > _LEVEL and (model.geom_contype[geom] | model.geom_conaffinity[geom]):
            sides = 2 * np.delete(model.geom_size[geom], upward.argmax())
            if sides.min() > high - low:
                top = geom_span(model, data, geom)[1]
                tops.append((float(sides.prod()), geom, top))
    for geom in _of_kind(model, mujoco.mjtGeom.mjGEOM_HFIELD):
        heights = field_heights(model, geom)
        if _upward(data, geom)[2] > _LEVEL and np.ptp(heights) == 0:
            size = model.hfield_size[model.geom_dataid[geom]]
            area = 4 * float(size[0] * size[1])
            tops.append((area, geom, float(data.geom_xpos[geom, 2] + heights[0])))
        else:
            notes.append("the height field is not used as a floor")
    if not tops:
        notes.append("no floor plane in the file: the floor is taken at z = 0")
        return None
    _, geom, height = max(tops)
    notes.append(
        f"no floor plane in the file: the top of {_name(model, geom)!r}, z = {height:g}, is taken "
        "for it"
    )
    return geom, height


def _friction(model: mujoco.MjModel, data: mujoco.MjData, bodies: Ints, floor: int) -> float:
    """The highest coefficient between the floor and what the character stands on.

    MuJoCo takes that of the geom of higher priority, of equal ones the larger.
    """
    low, high = lowest_and_highest(model, data, bodies)
    reach = low + _STOOD_ON * (high - low)
    coefficients = []
    for geom in np.flatnonzero(np.isin(model.geom_bodyid, bodies)):
        meets = (model.geom_contype[geom] & model.geom_conaffinity[floor]) or (
            model.geom_contype[floor] & model.geom_conaffinity[geom]
        )
        if meets and geom_span(model, data, int(geom))[0] <= reach:
            first, second = model.geom_priority[geom], model.geom_priority[floor]
            pair = model.geom_friction[[geom, floor], 0]
            coefficients.append(max(pair) if first == second else pair[0 if first > second else 1])
    return float(max(coefficients, default=model.geom_friction[floor, 0]))


def _name(model: mujoco.MjModel, geom: int) -> str:
    return model.geom(geom).name or f"geom{geom}"
