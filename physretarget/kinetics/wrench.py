"""The wrench that the ground applies to an actor, from its motion alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget.capture.actor import ActorMotion
from physretarget.contact import Phases, detect_phases
from physretarget.kinetics.flight import GRAVITY, Flights, measure_flights
from physretarget.kinetics.treadmill import belt_velocity, over_ground
from physretarget.mjcf import (
    Character,
    actor_character,
    derivatives,
    lowpass,
    momentum,
    required_wrench,
)

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class GroundWrench:
    """``force`` (T, 3) N and ``moment`` (T, 3) N m about ``com`` (T, 3) m, world axes, z up.

    Smooth: low-passed as the motion is. ``phases``: when the actor's points touch.
    ``flights``: how they fall, and the gain that ``force`` is corrected by. ``belt`` (2,) m/s of
    a treadmill.
    """

    force: Floats
    moment: Floats
    com: Floats
    phases: Phases
    flights: Flights
    belt: Floats


def ground_wrench(
    motion: ActorMotion, *, hz: float | None, character: Character | None = None
) -> GroundWrench:
    """Inverse dynamics of a fitted motion, its vertical course corrected by its own flights.

    Args:
        motion: standing on z = 0, with the body's mass in its shape.
        hz: low-pass on the joint positions; None filters nothing.
        character: the motion's actor, where it has been built already.

    Returns:
        Force (T, 3) N and moment (T, 3) N m that the ground supplies.

    Raises:
        UsageError: ``hz`` is not between 0 and half the frame rate.
    """
    character = character or actor_character(motion.shape)
    belt = belt_velocity(motion)
    phases = detect_phases(over_ground(motion, belt))
    at_rest = np.zeros((len(motion.qpos), character.model.nv))
    height = momentum(character, motion.qpos, at_rest).com[:, 2]
    airborne = ~phases.active.any(axis=1) & motion.valid
    flights = measure_flights(height, airborne, motion.time)
    qpos = motion.qpos if hz is None else lowpass(character, motion.qpos, motion.fps, hz)
    wrench = required_wrench(character, qpos, *derivatives(character, qpos, motion.time))
    force = wrench.force.copy()
    weight = character.mass * GRAVITY
    force[:, 2] = weight + (force[:, 2] - weight) / flights.gain
    moment = wrench.moment + np.cross(wrench.root - wrench.com, wrench.force)
    return GroundWrench(
        force=force, moment=moment, com=wrench.com, phases=phases,
        flights=flights, belt=belt,
    )  # fmt: skip
