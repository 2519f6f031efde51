"""Legs that act for one foot of the actor lift one after the other.

An actor lifts the heel first and lands on it, and between stands on the other foot. Where heel and
toe are legs of their own, that would have a wide body stand on the legs of one side, and it would
fall over to the other: what walks slowly on many legs lifts them in turn. So while all legs of a
side are up and the other side bears the body, that time is shared: the leg that was lifted first
lands, then the next one lifts.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from physretarget.contact.phases import Phases, any_point
from physretarget.kinematics import runs
from physretarget.mjcf import Character

Bools = NDArray[np.bool_]


def legs_in_turn(character: Character, phases: Phases) -> Phases:
    """The timetable in which legs of one side that act for one foot are never all up by choice.

    Unchanged for characters whose feet are one body each, and in flights of the whole body.
    """
    sides = [_legs(character, phases, side) for side in ("left", "right")]
    active = phases.active.copy()
    for legs in sides:
        if len(legs) < 2:
            continue
        mine = sorted({column for leg in legs for column in leg})
        others = [c for c in range(len(phases.names)) if c not in mine]
        up = ~any_point(phases.active[:, mine]) & any_point(phases.active[:, others])
        for first, last in runs(up):
            _share(active, phases.active, legs, first, last)
    return replace(phases, active=active)


def _legs(character: Character, phases: Phases, side: str) -> list[tuple[int, ...]]:
    """Of every body that stands for points of this side's foot, the columns of those points."""
    feet = [f"{side}_heel", f"{side}_toe"]
    found: dict[int, set[int]] = {}
    for body, tie in zip(character.contacts.body.tolist(), character.tied, strict=True):
        if tie in feet and tie in phases.names:
            found.setdefault(body, set()).add(phases.names.index(tie))
    legs = sorted({tuple(sorted(columns)) for columns in found.values()})
    # Legs that act for the same points cannot take turns.
    apart = [leg for leg in legs if not any(set(leg) & set(o) for o in legs if o != leg)]
    return apart if len(apart) == len(legs) else []


def _share(
    active: Bools, before: Bools, legs: list[tuple[int, ...]], first: int, last: int
) -> None:
    """Give each leg its part of the frames in which all are up, in the order of their lifting."""

    def lifted(leg: tuple[int, ...]) -> int:
        down = np.flatnonzero(before[:first, list(leg)].any(axis=1))
        return int(down[-1]) if len(down) else -1

    ordered = sorted(legs, key=lambda leg: (lifted(leg), leg))
    cuts = np.round(np.linspace(first, last + 1, len(ordered) + 1)).astype(int)
    for number, leg in enumerate(ordered):
        stands = np.ones(last + 1 - first, dtype=bool)
        stands[cuts[number] - first : cuts[number + 1] - first] = False
        active[first : last + 1, list(leg)] = stands[:, None]
