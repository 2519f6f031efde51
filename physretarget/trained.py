"""A mapper together with what it was learned from: its character and its key poses."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physretarget import mapping
from physretarget.archives.arrays import texts
from physretarget.capture.actor import REFERENCE_ACTOR, ActorShape
from physretarget.clip import Members, npz_bytes, write_file
from physretarget.errors import InputError
from physretarget.keyposes import KeyPoseSet, training_pairs
from physretarget.mjcf import Character, actor_character
from physretarget.options.retargeting import MapperOptions

Array = NDArray[np.float64]
FORMAT = "physretarget/mapper/1"
# What arrays of other shapes, sizes or kinds than they should be make NumPy and SciPy raise.
_DAMAGE = (
    ValueError, TypeError, IndexError, KeyError, OverflowError, ArithmeticError,
    np.linalg.LinAlgError,
)  # fmt: skip


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
        """The character's pose (T, nq) of the key pose nearest to each frame of y (T, D_Y).

        Args:
            y: (T, DY) features of the actor, m.

        Returns:
            (T, nq) poses of the character.
        """
        squared = (
            np.sum(y**2, axis=1)[:, None] - 2.0 * y @ self.y.T + np.sum(self.y**2, axis=1)[None]
        )
        return np.asarray(self.qpos[np.argmin(squared, axis=1)])

    @property
    def sha256(self) -> str:
        """SHA-256 of the key poses' features: what was learned from."""
        return hashlib.sha256(self.y.tobytes() + self.z.tobytes()).hexdigest()

    def save(self, path: str | Path) -> None:
        """Write the mapper to an npz without pickles; same mapper, same bytes.

        Args:
            path: The .npz file.
        """
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

        Args:
            path: The .npz file that ``save`` wrote.
            character: The character that it was learned for.

        Returns:
            The mapper.

        Raises:
            InputError: not a mapper file, or learned for another character.
        """
        check_mobile(character)
        try:
            content = Path(path).read_bytes()
        except OSError as error:
            raise InputError(f"cannot be read: {error.strerror}.", path=path) from error
        arrays = Members(content, path=str(path))
        header = _header(arrays)
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
        missing = [name for name in ("y", "z", "qpos") if name not in arrays]
        if missing:
            raise InputError(f"the mapper is damaged: it lacks array {missing[0]!r}.", path=path)
        y, z, qpos = (arrays.floats(name, ndim=2) for name in ("y", "z", "qpos"))
        return cls(
            character=character,
            actor=actor_character(ActorShape.reference()),
            mapper=_mapper(arrays, y, z, qpos, character),
            y=y,
            z=z,
            qpos=qpos,
            names=tuple(header["names"]),
            sources=tuple(header["sources"]),
        )


def _header(arrays: Members) -> dict[str, Any]:
    """What the file says of itself, complete and of the right kinds; else InputError."""
    kinds = {
        "format": str, "character": str, "character_sha256": str, "reference_actor": str,
        "names": list, "sources": list,
    }  # fmt: skip
    try:
        header = json.loads("".join(arrays.strings("header")))
        known = header["format"] == FORMAT and all(
            isinstance(header[key], kind) for key, kind in kinds.items()
        )
        sound = known and all(isinstance(t, str) for t in header["names"] + header["sources"])
    except (KeyError, ValueError, TypeError, RecursionError, InputError):
        sound = False
    if not sound:
        raise InputError("not a mapper file written by 'physretarget learn'.", path=arrays.path)
    return dict(header)


def _mapper(
    arrays: Members, y: Array, z: Array, qpos: Array, character: Character
) -> mapping.Mapper:
    """The mapper itself; it must map the first of its own key poses to numbers."""
    shapes = (len(y) == len(z) == len(qpos) > 0) and qpos.shape[1] == character.tree.nq
    if not shapes:
        raise InputError(
            f"the mapper is damaged: its key poses have the shapes {y.shape}, {z.shape} and "
            f"{qpos.shape}.",
            path=arrays.path,
        )
    own = {k.removeprefix("mapper_"): v for k, v in arrays.items() if k.startswith("mapper_")}
    for name, array in {**own, "y": y, "z": z, "qpos": qpos}.items():
        if array.dtype.kind not in "fiub" and texts(array.ravel()) is None:
            raise InputError(
                f"the mapper is damaged: array {name!r} holds no numbers.", path=arrays.path
            )
        if array.dtype.kind in "fc" and not np.isfinite(array).all():
            raise InputError(
                f"the mapper is damaged: array {name!r} is not finite.", path=arrays.path
            )
    try:
        mapper = mapping.from_arrays(own)
        mean = mapper.predict(y[:1]).mean
    except InputError as error:
        raise InputError(f"the mapper is damaged: {error.message}", path=arrays.path) from error
    except _DAMAGE as error:
        raise InputError(
            "the mapper is damaged: its arrays do not fit.", path=arrays.path
        ) from error
    if mean.shape != (1, z.shape[1]) or not np.isfinite(mean).all():
        raise InputError(
            "the mapper is damaged: it does not map its own key poses.", path=arrays.path
        )
    return mapper


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
    mapper: str = MapperOptions.mapper,
    dims: int = MapperOptions.dims,
    seed: int = 0,
) -> TrainedMapper:
    """Learn a mapper from key poses.

    Args:
        character: whose poses they are.
        keyposes: the pairs.
        mapper: one of :data:`physretarget.mapping.NAMES`.
        dims: dimension of the latent space (the paper's D_X = 30).
        seed: of the latent initialisation.

    Returns:
        The mapper, to be given to ``retarget`` or saved.

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
