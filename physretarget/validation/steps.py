"""What stands out among the steps of a clip: jumps and spikes beyond limit and noise."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from physretarget.options.judging import Severity
from physretarget.validation.rule import Limits

# Of white noise the largest jump in 10 000 frames is five times its deviation, and
# its estimate from a second may be a third too small.
_ABOVE_NOISE = 8.0
_WARNING = 0.6  # share of the limit of an error


class Kind(NamedTuple):
    """What jumps: its name among the limits, in a message, its unit, and the unit to be shown."""

    name: str
    what: str
    unit: str
    shown: float
    of: str


def stands_out(
    size: NDArray[np.float64], noise: NDArray[np.float64], kind: Kind, limits: Limits, fps: float
) -> Iterator[tuple[int, float, float, Severity]]:
    """Index, size, limit and severity of what exceeds a limit and the noise around it.

    The limit holds at any frame rate: a size, and what an acceleration moves in one step.
    """
    if fps <= 0:
        return
    error = limits[kind.name] + limits[f"{kind.name}_acceleration"] / fps**2
    high = (size > _WARNING * error) & (size > _ABOVE_NOISE * noise)
    for index in np.flatnonzero(high):
        value = float(size[index])
        severe = value > error
        yield (
            int(index),
            value,
            error if severe else _WARNING * error,
            ("error" if severe else "warning"),
        )
