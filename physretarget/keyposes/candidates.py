"""Frames of captures that could be posed, and those that would help most, with the reason."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physretarget.capture.actor import ActorMotion, ActorShape
from physretarget.features import INVERTED_COSINE, features
from physretarget.keyposes.pairs import actor_character_of_reference
from physretarget.keyposes.pose import KeyPoseSet
from physretarget.keyposes.suggest import MOST_FRAMES, Suggestion, suggest

__all__ = ["Candidates", "NextFrame", "find_candidates", "next_frames", "posed_features"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Candidates:
    """Frames to choose from.

    Attributes:
        motions: the captures.
        motion, frame: (M,) of each candidate, which capture and which frame of it.
        y: (M, D_Y) features of the reference actor, m.
        notes: what was left out, one sentence each.
    """

    motions: tuple[ActorMotion, ...]
    motion: NDArray[np.int64]
    frame: NDArray[np.int64]
    y: Array
    notes: tuple[str, ...] = ()

    def place(self, index: int) -> tuple[ActorMotion, int]:
        """Capture and frame of a candidate."""
        return self.motions[self.motion[index]], int(self.frame[index])

    def time(self, index: int) -> float:
        """Of a candidate in its capture, s."""
        motion, frame = self.place(index)
        return float(motion.time[frame])


@dataclass(frozen=True, kw_only=True)
class NextFrame:
    """A suggestion in words: the key pose or earlier suggestion ``nearest`` to it, and why."""

    suggestion: Suggestion
    nearest: str
    reason: str


def find_candidates(motions: Sequence[ActorMotion], *, fps: float = 10.0) -> Candidates:
    """Valid frames of all captures, ``fps`` per second, thinned to what can be compared."""
    actor = actor_character_of_reference()
    motion, frame, y, notes = [], [], [], []
    for number, own in enumerate(motions):
        step = max(own.fps / fps, 1.0)
        taken = np.unique(np.round(np.arange(0, len(own.time) - 1e-9, step)).astype(np.int64))
        taken = taken[(taken < len(own.time))]
        taken = taken[own.valid[taken]]
        # Upside down a body has no heading, and so no key pose: Yamane 2010, section 4.1.
        tilt = own.qpos[taken, 4] ** 2 + own.qpos[taken, 5] ** 2
        upright = 1.0 - 2.0 * tilt > INVERTED_COSINE
        if not upright.all():
            count = int((~upright).sum())
            notes.append(f"{own.source.name}: {count} frames upside down are left out.")
        taken = taken[upright]
        qpos = own.on(ActorShape.reference()).qpos[taken]
        motion.append(np.full(len(taken), number))
        frame.append(taken)
        y.append(np.array([features(actor, each[None])[0] for each in qpos]).reshape(len(qpos), -1))
    keep = slice(None, None, int(np.ceil(max(sum(map(len, frame)), 1) / MOST_FRAMES)))
    every = np.concatenate([each for each in y if len(each)] or [np.zeros((0, 1))])
    return Candidates(
        tuple(motions), np.concatenate(motion)[keep], np.concatenate(frame)[keep], every[keep],
        tuple(notes),
    )  # fmt: skip


def posed_features(posed: KeyPoseSet | None) -> Array:
    """(N, D_Y) features of the actor in the key poses so far."""
    actor = actor_character_of_reference()
    poses = posed.poses if posed else ()
    return np.array([features(actor, pose.actor_qpos[None])[0] for pose in poses])


def next_frames(
    candidates: Candidates, posed: KeyPoseSet | None, *, count: int
) -> tuple[NextFrame, ...]:
    """The frames whose posing would help most, best first; see :func:`suggest`."""
    names = [pose.name for pose in posed.poses] if posed else []
    found = []
    for each in suggest(candidates.y, posed_features(posed), count=count):
        near = ""
        if each.nearest is not None:
            known = each.nearest < len(names)
            near = names[each.nearest] if known else f"suggestion {each.nearest - len(names) + 1}"
        found.append(NextFrame(suggestion=each, nearest=near, reason=_reason(each, near)))
    return tuple(found)


def start_name(motion: ActorMotion, frame: int) -> str:
    """What a key pose of a frame is called, until its animator calls it something else."""
    return f"{Path(motion.source.name).stem}-{motion.time[frame]:.2f}"


def _reason(each: Suggestion, near: str) -> str:
    share = f"{each.stands_for:.0%} of all frames" if each.stands_for >= 0.005 else "itself alone"
    if not near:
        return f"nothing is posed yet; stands for {share}"
    return f"{100 * each.distance:.0f} cm (RMS) from {near}, its nearest; stands for {share}"
