"""Other tools' numbers by their own formulas, for comparison only.

They take displacements per frame or count every jump as floating; the caution stands beside
each number. Feet are the bodies that touch the floor most often, at most two.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.validation.analysis import CHUNK, Analysis
from physretarget.validation.series import FloorTouch

Floats = NDArray[np.float64]

PHYSDIFF_TOLERANCE_M = 0.005
HOLOSOMA_STEP_M = 0.01
HOLOSOMA_CONTACT_M = 0.02
# 1 % of gravity: the last digits of a text clip (1 um) make half as much at 120 frames/s.
STILL_M_S2 = 0.1


def literature(analysis: Analysis) -> dict[str, dict[str, Any]]:
    """PhysDiff's, EDGE's and holosoma's figures, each with what to beware of."""
    floor = analysis.series.floor
    if floor is None:
        return {}
    lowest = floor.lowest
    below, above = np.maximum(-lowest, 0), np.maximum(lowest, 0)
    rate = f"a distance per frame: at {analysis.fps:g} frames/s"
    feet = _followed(analysis, floor)
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
            feet.physdiff_skate_mm, "mm",
            "mean horizontal step of feet that touch in two frames running (Yuan et al. 2023)",
            f"{rate}, half of it at twice the rate",
        ),
        "edge_pfc": _entry(
            feet.edge_pfc, "1",
            "physical foot contact score, mean of |a_CoM| |v_foot| |v_foot| over the peak "
            "acceleration (Tseng et al. 2023); velocities in m/s here",
            "grows with speed of the dance; two feet are presumed; none for a clip whose CoM "
            f"never accelerates by {STILL_M_S2:g} m/s^2, where it would divide by rounding",
        ),
        "holosoma_sliding_fraction": _entry(
            feet.holosoma_fraction, "1",
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


@dataclass(frozen=True, kw_only=True)
class _Feet:
    """What the feet's steps come to; None where there are none to judge."""

    physdiff_skate_mm: float | None
    holosoma_fraction: float | None
    edge_pfc: float | None


def _followed(analysis: Analysis, floor: FloorTouch) -> _Feet:
    """Follow the feet from frame to frame, some frames at a time."""
    bodies = _two_feet(analysis, floor.bodies)
    size = _acceleration(analysis) if len(bodies) == 2 else None
    skated = slid = near = touching = score = 0.0
    for first in range(0, analysis.frames - 1, CHUNK):
        last = min(first + CHUNK, analysis.frames - 1)
        place = _places(analysis, bodies, first, last + 1)
        step, both = _steps(place, PHYSDIFF_TOLERANCE_M)
        skated, touching = skated + step[both].sum(), touching + both.sum()
        step, both = _steps(place, HOLOSOMA_CONTACT_M)
        slid, near = slid + (step[both] > HOLOSOMA_STEP_M).sum(), near + both.sum()
        if size is not None:
            speed = np.linalg.norm(np.diff(place, axis=0), axis=2) * analysis.fps
            score += float(np.sum(size[first + 1 : last + 1] * speed[:, 0] * speed[:, 1]))
    pfc = None
    if size is not None and analysis.frames > 1 and size.max() > STILL_M_S2:
        pfc = score / (analysis.frames - 1) / float(size.max())
    return _Feet(
        physdiff_skate_mm=1000 * skated / touching if touching else None,
        holosoma_fraction=slid / near if near else None,
        edge_pfc=pfc,
    )


def _two_feet(analysis: Analysis, touch: NDArray[np.bool_]) -> list[int]:
    """The bodies that touch the floor most often, at most two."""
    order = np.argsort(-touch.sum(axis=0), kind="stable")[:2]
    return [int(analysis.work.points.bodies[i]) for i in order if touch[:, i].any()]


def _places(analysis: Analysis, bodies: list[int], first: int, last: int) -> Floats:
    """(last - first, feet, 3) the centre of each foot, its height that of its lowest point."""
    points, floor = analysis.work.points, analysis.character.floor_height
    pose = kinematics.forward(analysis.character.tree, analysis.poses(first, last))
    rows = np.arange(last - first)
    feet = np.empty((len(rows), len(bodies), 3))
    for k, body in enumerate(bodies):
        own = points.of_body(body).lowest(pose)
        feet[:, k] = own.mean(axis=1)
        feet[:, k, 2] = own[rows, own[..., 2].argmin(axis=1), 2] - floor
    return feet


def _steps(place: Floats, near: float) -> tuple[Floats, NDArray[np.bool_]]:
    touching = place[..., 2] < near
    both = touching[1:] & touching[:-1]
    return np.linalg.norm(np.diff(place[..., :2], axis=0), axis=2), both


def _acceleration(analysis: Analysis) -> Floats | None:
    """(T,) m/s^2 of the CoM as EDGE takes it: falling is free."""
    required = analysis.series.required
    if required is None:
        return None
    gravity = float(np.linalg.norm(analysis.character.model.opt.gravity))
    acceleration = required.force * gravity
    acceleration[:, 2] = np.maximum(acceleration[:, 2] - gravity, 0)
    size: Floats = np.linalg.norm(acceleration, axis=1)
    return size
