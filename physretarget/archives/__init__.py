"""Arrays out of strangers' archives: npy, npz, pickles. Nothing is run, claims are bounded."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from physretarget.archives.arrays import Members
from physretarget.archives.joblib_pickle import MARK, unpickle_joblib
from physretarget.archives.pickles import unpickle
from physretarget.errors import InputError

__all__ = ["Members", "open_archive"]


def open_archive(content: bytes, path: str | Path) -> Mapping[Any, Any]:
    """The arrays of an npz, or the dictionary of a pickle, by name.

    Args:
        content: The file's bytes.
        path: Its name, for errors; its ending says which it is.

    Raises:
        InputError: It is damaged, or holds something else.
        UnsafeInputError: It would run code, or claims absurd sizes.
    """
    if Path(path).suffix.lower() == ".npz":
        return Members(content, path=str(path))
    value = (unpickle_joblib if MARK in content else unpickle)(content, path=str(path))
    if not isinstance(value, Mapping):
        raise InputError(f"the pickle holds a {type(value).__name__}, not a dict.", path=path)
    return value
