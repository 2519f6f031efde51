"""A character of the studies with its key poses."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physretarget.keyposes import KeyPoseSet, load_keyposes, training_pairs
from physretarget.mjcf import Character
from physretarget.reproduce.plan import keypose_files

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Subject:
    """A character with its pairs; ``style`` (N,) names each key pose's style or capture."""

    character: Character
    keyposes: KeyPoseSet
    y: Array
    z: Array
    sources: tuple[str, ...]
    sequence: tuple[str, ...]


@lru_cache(maxsize=4)
def subject(models: Path, name: str) -> Subject:
    """The character and all its key poses."""
    character = Character.load(models / f"{name}.xml")
    keyposes = load_keyposes(keypose_files(models, name), character)
    y, z = training_pairs(keyposes, character)
    sources = tuple(pose.source for pose in keyposes.poses)
    return Subject(character, keyposes, y, z, sources, tuple(map(sequence_of, sources)))


def sequence_of(source: str) -> str:
    """The sequence of a capture: its style for the acted takes, itself for all others."""
    parts = Path(source).stem.split("_")
    return parts[2] if parts[0] == "dataset-1" and len(parts) == 4 else Path(source).stem
