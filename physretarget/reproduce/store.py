"""Finished work is kept under the hash of all that it depends on, and not done again.

A piece of work is a JSON document and named arrays. Its key covers the captures, the character,
the key poses, the parameters and this package's own source, so that nothing stale is shown.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import physretarget
from physretarget.errors import InputError
from physretarget.files import npz_bytes, write_file

Array = NDArray[np.float64]

# Nothing of these flows into a number that is kept: other commands, and what draws the page.
_BESIDE = (
    "cli/",
    "conversion/",
    "face/",
    "groundtruth/",
    "suite/",
    *(f"reproduce/{name}.py" for name in ("drawing", "explain", "page", "results", "scenes")),
    *(f"reproduce/{name}.py" for name in ("tables", "workers", "yamane")),
    "report/templates/yamane2010",
)


@dataclass(frozen=True, eq=False)
class Piece:
    """What one piece of work found; ``resumed`` when it was there from an earlier run."""

    facts: dict[str, Any]
    arrays: dict[str, Array]
    resumed: bool = False


def key_of(*parts: object) -> str:
    """SHA-256 of parts (JSON-able; paths by their content) and of the package's source."""
    whole = hashlib.sha256(source_hash().encode())
    for part in parts:
        text = _file_hash(part) if isinstance(part, Path) else json.dumps(part, sort_keys=True)
        whole.update(text.encode())
        whole.update(b"\0")
    return whole.hexdigest()


def _file_hash(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}.", path=path) from error


@lru_cache(maxsize=1)
def source_hash() -> str:
    """SHA-256 of the source files that figures come from."""
    root = Path(physretarget.__file__).parent
    whole = hashlib.sha256()
    for path in sorted([*root.rglob("*.py"), *root.rglob("*.j2"), *root.rglob("*.js")]):
        name = path.relative_to(root).as_posix()
        if not name.startswith(_BESIDE):
            whole.update(name.encode() + b"\0" + path.read_bytes())
    return whole.hexdigest()


def load(folder: Path, key: str) -> Piece | None:
    """The finished work in a folder, None if there is none with this key."""
    try:
        facts = json.loads((folder / "facts.json").read_text("utf-8"))
        if facts.get("key") != key:
            return None
        with np.load(folder / "arrays.npz", allow_pickle=False) as content:
            arrays = {name: content[name] for name in content.files}
    except (OSError, ValueError):
        return None  # missing or torn by an interruption: it is done again
    return Piece(facts, arrays, resumed=True)


def save(folder: Path, key: str, facts: Mapping[str, Any], arrays: Mapping[str, Array]) -> None:
    """Keep finished work; the facts come last, for they say that it is whole."""
    write_file(folder / "arrays.npz", npz_bytes(arrays))
    text = json.dumps({**facts, "key": key}, indent=1, sort_keys=True)
    write_file(folder / "facts.json", text.encode())
