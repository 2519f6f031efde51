"""A mapper together with what it was learned from: its character and its key poses."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physretarget import mapping
from physretarget.capture.actor import REFERENCE_ACTOR, ActorShape
from physretarget.clip import Members, npz_bytes, write_file
from physretarget.errors import InputError
from physretarget.keyposes import KeyPoseSet, training_pairs
from physretarget.mjcf import Character, actor_character

Array = NDArray[np.float64]
FORMAT = "physretarget/mapper/1"


@dataclass(frozen=True, kw_only=True, eq=False)
class TrainedMapper:
    """Actor features to character features, learned from N key poses.

    ``y`` (N, D_Y) and ``z`` (N, D_Z) are the key poses' features, ``qpos`` (N, nq) the
    character's poses: where IK starts from. ``names`` and ``sources`` (capture file names) of
    the key poses.
    """

    character: Character
    actor: Character
    mapper: mapping.Mapper
    y: Array
    z: Array
    qpos: Array
    names: tuple[str, ...]
    sources: tuple[str, ...]

    def nearest_pose(self, y: Array) -> Array:
        """The character's pose (T, nq) of the key pose nearest to each frame of y (T, D_Y)."""
        squared = (
            np.sum(y**2, axis=1)[:, None] - 2.0 * y @ self.y.T + np.sum(self.y**2, axis=1)[None]
        )
        return np.asarray(self.qpos[np.argmin(squared, axis=1)])

    @property
    def sha256(self) -> str:
        """SHA-256 of the key poses' features: what was learned from."""
        return hashlib.sha256(self.y.tobytes() + self.z.tobytes()).hexdigest()

    def save(self, path: str | Path) -> None:
        """Write the mapper to an npz without pickles; same mapper, same bytes."""
        header = {
            "format": FORMAT,
            "character": self.character.name,
            "character_sha256": self.character.sha256,
            "reference_actor": REFERENCE_ACTOR,
            "mapper": self.mapper.name,
            "names": list(self.names),
            "sources": list(self.sources),
        }
        content = {
            "header": np.array(json.dumps(header, sort_keys=True)),
            "y": self.y,
            "z": self.z,
            "qpos": self.qpos,
            **{f"mapper_{k}": v for k, v in self.mapper.to_arrays().items()},
        }
        write_file(path, npz_bytes(content))

    @classmethod
    def load(cls, path: str | Path, character: Character) -> TrainedMapper:
        """Read a mapper that was learned for this very character.

        Raises:
            InputError: not a mapper file, or learned for another character.
        """
        check_mobile(character)
        try:
            content = Path(path).read_bytes()
        except OSError as error:
            raise InputError(f"cannot be read: {error.strerror}.", path=path) from error
        arrays = Members(content, path=str(path))
        try:
            header = json.loads(str(arrays["header"].item()))
            known = header["format"] == FORMAT
        except (KeyError, ValueError, TypeError):
            known = False
        if not known:
            raise InputError("not a mapper file written by 'physretarget learn'.", path=path)
        if header["character_sha256"] != character.sha256:
            raise InputError(
                f"learned for {header['character']!r} ({header['character_sha256'][:12]}), "
                f"not for this {character.name!r} ({character.sha256[:12]}): learn it again.",
                path=path,
            )
        if header["reference_actor"] != REFERENCE_ACTOR:
            raise InputError(
                f"learned on reference actor {header['reference_actor']}, "
                f"this version has {REFERENCE_ACTOR}: learn it again.",
                path=path,
            )
        own = {k.removeprefix("mapper_"): v for k, v in arrays.items() if k.startswith("mapper_")}
        return cls(
            character=character,
            actor=actor_character(ActorShape.reference()),
            mapper=mapping.from_arrays(own),
            y=arrays.floats("y", ndim=2),
            z=arrays.floats("z", ndim=2),
            qpos=arrays.floats("qpos", ndim=2),
            names=tuple(header["names"]),
            sources=tuple(header["sources"]),
        )


def check_mobile(character: Character) -> None:
    """Raise InputError for a character without a free joint: nothing could move its root."""
    if not character.has_root:
        raise InputError(
            f"model {character.name!r} has no free joint: a character that is retargeted to "
            "moves through the world on one (<freejoint/> in its root body).",
            path=character.path,
        )


def learn(
    character: Character,
    keyposes: KeyPoseSet,
    *,
    mapper: str = "sgplvm",
    dims: int = 30,
    seed: int = 0,
) -> TrainedMapper:
    """Learn a mapper from key poses.

    Args:
        character: whose poses they are.
        keyposes: the pairs.
        mapper: one of :data:`physretarget.mapping.NAMES`.
        dims: dimension of the latent space (the paper's D_X = 30).
        seed: of the latent initialisation.

    Raises:
        InputError: the character is fixed in the world, so that no motion can carry it.
    """
    check_mobile(character)
    y, z = training_pairs(keyposes, character)
    return TrainedMapper(
        character=character,
        actor=actor_character(ActorShape.reference()),
        mapper=mapping.fit(mapper, y, z, dims=dims, seed=seed),
        y=y,
        z=z,
        qpos=np.stack([pose.qpos for pose in keyposes.poses]),
        names=tuple(pose.name for pose in keyposes.poses),
        sources=tuple(pose.source for pose in keyposes.poses),
    )
