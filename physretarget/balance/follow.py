"""From the poses that the programme asks for to poses that stand, bend and stay above the floor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from physretarget import kinematics
from physretarget.balance.hold import CHUNK, Hold
from physretarget.balance.settings import BalanceSettings
from physretarget.contact.carry import joint_weights
from physretarget.contact.clearance import surface_points
from physretarget.ground.undersides import Solid, lowest_heights, solids
from physretarget.kinematics import PointTargets
from physretarget.mjcf import Character

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

SLACK = 1e-3
"""A part of the body may sink this much (m) below the floor, or below where the clip has it."""
DEEPEST = 8e-3
"""No part ends deeper in the floor (m) than this, unless the clip has it so: with some room to the
centimetre that a reproduction allows (:mod:`physretarget.reproduce.takes`)."""
RISE = 0.05
"""Seconds before and after over which a pose that is raised fades into its neighbours."""
FIRMER = 100.0
"""Standing points are held so much more firmly than the programme counts them."""
LIFTS = 4
"""Lifting a part moves its neighbours: so often is looked again."""


def followed(
    character: Character,
    original: Array,
    wanted: Array,
    hold: Hold,
    frames: Ints,
    settings: BalanceSettings,
) -> Array:
    """Poses near ``wanted`` (t, nq), within limits, that stand where the clip stands.

    ``original`` (T, nq) is the clip, ``frames`` (t,) are those of it that are wanted. What is
    deeper in the floor than the clip has it is lifted, as far as joints and stance let it.
    """
    targets = _targets(character, wanted, hold, frames)
    moved = _solved(character, wanted, targets, settings)
    shapes = solids(character)
    floor = character.floor_height
    before = lowest_heights(shapes, kinematics.forward(character.tree, original[frames]))
    deeper = np.maximum(np.minimum(before, floor) - SLACK, floor - DEEPEST)
    allowed = np.minimum(before, deeper)
    for _ in range(LIFTS):
        after = lowest_heights(shapes, kinematics.forward(character.tree, moved))
        lift = np.maximum(allowed - after, 0.0)
        low = np.flatnonzero(lift.any(axis=1))
        if not len(low):
            break
        again = _targets(character, wanted[low], hold, frames[low])
        again.append(_lifted(character, shapes, moved[low], lift[low], settings))
        moved[low] = _solved(character, moved[low], again, settings)
    return moved


def raised(character: Character, original: Array, moved: Array, frames: Ints, step: float) -> Array:
    """The clip ``moved`` (T, nq), its root raised where a part is still too deep in the floor.

    ``original`` (T, nq) is the clip before, ``frames`` (t,) those of it that may be raised,
    ``step`` seconds from one to the next. Too deep is what is below both :data:`DEEPEST` and
    where ``original`` has it.
    """
    shapes, excess = solids(character), np.zeros(len(moved))
    for at in range(0, len(frames), CHUNK):
        some = frames[at : at + CHUNK]
        before, after = (
            lowest_heights(shapes, kinematics.forward(character.tree, qpos[some]))
            for qpos in (original, moved)
        )
        allowed = np.minimum(before, character.floor_height - DEEPEST)
        excess[some] = np.max(allowed - after, axis=1, initial=0.0)
    if not excess.any():
        return moved
    # The mean of the maxima around a frame is nowhere less than what the frame itself needs.
    width = 2 * round(RISE / step) + 1
    rise = uniform_filter1d(maximum_filter1d(excess, width, mode="nearest"), width, mode="nearest")
    higher = moved.copy()
    higher[frames, character.root_qpos + 2] += rise[frames]
    return higher


def _targets(character: Character, wanted: Array, hold: Hold, frames: Ints) -> list[PointTargets]:
    """Markers where ``wanted`` has them; held points where the clip has them, while they stand.

    Those that do not stand are where ``wanted`` has them, but not deep in the floor unless the clip
    has them there.
    """
    markers = character.markers
    pose = kinematics.forward(character.tree, wanted)
    there = kinematics.points(pose, hold.body, hold.local)
    deepest = np.minimum(hold.place[frames, :, 2], character.floor_height - DEEPEST)
    there[..., 2] = np.maximum(there[..., 2], deepest)
    place = np.where(hold.firm[frames, :, None], hold.place[frames], there)
    seen = kinematics.points(pose, markers.body, markers.local)
    weight = hold.weight[frames] * np.where(hold.firm[frames], FIRMER, 1.0)
    return [
        PointTargets(markers.body, markers.local, seen),
        PointTargets(hold.body, hold.local, place, weight),
    ]


def _lifted(
    character: Character,
    shapes: tuple[Solid, ...],
    qpos: Array,
    lift: Array,
    settings: BalanceSettings,
) -> PointTargets:
    """Surface points of the bodies that are too deep, raised by ``lift`` (t, G) of their geoms."""
    of = np.array([shape.body for shape in shapes])
    bodies = np.unique(of[lift.any(axis=0)])
    body, local = surface_points(character, bodies)
    rise = np.stack([lift[:, of == one].max(axis=1) for one in bodies], axis=1)
    rise = rise[:, np.searchsorted(bodies, body)]
    target = kinematics.points(kinematics.forward(character.tree, qpos), body, local)
    target[..., 2] += np.where(rise > 0, rise, np.nan)
    share = settings.stance / np.array([(body == one).sum() for one in body])
    return PointTargets(body, local, target, share)


def _solved(
    character: Character, start: Array, targets: list[PointTargets], settings: BalanceSettings
) -> Array:
    """Poses near ``start`` (t, nq) that bring points to their targets as far as limits let them."""
    return kinematics.solve(
        character.tree,
        start,
        targets,
        lower=character.lower,
        upper=character.upper,
        prior_weight=joint_weights(character, settings.joint),
        iterations=6,
        damping=1e-4,
        tolerance=1e-5,
    ).qpos
