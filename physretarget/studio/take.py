"""A capture on the studio's timeline."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget.capture.actor import ActorMotion, ActorShape
from physretarget.errors import InputError
from physretarget.keyposes import without_heading

__all__ = ["Take"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Take:
    """A capture on the timeline: the motion, and (T, 75) what the reference actor does."""

    motion: ActorMotion
    qpos: Array

    @classmethod
    def of(cls, motion: ActorMotion) -> Take:
        """Carry a capture onto the reference actor.

        Args:
            motion: The actor's motion.

        Returns:
            The capture as the studio shows it.
        """
        return cls(motion, motion.on(ActorShape.reference()).qpos)

    @property
    def name(self) -> str:
        """Of its file."""
        return self.motion.source.name

    def frame(self, time: float) -> int:
        """The frame nearest to a time (s).

        Args:
            time: Time of the capture, s.

        Returns:
            The frame's number.
        """
        return int(np.argmin(np.abs(self.motion.time - time)))

    def actor(self, time: float) -> Array:
        """(75,) pose of the reference actor, without heading.

        Args:
            time: Time of the capture, s.

        Returns:
            (75,) pose.

        Raises:
            InputError: the actor was not seen then.
        """
        frame = self.frame(time)
        if not self.motion.valid[frame]:
            raise InputError(f"the actor cannot be seen at {time:.2f} s", path=self.name)
        return without_heading(self.qpos[frame])
