"""LeRobot's parquet: a dataset's joints in degrees, as columns ``*.pos`` or as one state vector.

The names of a state vector stand in the dataset's ``meta/info.json``, which is read if it is there.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import IO, Any

import numpy as np

from physretarget.archives.arrays import MAX_BYTES, Frames
from physretarget.clip.core import Floats
from physretarget.clip.raw import Raw, rows_of
from physretarget.errors import InputError, MissingExtraError, UnsafeInputError

_VECTORS = ("observation.state", "action")
_MOST_INFO = 1 << 22


def read(file: IO[bytes], *, path: str, sha256: str) -> Raw:
    """Joints of a dataset's file: what was observed, else what was commanded.

    Args:
        file: The open file.
        path: Its name; the dataset's description is looked for in the folders above.
        sha256: Its hash.

    Raises:
        InputError: It is damaged, or holds no joints.
        MissingExtraError: pyarrow is not installed.
    """
    parquet = _library()
    try:
        table = parquet.ParquetFile(file)
        rows, columns = table.metadata.num_rows, table.schema_arrow.names
        if rows * max(len(columns), 1) * 8 > MAX_BYTES:
            raise UnsafeInputError(f"claims {rows} rows of {len(columns)} columns.", path=path)
        wanted = [name for name in columns if name.endswith(".pos")]
        states = [name for name in wanted if name.startswith("observation.")]
        vector = next((name for name in _VECTORS if name in columns), None)
        if not wanted and vector is None:
            listed = ", ".join(columns[:8])
            raise InputError(f"no column ends in .pos; the columns are {listed}.", path=path)
        names = (states or wanted) if wanted else [str(vector)]
        extra = [name for name in ("timestamp", "episode_index") if name in columns]
        data = table.read(columns=[*names, *extra]).to_pydict()
    except InputError:
        raise
    except Exception as error:  # pyarrow raises classes of its own, and plain ones
        raise InputError(f"is not a readable parquet file: {error}", path=path) from error
    info = _info(Path(path))
    values = _matrix(data, names, path)
    joints = [_bare(name) for name in names] if wanted else _names(info, str(vector))
    notes: list[str] = []
    first = _first_episode(data.get("episode_index"), notes)
    time = data.get("timestamp")
    return Raw(
        format="LeRobot parquet", path=path, sha256=sha256, rooted=False, degrees=True,
        rows=rows_of(Frames.of(values[:first])), joints=tuple(joints) if joints else None,
        time=None if time is None else np.asarray(time[:first], dtype=np.float64),
        fps=float(info["fps"]) if isinstance(info.get("fps"), int | float) else None,
        notes=tuple(notes),
    )  # fmt: skip


def _library() -> Any:
    try:
        import pyarrow.parquet as parquet
    except ImportError as error:
        raise MissingExtraError(
            "pyarrow", extra="parquet", purpose="Reading LeRobot datasets"
        ) from error
    return parquet


def _matrix(data: dict[str, list[Any]], names: list[str], path: str) -> Floats:
    try:
        columns = [np.asarray(data[name], dtype=np.float64) for name in names]
        values = columns[0] if columns[0].ndim == 2 else np.stack(columns, axis=1)
    except (ValueError, TypeError) as error:
        raise InputError(f"column '{names[0]}' holds no numbers.", path=path) from error
    if values.ndim != 2:
        raise InputError(f"column '{names[0]}' has shape {values.shape}.", path=path)
    return values


def _first_episode(episodes: list[Any] | None, notes: list[str]) -> int | None:
    """How many rows belong to the first episode, None for all."""
    if not episodes:
        return None
    other = next((i for i, each in enumerate(episodes) if each != episodes[0]), None)
    if other is not None:
        count = len(set(episodes))
        notes.append(f"The file holds {count} episodes; the first ({other} frames) is read.")
    return other


def _info(path: Path) -> dict[str, Any]:
    """The dataset's description, from the folders above its file; {} where there is none."""
    for folder in list(path.resolve().parents)[:4]:
        file = folder / "meta" / "info.json"
        if file.is_file() and file.stat().st_size <= _MOST_INFO:
            try:
                found = json.loads(file.read_text(encoding="utf-8"))
            except (ValueError, RecursionError):
                return {}
            return found if isinstance(found, dict) else {}
    return {}


def _names(info: dict[str, Any], vector: str) -> list[str]:
    """Joint names of a vector, from the description."""
    features = info.get("features")
    feature = features.get(vector) if isinstance(features, dict) else None
    names = feature.get("names") if isinstance(feature, dict) else None
    if isinstance(names, dict) and len(names) == 1:
        names = next(iter(names.values()))
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        return []
    return [_bare(name) for name in names]


def _bare(name: str) -> str:
    return re.sub(r"^(observation\.state\.|observation\.|action\.)", "", name).removesuffix(".pos")
