"""What an animator turns: which part, how much of a pose, how high a hop, what is left alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from physretarget.capture.actor import ActorMotion
from physretarget.contact import Phases
from physretarget.contact.phases import any_point
from physretarget.errors import InputError
from physretarget.kinematics import runs

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

GRAVITY = 9.81
TOLERANCE = 1.1
"""A hop that is higher than told by this factor is said: frames are whole."""
FADE_S = 0.25
"""Beside what is left alone a change grows from nothing to its whole over so long."""
HASTE_FADE_S = 0.15
"""Before and after a shortened flight the actor's clock runs faster for so long."""


def excerpt(motion: ActorMotion, start: float | None, end: float | None) -> ActorMotion:
    """The frames from ``start`` to ``end`` s, both included; None for the capture's own.

    Raises:
        InputError: they lie beyond the capture.
    """
    if start is None and end is None:
        return motion
    last = float(motion.time[-1])
    for name, at in (("start", start), ("end", end)):
        if at is not None and at > last + 1e-6:
            raise InputError(
                f"{name} is {at:g} s, but the capture ends at {last:g} s.", path=motion.source.path
            )
    slack = 1e-6
    first = int(np.searchsorted(motion.time, (start or 0.0) - slack))
    final = int(np.searchsorted(motion.time, (last if end is None else end) + slack)) - 1
    return motion.cut(first, final)


def exaggerated(features: Array, share: float) -> Array:
    """Mapped features (T, D), each frame ``share`` times as far from the clip's mean.

    Inverse kinematics, momentum, contact and balance come after it: limits and gravity hold for
    the bigger gesture as for any.
    """
    if share == 1.0:
        return features
    middle = features.mean(axis=0)
    bigger: Array = middle + share * (features - middle)
    return bigger


def spans(time: Array, ranges: Sequence[str]) -> Flags:
    """(T,) which frames lie in one of the ranges, "2.0:3.5" in s, both ends included.

    Raises:
        InputError: a range begins after the clip's end.
    """
    inside = np.zeros(len(time), dtype=bool)
    for each in ranges:
        begin, end = map(float, each.split(":"))
        if begin > time[-1] + 1e-6:
            raise InputError(f"keep is {each!r}, but the clip ends at {time[-1]:.3g} s.")
        inside |= (time >= begin - 1e-6) & (time <= end + 1e-6)
    return inside


def share_beside(kept: Flags, time: Array) -> Array:
    """(T,) 0 in frames that are kept, growing smoothly to 1 within :data:`FADE_S` of them."""
    if not kept.any():
        return np.ones(len(kept))
    step = float(time[-1] - time[0]) / (len(time) - 1)
    u = np.clip(distance_transform_edt(~kept) * step / FADE_S, 0.0, 1.0)
    share: Array = u * u * (3.0 - 2.0 * u)
    return share


def shorter_flights(phases: Phases, highest: float) -> Array | None:
    """The actor's clock: times (N,) of the motion that follow one another at its frame rate.

    A body that is in the air for t seconds rises by g t² / 8, whatever its size: no hop is lower
    but a shorter one. Flights that rise higher than ``highest`` (m) are played faster, so that
    they last as long as one of that height. None where there is nothing to shorten.
    """
    time = phases.time
    step = float(time[-1] - time[0]) / (len(time) - 1)
    longest = float(np.sqrt(8.0 * highest / GRAVITY))
    goal = max(longest - step, step)  # frames are whole: a flight may come out a frame longer
    haste = np.ones(len(time))
    for first, last in runs(~any_point(phases.active)):
        lasts = (last - first + 2) * step
        if first == 0 or last == len(time) - 1 or lasts <= longest:
            continue
        near = np.abs(np.arange(len(time)) - 0.5 * (first + last)) - 0.5 * (last - first)
        fade = np.clip(1.0 - near * step / HASTE_FADE_S, 0.0, 1.0)
        haste = np.maximum(haste, 1.0 + (lasts / goal - 1.0) * fade * fade * (3.0 - 2.0 * fade))
    if haste.max() == 1.0:
        return None
    lasting = 0.5 * (1.0 / haste[1:] + 1.0 / haste[:-1]) * step
    clock = np.concatenate([[0.0], np.cumsum(lasting)])
    count = int(np.floor(clock[-1] / step + 1e-6)) + 1
    found: Array = np.interp(np.arange(count) * step, clock, time)
    return found


def lower_hops(
    motion: ActorMotion, phases: Phases, highest: float
) -> tuple[ActorMotion, Phases, tuple[str, ...]]:
    """The motion with flights that end before they rise higher than ``highest`` (m), and notes."""
    clock = shorter_flights(phases, highest)
    if clock is None:
        return motion, phases, ()
    played = motion.played(clock)
    told = (
        f"Flights are played faster, so that none rises by more than {highest:.3g} m: "
        f"{motion.time[-1] - played.time[-1]:.2f} s shorter.",
    )
    return played, replace(phases.at(clock), time=played.time), told


def too_high(hop: float, highest: float | None) -> tuple[str, ...]:
    """What there is to say of a hop (over the height) that is higher than was told."""
    if highest is None or hop <= TOLERANCE * highest:
        return ()
    return (
        f"The highest hop is {hop:.0%} of the height; max_hop is {highest:.0%}. A hop to another "
        "place is no flatter than friction can push it off, and limbs drawn up in the air count.",
    )
