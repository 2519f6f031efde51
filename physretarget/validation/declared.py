"""Contacts that a clip declares: which of the model's contact points stand in which frame.

Without them a point counts as touching within the tolerance, since soles of models and captures
lie that far off. A clip that says which points stand leaves no such doubt: those touch within
the tolerance, the others only where they are 1 mm in the floor. So a foot that swings by a
centimetre above the ground bears no load. What is said is not believed blindly: a standing
point in the air bears nothing, one that slides skates, and rule CON005 names what the clip and
its geometry disagree about.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.clip import Motion
from physretarget.mjcf import Character
from physretarget.validation.geometry import Candidates
from physretarget.validation.support import SLIDE_SPAN_S

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Series = dict[str, NDArray[np.generic]]

# Slower than this along the floor a point rests (rule CON002 calls faster ones sliding).
REST_M_S = 0.1


def columns(clip: Motion, character: Character) -> NDArray[np.int64] | None:
    """For each candidate point of the model the clip's column that says whether it stands.

    None where the clip says nothing, or names other points than the model.
    """
    names = character.contacts.names
    if clip.contact_active is None or not names or set(names) != set(clip.contact_points):
        return None
    # Candidates stand in the order of their bodies.
    order = np.argsort(character.contacts.body, kind="stable")
    return np.array([clip.contact_points.index(names[i]) for i in order], dtype=np.int64)


def not_declared(clip: Motion, character: Character) -> str:
    """Why there is nothing to compare."""
    if clip.contact_active is None:
        return "the clip does not say which points stand"
    if not len(character.contacts):
        return "the model declares no contact points"
    return "the clip's contact points are not the model's"


def compare(
    declared: Bools,
    points: Candidates,
    floor: float,
    tolerance: float,
    poses: tuple[kinematics.Pose, ...],
    keep: slice,
    step: float,
) -> Series:
    """``declared_height`` (T,) m above the floor of the highest point that is said to stand, NaN
    where none is, and ``declared_body``; ``undeclared_body`` (T,) that rests on the floor though
    none of its points is said to stand, -1 for none.

    ``declared`` (T, K) with neighbours; of the clip as filtered and as given (``poses``) the
    kinder counts.
    """
    places = [kinematics.points(pose, points.body, points.local) for pose in poses]
    height = np.min([p[keep, :, 2] for p in places], axis=0) - floor
    said = declared[keep]
    frames = np.arange(len(said))
    high = np.where(said, height, -np.inf)
    worst = high.argmax(axis=1)
    series: Series = {
        "declared_height": np.where(said.any(axis=1), high[frames, worst], np.nan),
        "declared_body": points.body[worst],
    }
    rests = _rests(places[0], keep, step) & (height < tolerance)
    undeclared = np.full(len(said), -1, dtype=np.int64)
    for body in points.bodies:
        own = points.body == body
        silent = ~said[:, own].any(axis=1) & rests[:, own].any(axis=1)
        undeclared[silent & (undeclared < 0)] = body
    series["undeclared_body"] = undeclared
    return series


def standing(declared: Bools | None, points: Candidates, bodies: int) -> Bools | None:
    """(T, bodies) which bodies are said to stand, by any of their points."""
    if declared is None:
        return None
    stands = np.zeros((len(declared), bodies), dtype=bool)
    for body in points.bodies:
        stands[:, body] = declared[:, points.body == body].any(axis=1)
    return stands


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
