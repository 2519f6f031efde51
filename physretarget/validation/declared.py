"""Contacts that a clip declares: which of the model's contact points stand in which frame.

They say what was meant. What bears load is the geometry that touches, and rule CON005 names where
the two disagree.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.clip import Motion
from physretarget.ground.sliding import SLIDE_SPAN_S
from physretarget.mjcf import Character

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

# Slower than this along the floor a point rests (rule CON002 calls faster ones sliding).
REST_M_S = 0.1


@dataclass(frozen=True, eq=False)
class DeclaredContacts:
    """Where what a clip says of its contacts differs from its geometry.

    Attributes:
        height: (T,) m above the floor of the highest point that is said to stand, NaN where none
            is.
        body: (T,) the body of that point.
        undeclared: (T,) a body that rests on the floor though none of its points is said to stand,
            -1 for none.
    """

    height: Floats
    body: Ints
    undeclared: Ints


def columns(clip: Motion, character: Character) -> NDArray[np.int64] | None:
    """For each contact point of the model the clip's column that says whether it stands.

    None where the clip says nothing, or names other points than the model.
    """
    names = character.contacts.names
    if clip.contact_active is None or not names or set(names) != set(clip.contact_points):
        return None
    return np.array([clip.contact_points.index(name) for name in names], dtype=np.int64)


def not_declared(clip: Motion, character: Character) -> str:
    """Why there is nothing to compare."""
    if clip.contact_active is None:
        return "the clip does not say which points stand"
    if not len(character.contacts):
        return "the model declares no contact points"
    return "the clip's contact points are not the model's"


def compare(
    declared: Bools,
    character: Character,
    tolerance: float,
    poses: tuple[kinematics.Pose, ...],
    keep: slice,
    step: float,
) -> DeclaredContacts:
    """What is ``declared`` (T, P), with neighbours, beside the geometry.

    Of the clip as filtered and as given (``poses``) the kinder counts.
    """
    points, floor = character.contacts, character.floor_height
    places = [kinematics.points(pose, points.body, points.local) for pose in poses]
    height = np.min([p[keep, :, 2] for p in places], axis=0) - floor
    said = declared[keep]
    frames = np.arange(len(said))
    high = np.where(said, height, -np.inf)
    worst = high.argmax(axis=1)
    rests = _rests(places[0], keep, step) & (height < tolerance)
    undeclared = np.full(len(said), -1, dtype=np.int64)
    for body in np.unique(points.body):
        own = points.body == body
        silent = ~said[:, own].any(axis=1) & rests[:, own].any(axis=1)
        undeclared[silent & (undeclared < 0)] = body
    top = np.where(said.any(axis=1), high[frames, worst], np.nan)
    return DeclaredContacts(top, points.body[worst], undeclared)


def _rests(place: Floats, keep: slice, step: float) -> Bools:
    """(T, K) whether a point hardly moves along the floor, before and after a frame."""
    span = max(1, round(SLIDE_SPAN_S / step))
    now = np.arange(len(place))[keep]
    slow = np.ones((len(now), place.shape[1]), dtype=bool)
    for side in (-span, span):
        then = np.clip(now + side, 0, len(place) - 1)
        moved = np.linalg.norm(place[then, :, :2] - place[now, :, :2], axis=2)
        slow &= moved <= REST_M_S * span * step
    return slow
