"""Frames by what holds the character: support, flight, floating."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physretarget.validation.analysis import Analysis
from physretarget.validation.rule import runs

Bools = NDArray[np.bool_]

# A frame without contact floats when this share of body weight would have to be borne.
FLOAT_BW = 0.3
# A filter smears take-off and landing over about a quarter of its period.
_SMEAR_PERIODS = 0.25
# A stretch in the air that needs support for longer than this floats as a whole.
_FLOATS_S = 0.05


def airborne(analysis: Analysis) -> Bools:
    """(T,) nothing touches the floor."""
    free: Bools = analysis["touching"] == 0
    return free


def floating(analysis: Analysis) -> Bools:
    """(T,) nothing touches, yet support is required."""
    needs: Bools = analysis["required_force"][:, 2] > FLOAT_BW
    return airborne(analysis) & needs


def flight(analysis: Analysis) -> Bools:
    """(T,) frames in the air, their ends trimmed by what the filter smears."""
    hz = analysis.settings.lowpass_hz
    trim = 0 if hz is None else round(_SMEAR_PERIODS / hz * analysis.fps)
    return eroded(airborne(analysis), trim).copy()


def free_flight(analysis: Analysis) -> Bools:
    """(T,) flight, without the stretches in the air of which a part floats."""
    judged, floats = flight(analysis), floating(analysis)
    for first, last in runs(airborne(analysis)):
        if floats[first : last + 1].sum() > _FLOATS_S * analysis.fps:
            judged[first : last + 1] = False
    return judged


def eroded(flags: Bools, frames: int) -> Bools:
    """Stretches of True shortened by so many frames at both ends (not at the clip's ends)."""
    if frames <= 0 or len(flags) == 0:
        return flags
    padded = np.pad(flags, frames, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * frames + 1)
    return np.asarray(windows.all(axis=1), dtype=np.bool_)


def chatter(analysis: Analysis, shortest_s: float) -> Bools:
    """(T,) frames in which a contact begins or ends a touch or a gap shorter than so long."""
    touch = analysis.flags("touch")
    flags = np.zeros(len(touch), dtype=bool)
    for column in touch.T:
        changes = np.flatnonzero(np.diff(column)) + 1
        short = np.diff(changes) < shortest_s * analysis.fps
        flags[changes[:-1][short]] = True
    return flags
