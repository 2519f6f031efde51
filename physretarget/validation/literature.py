"""Other tools' numbers by their own formulas, for comparison only.

They take displacements per frame or count every jump as floating; the caution stands beside
each number. Feet are the bodies that touch the floor most often, at most two.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.validation.analysis import CHUNK, Analysis
from physretarget.validation.geometry import lowest_points

Floats = NDArray[np.float64]

PHYSDIFF_TOLERANCE_M = 0.005
HOLOSOMA_STEP_M = 0.01
HOLOSOMA_CONTACT_M = 0.02


def literature(analysis: Analysis) -> dict[str, dict[str, Any]]:
    """PhysDiff's, EDGE's and holosoma's figures, each with what to beware of."""
    if "lowest" not in analysis.has:
        return {}
    lowest = analysis["lowest"]
    below, above = np.maximum(-lowest, 0), np.maximum(lowest, 0)
    rate = f"a distance per frame: at {analysis.fps:g} frames/s"
    feet, place = _feet(analysis)
    return {
        "physdiff_penetrate_mm": _entry(
            1000 * np.mean(np.where(below > PHYSDIFF_TOLERANCE_M, below, 0)), "mm",
            "mean depth of the lowest point below the floor, 5 mm tolerated (Yuan et al. 2023)",
            "an average over all frames: a short deep dip hides in a long clip",
        ),
        "physdiff_float_mm": _entry(
            1000 * np.mean(np.where(above > PHYSDIFF_TOLERANCE_M, above, 0)), "mm",
            "mean height of the lowest point above the floor, 5 mm tolerated (Yuan et al. 2023)",
            "every jump scores as floating",
        ),
        "physdiff_skate_mm": _entry(
            _physdiff_skate(place), "mm",
            "mean horizontal step of feet that touch in two frames running (Yuan et al. 2023)",
            f"{rate}, half of it at twice the rate",
        ),
        "edge_pfc": _entry(
            _edge_pfc(analysis, feet, place), "1",
            "physical foot contact score, mean of |a_CoM| |v_foot| |v_foot| over the peak "
            "acceleration (Tseng et al. 2023); velocities in m/s here",
            "grows with speed of the dance; two feet are presumed",
        ),
        "holosoma_sliding_fraction": _entry(
            _holosoma(place), "1",
            "share of touching foot frames that move over 1 cm since the frame before "
            "(Yang et al. 2025)",
            f"{rate} 1 cm per frame is {analysis.fps * HOLOSOMA_STEP_M:.3g} m/s",
        ),
    }  # fmt: skip


def _entry(
    value: float | np.floating[Any] | None, unit: str, definition: str, caution: str
) -> dict[str, Any]:
    number = None if value is None else float(value)
    return {"value": number, "unit": unit, "definition": definition, "caution": caution}


def _feet(analysis: Analysis) -> tuple[int, Floats]:
    """How many feet, and (T, feet, 3) the lowest point of each."""
    touch = analysis.flags("touch")
    order = np.argsort(-touch.sum(axis=0), kind="stable")[:2]
    bodies = [int(analysis.work.points.bodies[i]) for i in order if touch[:, i].any()]
    points, floor = analysis.work.points, analysis.character.floor_height
    parts = []
    for first in range(0, analysis.frames, CHUNK):
        poses = analysis.poses(first, min(first + CHUNK, analysis.frames))
        pose = kinematics.forward(analysis.character.tree, poses)
        low = lowest_points(pose, points)
        rows = np.arange(len(low))
        feet = []
        for body in bodies:
            own = low[:, points.body == body]
            # The foot is followed at its centre, its height taken at its lowest point.
            centre = own.mean(axis=1)
            centre[:, 2] = own[rows, own[..., 2].argmin(axis=1), 2] - floor
            feet.append(centre)
        parts.append(np.stack(feet, axis=1) if feet else np.zeros((len(low), 0, 3)))
    return len(bodies), np.concatenate(parts)


def _steps(place: Floats, near: float) -> tuple[Floats, NDArray[np.bool_]]:
    touching = place[..., 2] < near
    both = touching[1:] & touching[:-1]
    return np.linalg.norm(np.diff(place[..., :2], axis=0), axis=2), both


def _physdiff_skate(place: Floats) -> float | None:
    step, both = _steps(place, PHYSDIFF_TOLERANCE_M)
    return float(1000 * step[both].mean()) if both.any() else None


def _holosoma(place: Floats) -> float | None:
    step, both = _steps(place, HOLOSOMA_CONTACT_M)
    return float((step[both] > HOLOSOMA_STEP_M).mean()) if both.any() else None


def _edge_pfc(analysis: Analysis, feet: int, place: Floats) -> float | None:
    if feet != 2 or "required_force" not in analysis.has:
        return None
    gravity = float(np.linalg.norm(analysis.character.model.opt.gravity))
    acceleration = analysis["required_force"] * gravity - np.array([0, 0, gravity])
    acceleration[:, 2] = np.maximum(acceleration[:, 2], 0)  # falling is free
    size = np.linalg.norm(acceleration, axis=1)
    speed = np.linalg.norm(np.diff(place, axis=0), axis=2) * analysis.fps
    if len(speed) == 0 or size.max() == 0:
        return None
    return float(np.mean(size[1:] * speed[:, 0] * speed[:, 1]) / size.max())
