"""The feet of an actor fitted to markers, and the floor that they stand on.

Markers sit on shoes, and say little about soles: those are where feet that hardly move are.
"""

from __future__ import annotations

import numpy as np

from physretarget.capture.actor import CONTACT_POINTS, SEGMENT, ActorShape
from physretarget.capture.marker_model import Bools, Floats, MarkerModel
from physretarget.kinematics import forward, points


def on_floor(
    shape: ActorShape, qpos: Floats, valid: Bools, fps: float, notes: list[str]
) -> tuple[ActorShape, Floats]:
    """Give the feet soles that meet the capture's floor, and put that floor at z = 0."""
    tree = shape.tree()
    segment, local = shape.contact_points()
    feet = [CONTACT_POINTS.index(f"{s}_{p}") for s in ("left", "right") for p in ("heel", "toe")]
    at = points(forward(tree, qpos), segment[feet] + 1, local[feet])
    still = _still_heights(at, valid, fps)
    floor = _floor_height(at, still, valid)
    tip, heel = _soles(shape, still, _heel_over_toe(at, valid, fps), floor)
    shape = ActorShape.standing(shape.name, shape.mass, shape.offset, tip, heel)
    moved = qpos.copy()
    moved[:, 2] -= floor
    if abs(floor) > 0.01:
        notes.append(f"the floor was found at {floor:+.3f} m and moved to z = 0")
    return shape, moved


def _floor_height(at: Floats, still: list[Floats], valid: Bools) -> float:
    """The floor's height (m): where feet rest, the lowest of such places."""
    everything = np.concatenate(still)
    lowest = float(np.percentile(at[valid][..., 2].min(axis=1), 2))
    if len(everything) < 5:
        return lowest
    low = np.percentile(everything, 5)
    floor = float(np.median(everything[everything < low + 0.04]))
    # Feet on the way down to a floor below (stairs) do not rest, but they do get there.
    return min(floor, lowest + 0.03)


def _soles(
    shape: ActorShape, still: list[Floats], tilts: list[float | None], floor: float
) -> tuple[Floats, Floats]:
    """The shape's tips and heels, lowered or raised to meet the floor where they stand on it."""
    tip, heel = shape.tip.copy(), shape.heel.copy()
    for i, heights in enumerate(still):
        on = heights[np.abs(heights - floor) < 0.06]
        side, is_toe = divmod(i, 2)
        if len(on) >= 5:
            down = float(np.clip(np.median(on) - floor, -0.05, 0.05))
        elif (tilt := tilts[side]) is not None:  # it stands elsewhere, on stairs: level at least
            down = float(np.clip(-tilt if is_toe else tilt, 0.0, 0.05))
        else:
            continue
        foot = SEGMENT[("left_foot", "right_foot")[side]]
        if is_toe:
            tip[foot, 2] -= down
        else:
            heel[side, 2] -= down
    return tip, heel


def with_feet(model: MarkerModel, expected_x: Floats) -> ActorShape:
    """The shape with feet as long as their markers say: heel and ball follow heel and toes."""
    shape = model.shape
    tip, heel = shape.tip.copy(), shape.heel.copy()
    for side, name in enumerate(("left_foot", "right_foot")):
        foot, on = SEGMENT[name], model.segment == SEGMENT[name]
        if on.sum() < 2:
            continue
        expected, fitted = np.ptp(expected_x[on]), np.ptp(model.local[on, 0])
        if expected > 0.08:
            ratio = float(np.clip(fitted / expected, 0.8, 1.25))
            tip[foot, 0], heel[side, 0] = ratio * tip[foot, 0], ratio * heel[side, 0]
    return ActorShape.standing(shape.name, shape.mass, shape.offset, tip, heel)


def _still_heights(at: Floats, valid: Bools, fps: float) -> list[Floats]:
    """Heights of each foot point in frames where it hardly moves (below 0.15 m/s)."""
    if len(at) < 3:
        return [at[valid, i, 2] for i in range(at.shape[1])]
    speed = np.linalg.norm(np.gradient(at, axis=0), axis=-1) * fps
    return [at[valid & (speed[:, i] < 0.15), i, 2] for i in range(at.shape[1])]


def _heel_over_toe(at: Floats, valid: Bools, fps: float) -> list[float | None]:
    """How far (m) each heel is above its toe while both hardly move; None if they never do."""
    if len(at) < 3:
        return [None, None]
    speed = np.linalg.norm(np.gradient(at, axis=0), axis=-1) * fps
    tilts: list[float | None] = []
    for heel in (0, 2):
        still = valid & (speed[:, heel : heel + 2] < 0.15).all(axis=1)
        tilt = at[still, heel, 2] - at[still, heel + 1, 2]
        tilts.append(float(np.median(tilt)) if len(tilt) >= 5 else None)
    return tilts
