"""Writing files so that the same content has the same bytes and nothing is ever half there."""

from __future__ import annotations

import io
import os
import shutil
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physretarget.errors import InputError

# The oldest date a zip archive can carry: same inputs, same bytes.
_ZIP_DATE = (1980, 1, 1, 0, 0, 0)


def npz_bytes(arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """The bytes of an npz: members sorted by name, dates fixed, never pickled.

    Args:
        arrays: Name of the member → array.

    Returns:
        The file's bytes.
    """
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_STORED) as archive:
        for name, array in sorted(arrays.items()):
            member = io.BytesIO()
            np.lib.format.write_array(member, array, version=(1, 0), allow_pickle=False)
            entry = zipfile.ZipInfo(f"{name}.npy", date_time=_ZIP_DATE)
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, member.getvalue())
    return content.getvalue()


def write_file(path: str | os.PathLike[str], content: bytes) -> None:
    """Write a file, whole or not at all; missing parent folders are made.

    Args:
        path: The file.
        content: Its bytes.

    Raises:
        InputError: it cannot be written.
    """
    with beside(path) as file:
        file.write_bytes(content)


@contextmanager
def beside(path: str | os.PathLike[str], *, suffix: str = "") -> Iterator[Path]:
    """A file to write beside ``path`` that takes its place in the end; its name ends in ``suffix``.

    If something is raised meanwhile, ``path`` stays as it was. A link stays one: what it leads to
    is written. What is no file (``/dev/stdout``, a pipe) is written to: renaming would put a file
    in its place, of a device for the whole machine.

    Raises:
        InputError: it cannot be written, or its folder cannot be made.
    """
    target, made = Path(path), None
    try:
        device = target.exists() and not (target.is_file() or target.is_dir())
        if not device:
            target = target.resolve() if target.is_symlink() else target
            target.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(
            dir=None if device else target.parent, prefix=f".{target.name}.", suffix=suffix
        )
        os.close(handle)
        made = Path(name)
        yield made
        if device:
            with made.open("rb") as source, target.open("wb") as sink:
                shutil.copyfileobj(source, sink)
        else:
            made.chmod(0o644)
            made.replace(target)
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(f"cannot be written: {reason}.", path=Path(path)) from error
    finally:
        if made is not None:
            made.unlink(missing_ok=True)
