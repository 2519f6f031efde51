"""The one clock of the three screens: which frame is shown when.

The window and the video use it directly; ``assets/clock.js`` is its twin in the browser (a test
runs both on the same questions).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Clock:
    """Frame times ``time`` (T,) in s, strictly increasing; the clip starts at its first frame."""

    time: NDArray[np.float64]

    @property
    def start(self) -> float:
        """Time of the first frame, s."""
        return float(self.time[0])

    @property
    def end(self) -> float:
        """Time of the last frame, s."""
        return float(self.time[-1])

    @property
    def duration(self) -> float:
        """Seconds from the first frame to the last."""
        return self.end - self.start

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.time)

    def frame_at(self, seconds: float) -> int:
        """The frame on screen at a time: the last one that has begun, clamped to the clip.

        Args:
            seconds: Time on the clock, s.

        Returns:
            The frame's number.
        """
        return int(np.clip(np.searchsorted(self.time, seconds + 1e-9, side="right") - 1, 0, None))

    def between(self, seconds: float) -> tuple[int, float]:
        """Frame and the fraction in [0, 1) of the way to the next one, for interpolation.

        Args:
            seconds: Time on the clock, s.

        Returns:
            The frame, and the fraction.
        """
        frame = self.frame_at(seconds)
        if frame >= self.frames - 1 or seconds <= self.time[frame]:
            return frame, 0.0
        step = self.time[frame + 1] - self.time[frame]
        return frame, float((seconds - self.time[frame]) / step)

    def advance(self, seconds: float, elapsed: float, *, speed: float, loop: bool) -> float:
        """Time after ``elapsed`` s of wall clock at a speed; wraps round or stops at the ends.

        Args:
            seconds: Time on the clock, s.
            elapsed: Wall clock since then, s.
            speed: 1 is real time.
            loop: Begin again at the end.

        Returns:
            The new time on the clock, s.
        """
        moved = seconds + elapsed * speed
        if self.start <= moved <= self.end:
            return moved
        if loop and self.duration > 0:
            return self.start + (moved - self.start) % self.duration
        return min(max(moved, self.start), self.end)

    def ticks(self, fps: float, *, speed: float = 1.0) -> NDArray[np.float64]:
        """The times to draw for a film of the whole clip at a frame rate.

        Args:
            fps: Pictures per second of the film.
            speed: 1 is real time.

        Returns:
            (N,) times of the clip, s.
        """
        count = int(np.floor(self.duration * fps / speed + 1e-9)) + 1
        return np.asarray(self.start + np.arange(count) * (speed / fps), dtype=np.float64)
