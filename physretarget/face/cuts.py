"""Where an animator would set a key: at turning points, and where a rest begins or ends.

The paper halves its examples blindly. Here a cut at such a frame is cheaper by a share of a key's
price, so that the placement prefers it where all else is alike.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physretarget.face.measure import extrema

Array = NDArray[np.float64]
_STANDS_OUT = 0.04  # of what the channel moves: smaller turns may be noise
_REST_SPEED = 0.25  # of what the channel moves, per second
_REST_SECONDS = 0.12


def turning_frames(smooth: Array) -> NDArray[np.intp]:
    """Frames of a channel (M,), in units of what it moves, where it turns."""
    return extrema(smooth, _STANDS_OUT)


def rest_frames(smooth: Array, fps: float) -> NDArray[np.intp]:
    """First and last frames of all rests of a channel (M,), in units of what it moves."""
    still = np.abs(np.gradient(smooth)) * fps < _REST_SPEED
    change = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(np.int8)))
    first, last = change[::2], change[1::2] - 1
    long = (last - first) / fps >= _REST_SECONDS
    return np.unique(np.concatenate([first[long], last[long]]))


def cut_discounts(smooth: Array, fps: float, turns: float, rests: float) -> NDArray[np.float32]:
    """(C, M) by how much windows that end at a frame are cheaper, for channels (C, M)."""
    less = np.zeros(smooth.shape, dtype=np.float32)
    for channel, values in enumerate(smooth):
        if turns and len(values) > 2:
            less[channel, turning_frames(values)] += np.float32(turns)
        if rests and len(values) > 2:
            less[channel, rest_frames(values, fps)] += np.float32(rests)
    return less
