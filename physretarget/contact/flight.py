"""Flights of the whole character: nothing bears it, so nothing pushes it sideways."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.contact.phases import Phases, any_point
from physretarget.contact.settings import ContactSettings
from physretarget.contact.track import Track
from physretarget.kinematics import runs
from physretarget.mjcf import Character

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


def grounded(character: Character, phases: Phases, tracks: list[Track]) -> Bools:
    """(T,) whether anything bears the character, or the actor.

    Hands or back that the character has no counterpart of bear the actor as well.
    """
    others = [name not in character.tied for name in phases.names]
    borne = any_point(phases.active[:, others])
    for track in tracks:
        borne |= track.standing
    return borne


def throw_arc(
    borne: Bools, tracks: list[Track], time: Floats, height: float, settings: ContactSettings
) -> Floats:
    """(T,) how far above the floor a throw from stance to stance has every foot, m.

    One arc for all feet: the last to leave and the first to land bound it. Flights from or onto
    hands, and those too long for a jump, have none.
    """
    arc = np.zeros(len(time))
    standing = np.logical_or.reduce([track.standing for track in tracks])
    for first, last in runs(~borne):
        before, after = first - 1, last + 1
        if before < 0 or after >= len(time) or not (standing[before] and standing[after]):
            continue
        duration = float(time[after] - time[before])
        if duration <= settings.longest_flight:
            share = (time[first:after] - time[before]) / duration
            rise = min(settings.gravity * duration**2 / 8.0, settings.hop_height * height)
            arc[first:after] = 4.0 * rise * share * (1.0 - share)
    return arc


def thrown(
    character: Character, qpos: Floats, time: Floats, borne: Bools, settings: ContactSettings
) -> Floats:
    """Flights in which the centre of mass moves straight on, as seen from above.

    Whatever the limbs do in the air, only the floor could push the whole sideways. The root
    is shifted; where a flight begins and ends nothing changes.
    """
    if not character.has_root:
        return qpos
    moved, at = qpos.copy(), character.root_qpos
    mass = np.array(character.model.body_mass)[character.bodies]
    local = np.array(character.model.body_ipos)[character.bodies]
    for first, last in runs(~borne):
        before, after = first - 1, last + 1
        if before < 0 or after >= len(qpos):
            continue
        if time[after] - time[before] > settings.longest_flight:
            continue
        pose = kinematics.forward(character.tree, qpos[before : after + 1])
        centres = kinematics.points(pose, character.bodies, local)[..., :2]
        centre = np.einsum("b,tbc->tc", mass / mass.sum(), centres)
        share = (time[before : after + 1] - time[before]) / (time[after] - time[before])
        straight = centre[0] + share[:, None] * (centre[-1] - centre[0])
        moved[before : after + 1, at : at + 2] += straight - centre
    return moved
