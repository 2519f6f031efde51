"""Any clip of any model mended with the least change: first as data, then on the floor."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.clip import Clip
from physretarget.mjcf import Character
from physretarget.wholebody import Repaired, WholeBodySettings, repair
from physretarget.wholebody.clean import cleaned
from physretarget.wholebody.stage import displacement

Array = NDArray[np.float64]

__all__ = ["Fixed", "fix"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Fixed:
    """A mended clip and what that took.

    ``moved_rms_m``: RMS displacement of the markers; ``posed_rms_m``: without what all of them
    are moved by together. ``repaired`` is what was done on the floor. ``notes`` say what else.
    """

    clip: Clip
    repaired: Repaired
    moved_rms_m: float
    posed_rms_m: float
    notes: tuple[str, ...]


def fix(clip: Clip, character: Character, *, settings: WholeBodySettings | None = None) -> Fixed:
    """Mend spikes, jumps, noise and limits, then slide, float, sink and lean of a clip.

    Args:
        clip: of the character; its stances are found, whatever it says of contacts.
        character: any model with a free root.
        settings: of the last stage; defaults if None.

    Returns:
        The mended clip, and what was done to it.

    Raises:
        InputError: no free root, nothing that touches a floor, or too few frames.
        SolverError: a step has no solution.
    """
    qpos, notes = clip.qpos, tuple[str, ...]()
    if character.has_root and len(qpos) >= 9:
        qpos, notes = cleaned(character, clip.qpos, clip.time)
    done = repair(character, qpos, clip.time, settings=settings)
    moved = displacement(character, clip.qpos, done.qpos)
    posed = _posed(character, clip.qpos, done.qpos)
    meta = {
        "lifted_m": round(done.lifted, 6),
        "moved_rms_m": round(_rms(moved), 6),
        "posed_rms_m": round(posed, 6),
        "status": done.status,
        "notes": [*notes, *done.notes],
    }
    return Fixed(
        clip=replace(clip, qpos=done.qpos, meta={**clip.meta, "fixed": meta}),
        repaired=done,
        moved_rms_m=_rms(moved),
        posed_rms_m=posed,
        notes=(*notes, *done.notes),
    )


def _posed(character: Character, before: Array, after: Array) -> float:
    """RMS displacement of the markers (m) about its mean in each frame."""
    markers, tree = character.markers, character.tree
    one, other = (
        kinematics.trajectories(tree, qpos, markers.body, markers.local) for qpos in (before, after)
    )
    change = other - one
    change = change - change.mean(axis=1, keepdims=True)
    return float(np.sqrt(np.mean(np.sum(change**2, axis=-1))))


def _rms(distance: Array) -> float:
    return float(np.sqrt(np.mean(distance**2)))
