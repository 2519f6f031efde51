"""Masses, centres of mass and inertias of the actor's segments.

From de Leva, "Adjustments to Zatsiorsky-Seluyanov's segment inertia parameters", J. Biomech.
29 (1996), table 4, males: mass in percent of the body; centre of mass in percent of the
segment's length from its proximal end; radii of gyration about the sagittal (front to back),
transverse (side to side) and longitudinal axis, in percent of the same length.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget.capture.actor import SEGMENT, SEGMENTS, ActorShape

__all__ = ["SegmentInertia", "segment_inertias"]

Array = NDArray[np.float64]

CLAVICLE_SHARE = 0.08
"""Share of the upper trunk's mass that moves with one clavicle: a choice of ours.

De Leva's trunk has no shoulder girdle, but the actor's shoulders move. Mass and centre of mass
of the upper trunk as a whole stay de Leva's in the zero pose.
"""

TOES_SHARE = 0.73
"""Heel to the ball of the toes as a share of the whole foot, as in the reference actor."""


@dataclass(frozen=True)
class _Row:
    """One line of the table, in percent; ``from_tip`` if de Leva counts from the far end."""

    mass: float
    com: float
    radii: tuple[float, float, float]
    from_tip: bool = False


_TABLE = {
    "pelvis": _Row(11.17, 61.15, (61.5, 55.1, 58.7), from_tip=True),  # omphalion to mid-hip
    "abdomen": _Row(16.33, 45.02, (48.2, 38.3, 46.8), from_tip=True),  # xiphion to omphalion
    "chest": _Row(15.96, 50.66, (50.5, 32.0, 46.5), from_tip=True),  # cervicale to xiphion
    "head": _Row(6.94, 50.02, (30.3, 31.5, 26.1), from_tip=True),  # vertex to cervicale
    "upper_arm": _Row(2.71, 57.72, (28.5, 26.9, 15.8)),
    "forearm": _Row(1.62, 45.74, (27.6, 26.5, 12.1)),
    "hand": _Row(0.61, 36.24, (28.8, 23.5, 18.4)),  # wrist to the tip of the third finger
    "thigh": _Row(14.16, 40.95, (32.9, 32.9, 14.9)),
    "shank": _Row(4.33, 43.95, (25.1, 24.6, 10.2)),  # knee to ankle joint centre
    "foot": _Row(1.37, 44.15, (25.7, 24.5, 12.4)),  # heel to toe tip
}


@dataclass(frozen=True, eq=False)
class SegmentInertia:
    """``mass`` kg; ``com`` (3,) m in the segment's frame; ``inertia`` (3, 3) about it."""

    mass: float
    com: Array
    inertia: Array


def segment_inertias(shape: ActorShape) -> tuple[SegmentInertia, ...]:
    """Inertial parameters of the 18 segments, in the order of ``SEGMENTS``."""
    reference = ActorShape.reference(height=max(shape.height, 0.1), mass=shape.mass)
    rows = []
    for name in SEGMENTS:
        kind = name.removeprefix("left_").removeprefix("right_")
        if kind == "clavicle":
            rows.append(_clavicle(shape, name, reference))
        elif kind == "foot":
            rows.append(_foot(shape, name))
        else:
            rows.append(_limb(shape, name, _TABLE[kind], reference))
    chest = SEGMENT["chest"]
    rows[chest] = _without_clavicles(shape, rows)
    return tuple(rows)


def _limb(shape: ActorShape, name: str, row: _Row, reference: ActorShape) -> SegmentInertia:
    index = SEGMENT[name]
    axis = shape.tip[index]
    length, direction = _length(axis, reference.tip[index])
    share = row.com / 100.0
    com = (1.0 - share if row.from_tip else share) * axis
    mass = row.mass / 100.0 * shape.mass
    return SegmentInertia(mass, com, _tensor(mass, row.radii, length, direction))


def _foot(shape: ActorShape, name: str) -> SegmentInertia:
    """The foot's long axis runs from heel to toes, its centre lies midway to the ankle."""
    row = _TABLE["foot"]
    ball, heel = shape.tip[SEGMENT[name]], shape.heel[0 if name.startswith("left") else 1]
    sole = (ball - heel) / TOES_SHARE
    length = max(float(np.linalg.norm(sole)), 0.05 * shape.height)
    com = heel + row.com / 100.0 * sole
    com[2] *= 0.5
    mass = row.mass / 100.0 * shape.mass
    # Anatomists point the foot down: its "sagittal" axis is vertical when standing.
    about = (row.radii[2], row.radii[1], row.radii[0])
    heading = np.array([-sole[1], sole[0], 0.0])  # the foot's side axis
    heading = heading / max(float(np.linalg.norm(heading)), 1e-9)
    if not heading.any():
        heading = np.array([0.0, 1.0, 0.0])
    turn = np.column_stack([np.cross(heading, [0.0, 0.0, 1.0]), heading, [0.0, 0.0, 1.0]])
    squares = mass * (np.array(about) / 100.0 * length) ** 2
    return SegmentInertia(mass, com, turn @ np.diag(squares) @ turn.T)


def _clavicle(shape: ActorShape, name: str, reference: ActorShape) -> SegmentInertia:
    """A piece of the girdle, as large as it is long: round, so that it has no axis of ease."""
    axis = shape.tip[SEGMENT[name]]
    length, _ = _length(axis, reference.tip[SEGMENT[name]])
    mass = CLAVICLE_SHARE * _TABLE["chest"].mass / 100.0 * shape.mass
    return SegmentInertia(mass, 0.5 * axis, mass * (0.4 * length) ** 2 * np.eye(3))


def _without_clavicles(shape: ActorShape, rows: list[SegmentInertia]) -> SegmentInertia:
    whole = rows[SEGMENT["chest"]]
    girdle = [SEGMENT["left_clavicle"], SEGMENT["right_clavicle"]]
    taken = sum(rows[i].mass for i in girdle)
    moment = sum(rows[i].mass * (shape.offset[i] + rows[i].com) for i in girdle)
    mass = whole.mass - taken
    com = (whole.mass * whole.com - moment) / mass
    return SegmentInertia(mass, com, whole.inertia * (mass / whole.mass))


def _length(axis: Array, fallback: Array) -> tuple[float, Array]:
    """Length and direction of a segment; one that a skeleton lacks keeps a body of its own."""
    length, usual = float(np.linalg.norm(axis)), float(np.linalg.norm(fallback))
    direction = axis / length if length > 1e-6 else fallback / usual
    return max(length, 0.4 * usual), direction


def _tensor(
    mass: float, radii: tuple[float, float, float], length: float, direction: Array
) -> Array:
    """Inertia whose longitudinal axis is `direction`; the others stay nearest to x and y."""
    z = direction if direction[2] >= 0 else -direction
    x = np.array([1.0, 0.0, 0.0]) - z[0] * z
    if np.linalg.norm(x) < 1e-3:  # a segment along x: its sagittal axis points down
        x = np.array([0.0, 0.0, -1.0]) + z[2] * z
    x = x / np.linalg.norm(x)
    turn = np.column_stack([x, np.cross(z, x), z])
    squares = mass * (np.array(radii) / 100.0 * length) ** 2
    tensor: Array = turn @ np.diag(squares) @ turn.T
    return tensor
