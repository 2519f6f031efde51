"""What readers return: a shot of animator's curves, or a take of dense capture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from physretarget.errors import InputError
from physretarget.face.curve import Curve

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Shot:
    """Keyed curves by channel name, e.g. ``eyebrows.rotation`` (one past shot, or a result)."""

    name: str
    curves: Mapping[str, Curve]
    fps: float | None = None
    sha256: str = ""
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Take:
    """Dense capture on uniform times.

    time (T,) s from 0; values (T, C), one column per channel; notes say what was repaired.
    """

    name: str
    time: Array
    channels: tuple[str, ...]
    values: Array
    sha256: str = ""
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.values.shape != (len(self.time), len(self.channels)):
            raise InputError(
                f"{self.name}: {self.values.shape} values for {len(self.time)} frames "
                f"of {len(self.channels)} channels."
            )
        if len(self.time) < 2:
            raise InputError(f"{self.name}: a take needs at least two frames.")
        if not np.isfinite(self.time).all() or (np.diff(self.time) <= 0).any():
            raise InputError(f"{self.name}: times must be finite and increase.")
        bad = np.argwhere(~np.isfinite(self.values))
        if len(bad):
            raise InputError(
                f"channel {self.channels[bad[0, 1]]} holds a value that is not finite.",
                path=self.name,
                frame=int(bad[0, 0]),
            )

    @property
    def fps(self) -> float:
        """Frames per second."""
        return float((len(self.time) - 1) / (self.time[-1] - self.time[0]))

    def channel(self, name: str) -> Array:
        """(T,) values of one channel.

        Args:
            name: Name of the channel.

        Returns:
            (T,) its values.
        """
        if name not in self.channels:
            raise InputError(f"no channel {name}; there are {', '.join(self.channels)}.")
        column: Array = self.values[:, self.channels.index(name)]
        return column

    def resampled(self, fps: float) -> Take:
        """Linear interpolation onto another frame rate.

        Args:
            fps: Frames per second of the result.

        Returns:
            The resampled capture.
        """
        if not (np.isfinite(fps) and fps > 0):
            raise InputError(f"a frame rate of {fps:g} is not usable.")
        length = self.time[-1] - self.time[0]
        time = np.arange(int(np.floor(length * fps + 1e-6)) + 1) / fps
        columns = [np.interp(time, self.time - self.time[0], v) for v in self.values.T]
        values = np.stack(columns, axis=1) if columns else np.empty((len(time), 0))
        return replace(self, time=time, values=values)

    def between(self, start: float, end: float) -> Take:
        """The frames within [start, end], times kept.

        Args:
            start: First time, s.
            end: Last time, s.

        Returns:
            The part.
        """
        keep = (self.time >= start - 1e-9) & (self.time <= end + 1e-9)
        if keep.sum() < 2:
            raise InputError(f"{self.name}: fewer than two frames within {start:g}–{end:g} s.")
        return replace(self, time=self.time[keep], values=self.values[keep])
