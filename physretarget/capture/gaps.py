"""Frames without numbers: short runs are interpolated and stated, long ones are not trusted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from physretarget.capture.measure import Measured, finite_frames
from physretarget.capture.recording import Floats
from physretarget.errors import InputError
from physretarget.kinematics import runs

SHORT = 0.1  # s: runs up to this long are interpolated and count as valid

Bools = NDArray[np.bool_]


def repair(measured: Measured, path: str) -> tuple[Measured, Bools, tuple[str, ...]]:
    """Fill every gap; answer also which frames (T,) may be trusted, and sentences for people.

    Gaps at the ends hold the nearest pose and are never trusted. InputError if no frame has all
    its numbers.
    """
    good = finite_frames(measured)
    if good.all():
        return measured, good, ()
    if not good.any():
        raise InputError("No frame has numbers for every joint that is needed.", path=path)
    valid = good.copy()
    bridged, lost = [], []
    for first, last in runs(~good):
        end = last + 1
        inside = first > 0 and end < len(good)
        name = f"{first}" if last == first else f"{first}-{last}"
        if inside and (end - first) / measured.fps <= SHORT + 1e-9:
            valid[first:end] = True
            bridged.append(name)
        else:
            lost.append(name)
    notes = []
    if bridged:
        notes.append(f"frames without numbers were interpolated: {', '.join(bridged)}")
    if lost:
        notes.append(f"frames without numbers for too long are not valid: {', '.join(lost)}")
    filled = replace(
        measured,
        centre={name: _fill(values, good) for name, values in measured.centre.items()},
        end={name: _fill(values, good) for name, values in measured.end.items()},
        turn={name: _fill_turns(values, good) for name, values in measured.turn.items()},
    )
    return filled, valid, tuple(notes)


def _fill(values: Floats, good: Bools) -> Floats:
    at = np.arange(len(good))
    columns = [np.interp(at, at[good], values[good, i]) for i in range(3)]
    return np.stack(columns, axis=1)


def _fill_turns(values: Floats, good: Bools) -> Floats:
    at = np.flatnonzero(good)
    if len(at) == 1:
        return np.repeat(values[at], len(good), axis=0)
    between = Slerp(at, Rotation.from_matrix(values[good]))
    filled: Floats = between(np.clip(np.arange(len(good)), at[0], at[-1])).as_matrix()
    filled[good] = values[good]
    return filled
